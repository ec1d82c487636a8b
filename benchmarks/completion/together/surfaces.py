# SPDX-License-Identifier: MIT
"""Surfaces of several scans together beside those of each scan alone: tilt, roughness, inferred area."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from completion.extension.patch import Patch
from completion.result.completed_model import CompletedModel
from scenes.checks import FloatArray, IntArray
from scenes.surfaces.catalogue import Plane

LEAST_M2 = 0.1  # measured area of surfaces that are compared
_MOST = 2000  # pixels of a surface that are looked at
_SHARED = 0.5  # of a surface's pixels that its counterpart holds

TruePlane = Callable[[int, IntArray], FloatArray | None]
"""The true normal (3,), sensor frame, of what flat pixels (n,) of a scan see; None where that is no plane."""


@dataclass(frozen=True, slots=True)
class Compared:
    """One surface of a scan alone, and the one of all scans together that has its pixels.

    Attributes
    ----------
    scan, alone, together : int
        Numbers, from 0.
    area_m2 : float
        Measured by the scan alone.
    tilt_alone_deg, tilt_deg : float
        Between its normal and the reference, alone and together.
    rms_alone_m, rms_m : float
        Of the pixels that are theirs alone and together about the surface, alone and together.
    inferred_alone_m2, inferred_m2 : float
        Inferred area of the two.
    """

    scan: int
    alone: int
    together: int
    area_m2: float
    tilt_alone_deg: float
    tilt_deg: float
    rms_alone_m: float
    rms_m: float
    inferred_alone_m2: float
    inferred_m2: float


def compare_surfaces(
    alone: Sequence[CompletedModel], together: CompletedModel, truth: TruePlane | None = None
) -> list[Compared]:
    """Compare the planes of scans alone with those of all together.

    The reference of tilts is the truth, or else the plane of the scan alone that knows it best of those with
    the same counterpart.
    """
    found = []
    for number in range(len(together.patches)):
        held = [
            (scan, k, patch)
            for scan, one in enumerate(alone)
            for k, patch in enumerate(one.patches)
            if _is_compared(patch) and _counterpart(patch, together.owners[scan]) == number
        ]
        if not held or not isinstance(together.patches[number].source.fit.surface, Plane):
            continue
        best = min(held, key=lambda one: _doubt(one[2]))
        for scan, k, patch in held:
            pixels = patch.source.pixels[0].flat
            pixels = pixels[together.owners[scan].ravel()[pixels] == number + 1]
            pixels = pixels[:: max(1, len(pixels) // _MOST)]
            own, joint = _normal(alone[scan], 0, patch), _normal(together, scan, together.patches[number])
            reference = truth(scan, pixels) if truth else _turned(best, alone, together, scan)
            if reference is None:
                continue
            found.append(
                Compared(
                    scan=scan,
                    alone=k,
                    together=number,
                    area_m2=patch.observed_m2,
                    tilt_alone_deg=_angle(own, reference),
                    tilt_deg=_angle(joint, reference),
                    rms_alone_m=_rms(alone[scan], 0, patch, pixels),
                    rms_m=_rms(together, scan, together.patches[number], pixels),
                    inferred_alone_m2=patch.hypothesised_m2,
                    inferred_m2=together.patches[number].hypothesised_m2,
                )
            )
    return found


def _is_compared(patch: Patch) -> bool:
    return isinstance(patch.source.fit.surface, Plane) and patch.observed_m2 >= LEAST_M2


def _counterpart(patch: Patch, owners: IntArray) -> int:
    """The surface, from 0, that holds most of a surface's pixels; -1 if none has half of them."""
    held = patch.source.pixels[0].pick(owners)
    count = np.bincount(held, minlength=1)
    count[0] = 0
    best = int(count.argmax())
    return best - 1 if count[best] > _SHARED * len(held) else -1


def _doubt(patch: Patch) -> float:
    """Predicted deviation of the normal, radians."""
    return float(np.sqrt(np.trace(patch.source.fit.covariance[1:, 1:])))


def _normal(model: CompletedModel, scan: int, patch: Patch) -> FloatArray:
    """The normal (3,) of a plane in the sensor frame of a scan."""
    back = model.observations[scan].scan.world_from_sensor.inverse()
    return back.rotate(patch.source.fit.surface.normal(np.zeros((1, 3)))[0])


def _turned(
    best: tuple[int, int, Patch], alone: Sequence[CompletedModel], together: CompletedModel, scan: int
) -> FloatArray:
    """The normal (3,) of the best plane of a scan alone, carried to another scan by the poses used."""
    here, there = (together.observations[k].scan.world_from_sensor for k in (best[0], scan))
    return there.inverse().rotate(here.rotate(_normal(alone[best[0]], 0, best[2])))


def _rms(model: CompletedModel, scan: int, patch: Patch, pixels: IntArray) -> float:
    points = model.observations[scan].points_at(pixels)
    return float(np.sqrt(np.mean(np.square(patch.source.fit.surface.distance(points)))))


def _angle(one: FloatArray, other: FloatArray) -> float:
    """Degrees between two directions, without sign."""
    return float(np.degrees(np.arccos(np.clip(abs(one @ other), -1.0, 1.0))))
