# SPDX-License-Identifier: MIT
"""True fits: the planes of a room fitted to just the pixels that are theirs, and the pairs among them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

from scipy import ndimage

from benchmarks.completion.scenes.cases import Case
from completion.fitting.result import SurfaceFit
from completion.merging.merged_surface import MergedSurface
from completion.observe.observation import Observation
from completion.observe.pixel_set import PixelSet, ScanPixels
from completion.observe.refits.refitting import refit_each
from completion.relations.engine.relation import Relation
from scenes.surfaces.catalogue import Plane

LEAST_PIXELS = 1_200
_ERODED = 2  # pixels at a surface's rim that may show what is behind


@dataclass(frozen=True, slots=True, eq=False)
class TrueFit:
    """A true plane and the surface that was fitted to its pixels."""

    true: Plane
    merged: MergedSurface

    @property
    def fit(self) -> SurfaceFit:
        """The fit."""
        return self.merged.fit


def true_fits(case: Case, observations: Sequence[Observation], flatness_m: float = 0.0) -> list[TrueFit]:
    """Fit every plane of a case to its own pixels in all scans, as `truth` of these names them."""
    found = []
    for number, surface in enumerate(case.scene.surfaces):
        if not isinstance(surface, Plane):
            continue
        sets = [_pixels_of(number, seen) for seen in observations]
        if sum(map(len, sets)) < LEAST_PIXELS:
            continue
        pixels = ScanPixels.of(sets)
        local = surface.transformed(case.views[0].world_from_sensor.inverse())
        (fit,) = refit_each([local], observations, [pixels], flatness_m, n_rounds=2)
        if fit is not None:
            found.append(TrueFit(local, MergedSurface(fit, pixels, 1)))
    return found


def _pixels_of(number: int, seen: Observation) -> PixelSet:
    truth = seen.scan.truth
    assert truth is not None  # these scans are simulated
    mask = (truth.surface == number) & seen.valid
    return PixelSet.of(ndimage.binary_erosion(mask, iterations=_ERODED))


def true_relations(planes: Sequence[Plane]) -> list[Relation]:
    """Return which pairs are parallel or at right angles."""
    found = []
    for one, two in combinations(range(len(planes)), 2):
        cosine = abs(float(planes[one].normal_direction @ planes[two].normal_direction))
        if cosine > 1 - 1e-12:
            found.append(Relation(kind="parallel", surfaces=(one, two)))
        elif cosine < 1e-9:
            found.append(Relation(kind="perpendicular", surfaces=(one, two)))
    return found
