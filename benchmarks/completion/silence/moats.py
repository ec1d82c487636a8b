# SPDX-License-Identifier: MIT
"""Moats: pixels that a simulated Kinect has no depth of, why, and how much of them a completion fills."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.completion.ledger.entries import TOLERANCE_M, is_there
from benchmarks.completion.scenes.cases import UNSCORED, Case, hypothesis_of
from benchmarks.completion.truth.samples import sample
from completion import CompletionOptions, complete
from completion.boundary.meshing import mesh_cells
from completion.result.completed_model import CompletedModel
from nbv.scanning.effects.effects import NO_EFFECTS
from nbv.scanning.scanner import scan_scene
from scenes.checks import BoolArray, FloatArray
from scenes.rays.raycast import RayCaster
from scenes.scan.colour import unit_colour
from scenes.scan.range_image import RangeImage

_CELL_M = 0.01
_MEASURED = 300  # pixels of a surface, from which on it was measured


@dataclass(frozen=True, slots=True)
class Moats:
    """What came of one case.

    Attributes
    ----------
    case : str
        Its name.
    shadow, shadow_filled : int
        Pixels without return that the projector does not light, of surfaces that were measured elsewhere and
        behind such ones, and those of them whose surface is in the completed model, to 3 cm.
    dark, dark_filled : int
        The same of what is lit, and too dark or clear to return anything.
    silent_m2, right_m2 : (k,) float
        Inferred area with the provenance "no-return" by tenth of confidence, and how much of it is surface.
    picture : (rows, columns, 3) uint8
        The desk's colours, faint; pixels of the shadow that are filled green, others red; filled ones of what
        is dark blue, others black.
    """

    case: str
    shadow: int
    shadow_filled: int
    dark: int
    dark_filled: int
    silent_m2: FloatArray
    right_m2: FloatArray
    picture: NDArray[np.uint8]


_SHOWN = {(True, True): (0, 200, 0), (True, False): (230, 0, 0), (False, True): (0, 114, 220)}


def moats(case: Case, seed: int, options: CompletionOptions) -> Moats:
    """Scan and complete a case, and look at what brought nothing back."""
    (view,) = case.views
    (scan,) = case.scans(view.sensor.effects, seed)
    assert scan.truth is not None
    assert view.sensor.partner is not None
    caster = case.scene.ray_caster()
    lit = scan_scene(case.scene, view, effects=NO_EFFECTS, caster=caster).valid
    completed = complete(scan, options, rng=seed)
    met = ~scan.valid & (scan.truth.ranges <= view.sensor.max_range_m) & (scan.truth.ranges >= 0.5)
    names = case.scene.surface_names
    known = np.bincount(scan.truth.surface[scan.valid], minlength=len(names)) >= _MEASURED
    known &= [name not in UNSCORED for name in names]
    filled = is_filled(completed, scan, scan.truth.ranges, met)
    shadow, dark = met & ~lit, met & lit
    shadow &= known[np.maximum(scan.truth.surface, 0)]
    shadow.ravel()[shadow.ravel()] &= known[_casts_shadow(case, scan, shadow, caster)]
    hypothesis = hypothesis_of(completed, [scan])
    samples = sample(hypothesis, _CELL_M)
    chosen = samples.reason == hypothesis.reasons.index("no-return")
    right = is_there(samples.points[chosen], samples.normals[chosen], caster)
    tenth = np.clip((10 * samples.confidence[chosen]).astype(np.int64), 0, 9)
    areas = samples.areas[chosen]
    return Moats(
        case=case.name,
        shadow=int(shadow.sum()),
        shadow_filled=int((shadow & filled).sum()),
        dark=int(dark.sum()),
        dark_filled=int((dark & filled).sum()),
        silent_m2=np.bincount(tenth, areas, minlength=10).astype(np.float64),
        right_m2=np.bincount(tenth, areas * right, minlength=10).astype(np.float64),
        picture=_picture(scan, shadow, met & lit, filled),
    )


def _picture(scan: RangeImage, shadow: BoolArray, dark: BoolArray, filled: BoolArray) -> NDArray[np.uint8]:
    assert scan.colour is not None
    shown = (unit_colour(scan.colour) * 127 + 128).astype(np.uint8)
    shown[~scan.valid] = 0
    for (is_shadow, is_filled_), colour in _SHOWN.items():
        shown[(shadow if is_shadow else dark) & (filled == is_filled_)] = colour
    return shown


def _casts_shadow(case: Case, scan: RangeImage, shadow: BoolArray, caster: RayCaster) -> NDArray[np.int64]:
    """Surface (n,) that stands between the projector and what each pixel of a shadow sees; or its own."""
    (view,) = case.views
    assert scan.truth is not None
    assert view.sensor.partner is not None
    projector = scan.world_from_sensor.apply(np.array(view.sensor.partner.position_m))
    rays = scan.world_from_sensor.rotate(scan.projection.directions()[shadow])
    way = scan.origin + scan.truth.ranges[shadow][:, None] * rays - projector
    hits = caster.first_hit(projector[None], way / np.linalg.norm(way, axis=1, keepdims=True))
    surface = case.scene.mesh.face_surface[np.maximum(hits.face, 0)]
    return np.where(hits.hit, surface, scan.truth.surface[shadow]).astype(np.int64)


def is_filled(completed: CompletedModel, scan: RangeImage, ranges: FloatArray, among: BoolArray) -> BoolArray:
    """Tell of which pixels the completed model has surface at these `ranges` (rows, columns), to 3 cm."""
    filled = np.zeros(scan.shape, dtype=np.bool_)
    pixel = np.flatnonzero(among)
    rays = completed.observations[0].rays_at(pixel)
    origin = completed.observations[0].scan.origin
    for patch in completed.patches:
        mesh = mesh_cells(patch.grid, patch.observed | patch.hypothesised, (), merged=True)
        if not len(mesh.faces):
            continue
        hits = RayCaster(mesh.vertices, mesh.faces, n_threads=1).first_hit(origin[None], rays)
        met = np.flatnonzero(hits.hit)
        across = np.abs(hits.ranges[met] - ranges.ravel()[pixel[met]]) * hits.incidence_cosine[met]
        filled.ravel()[pixel[met[across <= TOLERANCE_M]]] = True
    return filled
