# SPDX-License-Identifier: MIT
"""Pairs: planes that enclose a room, how far they are from square or parallel, and what was stated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from completion.fitting.result import SurfaceFit
from completion.result.completed_model import CompletedModel
from scenes.scan.range_image import RangeImage
from scenes.surfaces.catalogue import Plane

LEAST_M2 = 0.3  # measured of each plane
_NEAR_DEG = 10.0  # of square or parallel: what is farther off was not meant to be


@dataclass(frozen=True, slots=True)
class AnglePair:
    """Two planes that should be square or parallel."""

    scan: str  # what it was called
    off_deg: float  # from a right angle or none
    without_deg: float  # stated deviation of the angle, the sensor's systematic errors left out
    stated_deg: float  # the same with them


def pairs_of(name: str, completed: CompletedModel) -> list[AnglePair]:
    """Return the pairs of planes that enclose what was scanned, and were measured well enough."""
    planes = [
        patch
        for patch in completed.patches
        if isinstance(patch.grid.surface, Plane) and patch.limits.encloses and patch.observed_m2 >= LEAST_M2
    ]
    found = []
    for one, other in combinations(planes, 2):
        cosine = abs(float(_normal(one.stated) @ _normal(other.stated)))
        angle = float(np.degrees(np.arccos(min(cosine, 1.0))))
        if min(angle, 90.0 - angle) > _NEAR_DEG:
            continue
        parallel = angle <= _NEAR_DEG
        without, stated = (
            float(np.degrees(np.sqrt(_variance(a, b, parallel) + _variance(b, a, parallel))))
            for a, b in ((one.source.fit, other.source.fit), (one.stated, other.stated))
        )
        found.append(AnglePair(name, angle if parallel else 90.0 - angle, without, stated))
    return found


def _normal(fit: SurfaceFit) -> np.ndarray:
    return np.asarray(fit.surface.normal(np.zeros((1, 3)))[0])


def _variance(fit: SurfaceFit, other: SurfaceFit, parallel: bool) -> float:
    """What a plane's tilt adds to the variance of the angle to another; of parallel ones the mean of both."""
    tilt, across = fit.parameter_covariances()["normal"], _normal(other)
    return float(np.trace(tilt) / 2 if parallel else across @ tilt @ across)


def summary(name: str, pairs: Sequence[AnglePair]) -> str:
    """Return a line of a Markdown table."""
    off = np.array([one.off_deg for one in pairs])
    cells = [name, str(len(pairs)), f"{np.median(off):.2f}"]
    for stated in ([one.without_deg for one in pairs], [one.stated_deg for one in pairs]):
        times = off / np.maximum(stated, 1e-12)
        cells += [f"{np.median(stated):.2f}", f"{np.median(times):.1f}", f"{np.mean(times <= 2):.2f}"]
    return "| " + " | ".join(cells) + " |"


def names_of(scans: Sequence[RangeImage], name: str) -> list[tuple[str, RangeImage]]:
    """Number some scans."""
    return [(f"{name} {k}", scan) for k, scan in enumerate(scans)]
