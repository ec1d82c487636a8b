# SPDX-License-Identifier: MIT
"""Templates: an object by its parameters and faces, what it is fitted to, its fit, and sets of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from completion.features.engine.limits import LEAST_TILES
from scenes.card import brief
from scenes.checks import ArrayValue, BoolArray, FloatArray, IntArray, Value


@dataclass(frozen=True, slots=True, eq=False)
class PixelBeams(Value):
    """Beams of n pixels.

    Attributes
    ----------
    origins : (n, 3) float
        Where each began.
    directions : (n, 3) float
        Unit directions.
    ranges : (n,) float
        How far each went; inf where nothing came back.
    """

    origins: FloatArray
    directions: FloatArray
    ranges: FloatArray

    def select(self, which: BoolArray | IntArray) -> PixelBeams:
        """Return some of them, by truth (n,) or by number (m,)."""
        return PixelBeams(self.origins[which], self.directions[which], self.ranges[which])


@dataclass(frozen=True, slots=True, eq=False)
class Measurements(ArrayValue):
    """What was measured, in one frame and one unit.

    Attributes
    ----------
    points : (n, 3) float
        All points of the input in their order, finite.
    noise : float
        Standard deviation of a point across its surface; 0 where there is none.
    spacing : float
        Typical distance between neighbouring points.
    beams : PixelBeams, optional
        The beams of a scan, those without a return too; None of points alone.
    beam_of_point : (n,) int, optional
        Number of the beam that measured each point.
    faces : (m, 3) int, optional
        Triangles of a mesh, by number of point.
    """

    points: FloatArray
    noise: float
    spacing: float
    beams: PixelBeams | None = None
    beam_of_point: IntArray | None = None
    faces: IntArray | None = None

    @property
    def diagonal(self) -> float:
        """Of the box round all points; 0 of none."""
        return float(np.linalg.norm(np.ptp(self.points, axis=0))) if len(self.points) else 0.0

    def scale(self, factor: float) -> Measurements:
        """Return the same in another unit."""
        beams = self.beams and PixelBeams(
            self.beams.origins * factor, self.beams.directions, self.beams.ranges * factor
        )
        return replace(
            self,
            points=self.points * factor,
            noise=self.noise * factor,
            spacing=self.spacing * factor,
            beams=beams,
        )


Measured = Measurements
"""The earlier name."""


class FeatureStatus(StrEnum):
    """What became of a feature."""

    FOUND = "found"
    AMBIGUOUS = "ambiguous"  # more than one explanation fits: the reason says which
    NONE = "none"  # proposed, and refused by what was measured


class SideState(StrEnum):
    """What was measured beside a side."""

    CONFIRMED = "confirmed"
    CONTRADICTED = "contradicted"
    UNSEEN = "unseen"


@dataclass(frozen=True, slots=True)
class FeatureSide(Value):
    """One side of a feature: an edge of an opening, a hole of a row, one of two joined surfaces.

    Attributes
    ----------
    name : str
        What it is called, "left".
    confirmed, contradicted, total : int
        Tiles along it, or other pieces of evidence, that say it is there, that say it is not, and all.
    deviation : float
        Standard deviation of its place across itself, in the unit of the input; inf where unknown.
    """

    name: str
    confirmed: int
    contradicted: int
    total: int
    deviation: float = np.inf

    @property
    def state(self) -> SideState:
        """Return whether it was seen: two tiles at least confirm it, and fewer contradict it."""
        if self.contradicted > self.confirmed:
            return SideState.CONTRADICTED
        return SideState.CONFIRMED if self.confirmed >= LEAST_TILES else SideState.UNSEEN

    @property
    def is_seen(self) -> bool:
        """Whether it was seen where it is said to be."""
        return self.state is SideState.CONFIRMED


@dataclass(frozen=True, slots=True, eq=False)
class TemplateFit(ArrayValue):
    """A feature: proposed, and accepted or refused by evidence.

    Attributes
    ----------
    kind : str
        "doorway", "hole-row" ...
    status : FeatureStatus
        Found, ambiguous or none.
    names : tuple of str
        The k parameters that were sought or held.
    x : (k,) float
        Their values; lengths in the unit of the input, angles in radians.
    covariance : (k, k) float
        Of them; zero in rows of what was held.
    sides : tuple of FeatureSide
        Support of each side.
    evidence : float
        Log odds against the plain surface, nats.
    false_fit_probability : float
        Of one that comes as far, with as much evidence or more, where there is no such feature: the share of
        simulated nulls, never less than one of them. NaN where no null was measured.
    faces : tuple of str
        What `assignment` numbers, from 1.
    assignment : (n,) int
        Face of each point of the input, 0 for none.
    evaluations : int
        Of the objective.
    is_complete : bool
        False where the budget or an interrupt ended the search: it is the best so far.
    reason : str
        Why it is ambiguous or refused, or what is doubtful of it; one sentence, "" for nothing.
    geometry : mapping
        What the file says beside it, by the names of the contract: "corners" (4, 3), "depth_m", "count",
        "centres" (m, 3), "radius", "radii" (2,), "joint" (2, 3), "axis" (3,).
    held : tuple of str
        The parameters that were given and held exactly.
    """

    kind: str
    status: FeatureStatus
    names: tuple[str, ...]
    x: FloatArray
    covariance: FloatArray
    sides: tuple[FeatureSide, ...]
    evidence: float
    faces: tuple[str, ...]
    assignment: IntArray
    false_fit_probability: float = np.nan
    evaluations: int = 0
    is_complete: bool = True
    reason: str = ""
    geometry: Mapping[str, object] = field(default_factory=dict)
    held: tuple[str, ...] = ()

    @classmethod
    def absent(cls, kind: str, names: tuple[str, ...], n: int, reason: str) -> TemplateFit:
        """Return what is told where nothing among n points could be fitted."""
        return cls(
            kind=kind,
            status=FeatureStatus.NONE,
            names=names,
            x=np.full(len(names), np.nan),
            covariance=np.diag(np.full(len(names), np.inf)),
            sides=(),
            evidence=-np.inf,
            faces=(),
            assignment=np.zeros(n, dtype=np.int64),
            reason=reason,
        )

    @property
    def unseen(self) -> tuple[str, ...]:
        """Names of the sides that were not seen."""
        return tuple(side.name for side in self.sides if side.state is SideState.UNSEEN)

    def value(self, name: str) -> float:
        """Return a parameter by name."""
        return float(self.x[self.names.index(name)])

    def deviation(self, name: str) -> float:
        """Return the standard deviation of a parameter by name."""
        number = self.names.index(name)
        return float(np.sqrt(max(self.covariance[number, number], 0.0)))


class Template(Protocol):
    """An object that `fit_template` fits: what a user writes.

    Attributes
    ----------
    kind : str
        What it is called.
    names : tuple of str
        Its k parameters.
    faces : tuple of str
        Its faces, numbered from 1.
    """

    @property
    def kind(self) -> str:
        """What it is called."""
        ...

    @property
    def names(self) -> tuple[str, ...]:
        """Its k parameters."""
        ...

    @property
    def faces(self) -> tuple[str, ...]:
        """Its faces, numbered from 1."""
        ...

    def bounds(self, measured: Measurements) -> tuple[FloatArray, FloatArray]:
        """Return the least and the greatest value of each parameter (k,)."""
        ...

    def distance(self, points: FloatArray, x: FloatArray) -> tuple[FloatArray, IntArray]:
        """Return the distance of points (n, 3) from the nearest face (n,), and its number (n,), from 1."""
        ...


Given = Mapping[str, float]
"""What a person knows of a feature, by name of the parameter: held exactly."""


def best_first(fits: Sequence[TemplateFit]) -> list[TemplateFit]:
    """Return the fits in order of status and evidence."""
    rank = {FeatureStatus.FOUND: 0, FeatureStatus.AMBIGUOUS: 1, FeatureStatus.NONE: 2}
    return sorted(fits, key=lambda fit: (rank[fit.status], -fit.evidence))


_FROM_GEOMETRY = ("corners", "depth_m", "count", "count_range", "centres", "radius", "radii", "joint", "axis")


@dataclass(frozen=True, slots=True, eq=False)
class Features(Value):
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

    def _facts(self) -> list[tuple[str, str]]:
        """How many came to which status, and what the best one is."""
        counts = Counter(fit.status.name.lower() for fit in self.fits)
        return [
            *((status, str(n)) for status, n in counts.items()),
            ("of", f"{self.n_points} points"),
            *(("best", brief(fit)) for fit in self.fits[:1]),
            *([] if self.is_complete else [("search", "ended before it was complete")]),
            *(("doubt", doubt) for doubt in self.doubts),
        ]

    @property
    def found(self) -> tuple[TemplateFit, ...]:
        """Those that were accepted."""
        return tuple(fit for fit in self.fits if fit.status is FeatureStatus.FOUND)

    def of_points(self) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        """Return the feature (n,), from 1, and its face (n,), from 1, of each point; 0 for none.

        Of a point that several claim the best has it; refused ones claim none.
        """
        feature, face = np.zeros(self.n_points, np.int32), np.zeros(self.n_points, np.int32)
        for number, fit in enumerate(self.fits, start=1):
            if fit.status is FeatureStatus.NONE:
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
    return [_plain(element) for element in array]


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
