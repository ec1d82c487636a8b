# SPDX-License-Identifier: MIT
"""Feature set: all features of one material, as objects, as numbers of points, and as a record."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from completion.features.engine.template import Status, TemplateFit
from scenes.checks import FloatArray

_FROM_GEOMETRY = ("corners", "depth_m", "count", "count_range", "centres", "radius", "radii", "joint", "axis")


@dataclass(frozen=True, slots=True, eq=False)
class Features:
    """Features of n points.

    Attributes
    ----------
    fits : tuple of TemplateFit
        The best first: found, ambiguous, refused; world coordinates.
    n_points : int
        Points of the material, in its order; of scans what came back, scan by scan.
    is_complete : bool
        False where an interrupt or the budget ended a search: these are the best so far.
    doubts : tuple of str
        What could not be told, and why.
    """

    fits: tuple[TemplateFit, ...]
    n_points: int
    is_complete: bool = True
    doubts: tuple[str, ...] = ()

    @property
    def found(self) -> tuple[TemplateFit, ...]:
        """Those that were accepted."""
        return tuple(fit for fit in self.fits if fit.status is Status.FOUND)

    def of_points(self) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        """Return the feature (n,), from 1, and its face (n,), from 1, of each point; 0 for none.

        Of a point that several claim the best has it; refused ones claim none.
        """
        feature, face = np.zeros(self.n_points, np.int32), np.zeros(self.n_points, np.int32)
        for number, fit in enumerate(self.fits, start=1):
            if fit.status is Status.NONE:
                continue
            new = (fit.assignment > 0) & (feature == 0)
            feature[new], face[new] = number, fit.assignment[new]
        return feature, face

    def record(self) -> dict[str, Any]:
        """Return what features.json holds; units as in the input."""
        return {
            "features": [feature_record(fit) for fit in self.fits],
            "complete": self.is_complete,
            "warnings": list(self.doubts),
        }


def feature_record(fit: TemplateFit) -> dict[str, Any]:
    """Return one feature ready for JSON; what is not known is null."""
    return {
        "kind": fit.kind,
        "status": str(fit.status),
        "reason": fit.reason,
        "parameters": dict(zip(fit.names, map(_number, fit.x), strict=True)),
        "standard_deviation": {name: _number(fit.deviation(name)) for name in fit.names},
        "held": list(fit.held),
        "sides": {
            side.name: {
                "seen": side.is_seen,
                "state": str(side.state),
                "sd_m": _number(side.deviation),
                "confirmed": side.confirmed,
                "contradicted": side.contradicted,
                "tiles": side.total,
            }
            for side in fit.sides
        },
        "unseen": list(fit.unseen),
        "evidence": _number(fit.evidence),
        "false_fit_probability": _number(fit.false_fit_probability),
        "faces": list(fit.faces),
        "evaluations": fit.evaluations,
        "complete": fit.is_complete,
        **{name: _plain(fit.geometry[name]) for name in _FROM_GEOMETRY if name in fit.geometry},
    }


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _plain(value: object) -> object:
    """Numbers and arrays as lists; what is not finite as null."""
    array = np.asarray(value)
    if array.ndim == 0:
        return array.item() if array.dtype.kind in "iub" else _number(float(array))
    return [_plain(one) for one in array]


def moved_geometry(fit: TemplateFit, rotation: FloatArray, shift: FloatArray) -> dict[str, object]:
    """Return the geometry of a fit in another frame, by a rotation (3, 3) and a shift (3,)."""
    out = dict(fit.geometry)
    for name in ("corners", "centres", "joint"):
        if name in out:
            out[name] = np.asarray(out[name]) @ rotation.T + shift
    for name in ("axis", "into"):
        if name in out:
            out[name] = np.asarray(out[name]) @ rotation.T
    return out
