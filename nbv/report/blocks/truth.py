# SPDX-License-Identifier: MIT
"""Truth: how a completion compares with the true surface, where that is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from completion.result.completion import Completion
from nbv.coverage.measurement import measured_samples
from nbv.coverage.surface_classes import CLOSE_M, distances
from nbv.visibility.samples import SurfaceSamples
from scenes.checks import BoolArray
from scenes.mesh.labelled_mesh import LabelledMesh, triangle_areas
from scenes.scan.range_image import RangeImage

UNKNOWN, INFERRED, MEASURED = 0, 1, 2


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """What a few scans and the completion give of the true surface.

    Attributes
    ----------
    samples : SurfaceSamples
        Points of the true surface.
    state : (n,) int8
        `MEASURED` by some scan at any incidence, `INFERRED` within 2 cm, or `UNKNOWN`.
    within_close : float
        Share of the inferred area that lies within 2 cm of the true surface; 1 where nothing was inferred.
    median_m : float
        Median distance of inferred area from the true surface, metres; 0 where nothing was inferred.
    """

    samples: SurfaceSamples
    state: NDArray[np.int8]
    within_close: float
    median_m: float

    def share(self, state: int, where: BoolArray | None = None) -> float:
        """Return the share of the true area in `state`, of all samples or of those at `where` (n,)."""
        area = self.samples.areas if where is None else self.samples.areas * where
        return float(area[self.state == state].sum() / area.sum())


def compare(
    completion: Completion, scans: Sequence[RangeImage], truth: LabelledMesh, samples: SurfaceSamples
) -> Comparison:
    """Compare a completion of `scans` with the true mesh, on samples of it."""
    state = np.full(len(samples), UNKNOWN, np.int8)
    for scan in scans:
        state[measured_samples(scan, samples)[0]] = MEASURED
    mesh = completion.hypothesised
    if not len(mesh.faces):
        return Comparison(samples, state, 1.0, 0.0)
    corners = completion.world_from_reference.apply(mesh.vertices)[mesh.faces]
    open_ = np.flatnonzero(state == UNKNOWN)
    state[open_[distances(samples.points[open_], corners) <= CLOSE_M]] = INFERRED
    off = distances(corners.mean(axis=1), truth.corners)
    area = triangle_areas(corners)
    order = np.argsort(off)
    middle = int(np.searchsorted(np.cumsum(area[order]), area.sum() / 2))
    return Comparison(
        samples, state, float(area[off <= CLOSE_M].sum() / area.sum()), float(off[order][middle])
    )
