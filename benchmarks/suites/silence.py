# SPDX-License-Identifier: MIT
"""Pixels without return before a simulated Kinect: shadows, dark and clear things, and what fills them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from benchmarks.cases.desks import desk_case
from benchmarks.cases.rooms import UNSCORED, Case, hypothesis_of
from benchmarks.metrics.inferred import sample
from benchmarks.metrics.other_scans import TOLERANCE_M, is_there
from benchmarks.run import suite
from benchmarks.store import each
from completion import CompletionOptions, Patch, complete
from completion.boundary.meshing import mesh_cells
from completion.evidence.evidence import Label
from completion.extension.confidence import TRUST, estimate, judged_parts
from completion.extension.limits import ENCLOSED, MOSTLY
from completion.result.completed_model import CompletedModel
from nbv.scanning.effects import NO_EFFECTS
from nbv.scanning.scanner import scan_scene
from scenes.checks import BoolArray, FloatArray
from scenes.rays.raycast import RayCaster
from scenes.scan.range_image import RangeImage

_CELL_M = 0.01
_MEASURED = 300  # pixels of a surface, from which on it was measured


@dataclass(frozen=True, slots=True)
class Moats:
    """What came of one case.

    `shadow`, `shadow_filled`: pixels without return that the projector does not light, of surfaces that were
    measured elsewhere and behind such ones, and those of them whose surface is in the completed model, to 3
    cm. `dark`, `dark_filled`: the same of what is lit, and too dark or clear to return anything. `silent_m2`,
    `right_m2` (k,) float: inferred area with the provenance "no-return" by tenth of confidence, and how much
    of it is surface.
    """

    case: str  # its name
    shadow: int
    shadow_filled: int
    dark: int
    dark_filled: int
    silent_m2: FloatArray
    right_m2: FloatArray


def moats(seed: int) -> Moats:
    """Scan and complete a case, and look at what brought nothing back."""
    case = desk_case(seed)
    (view,) = case.views
    (scan,) = case.scans(view.sensor.effects, seed)
    assert scan.truth is not None
    assert view.sensor.partner is not None
    caster = case.scene.ray_caster()
    lit = scan_scene(case.scene, view, effects=NO_EFFECTS, caster=caster).valid
    completed = complete(scan, CompletionOptions(texture=False), rng=seed)
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
    )


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


_MOST_CELLS = 300  # of a part that are looked at
_PROBABLE = 0.5  # that the surface goes on there at all
_PRIOR = 3e-3  # of a mean log likelihood, what a change of a constant by one logarithmic unit has to be worth


class Part(NamedTuple):
    """A silent part of some desk, and how much of it is surface."""

    seed: int
    is_unlit: bool
    is_wall: bool
    width: float  # half of it, metres or in units of the root of the surface's measured area
    goes_on: float  # probability that the surface goes on there
    area_m2: float
    right: float  # share


def parts_of(seed: int) -> list[Part]:
    """Complete a desk and compare its silent parts with the truth."""
    case = desk_case(seed)
    (view,) = case.views
    caster = case.scene.ray_caster()
    completed = complete(case.scans(view.sensor.effects, seed), CompletionOptions(texture=False), rng=seed)
    world, found = completed.world_from_reference, []
    for patch in completed.patches:
        hidden, evidence, is_wall = patch.shadows.region >= 0, patch.evidence, patch.limits.encloses
        room = completed.completed.room
        goes_on = estimate(
            patch.grid, patch.shadows, patch.labelling, patch.limits, evidence, room=room
        ).ravel()
        filled, unit = _occluded(patch), 1.0 if is_wall else max(float(np.sqrt(patch.observed_m2)), 1e-6)
        centres = patch.grid.centres()
        for part, _ in judged_parts(
            patch.grid, evidence, hidden, filled, within=patch.is_within, is_wall=is_wall
        ):
            is_unlit = bool(evidence.labels.ravel()[part.cells[0]] == Label.UNLIT)
            sure = float(goes_on[part.cells].mean())
            if sure < _PROBABLE or part.enclosed < (MOSTLY if is_unlit and is_wall else ENCLOSED):
                continue
            points = centres[part.cells[:: -(-len(part.cells) // _MOST_CELLS)]]
            right = is_there(
                world.apply(points), world.rotate(patch.grid.surface.normal(points)), caster
            ).mean()
            area = len(part.cells) * patch.grid.cell_area
            found.append(Part(seed, is_unlit, is_wall, part.half_width_m / unit, sure, area, float(right)))
    return found


def most_likely(parts: Sequence[Part]) -> FloatArray:
    """The constants (2, 2, 2) that make the parts most likely, parts weighted by the root of their area."""
    result = TRUST.copy()
    for is_unlit in (False, True):
        for is_wall in (True, False):
            some = [one for one in parts if (one.is_unlit, one.is_wall) == (is_unlit, is_wall)]
            if some:
                result[int(is_unlit), int(not is_wall)] = _fit(some, TRUST[int(is_unlit), int(not is_wall)])
    return result


def _fit(parts: Sequence[Part], used: FloatArray) -> FloatArray:
    width, goes_on, area, right = np.array([one[3:] for one in parts]).T
    start = np.array([np.log(used[0] / (1 - used[0])), np.log(used[1])])

    def cost(x: FloatArray) -> float:
        told = goes_on / (1 + np.exp(-x[0])) * np.exp(-((width / np.exp(x[1])) ** 2))
        told = np.clip(told, 0.003, 0.997)
        likely = right * np.log(told) + (1 - right) * np.log(1 - told)
        return -float(np.average(likely, weights=np.sqrt(area))) + _PRIOR * float(np.square(x - start).sum())

    x = minimize(cost, start, method="Nelder-Mead").x
    return np.array([1 / (1 + np.exp(-x[0])), np.exp(x[1])])


def _occluded(patch: Patch) -> BoolArray:
    """Inferred cells (rows, columns) that something stood before."""
    return np.asarray(patch.hypothesised & (patch.evidence.labels == Label.OCCLUDED), dtype=np.bool_)


HELD_OUT = 2000  # first seed of the desks that nothing is tuned on; constants come from 1000 on


@suite("silence", smallest="--desks 1")
def silence(first: int = HELD_OUT, desks: int = 24, fit: bool = False) -> Iterator[str]:
    """Pixels without return of simulated desks before a Kinect: shadows, dark and clear things.

    --fit: the most likely constants of `completion.extension.confidence.TRUST` instead, beside those in use.
    """
    seeds = range(first, first + desks)
    if fit:
        parts = [part for result in each(parts_of, seeds) for part in result]
        yield f"in use\n{TRUST}\nmost likely on {desks} desks from {first}\n{most_likely(parts).round(3)}"
        return
    found = []
    for result in each(moats, seeds):
        found.append(result)
        yield _line(result.case, [result])
    yield _line("all", found)
    area, right = (sum(getattr(result, name) for result in found) for name in ("silent_m2", "right_m2"))
    for tenth in np.flatnonzero(area):
        yield f"confidence {tenth / 10:.1f}: {area[tenth]:.2f} m2, {right[tenth] / area[tenth]:.3f} right"


def _line(name: str, found: list[Moats]) -> str:
    shadow, dark = sum(one.shadow for one in found), sum(one.dark for one in found)
    area, right = (sum(float(getattr(one, key).sum()) for one in found) for key in ("silent_m2", "right_m2"))
    lit = sum(one.shadow_filled for one in found) / max(shadow, 1)
    closed = sum(one.dark_filled for one in found) / max(dark, 1)
    return (
        f"{name}: moats {shadow} pixels, {lit:.3f} filled; dark or clear {dark}, {closed:.3f} filled; "
        f"no-return {area:.2f} m2, {right / area if area else float('nan'):.3f} right"
    )
