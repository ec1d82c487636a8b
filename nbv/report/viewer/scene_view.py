# SPDX-License-Identifier: MIT
"""3-D view of a known scene: what views measure of it, how well, and what they cannot reach."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from nbv.coverage.coverage import MET, NEVER, REACHABLE, UNREACHABLE, Coverage, VisibilityHistory
from nbv.coverage.surface_classes import INFERRED as CLASS_INFERRED
from nbv.coverage.surface_classes import MET as CLASS_MET
from nbv.coverage.surface_classes import MODELLED as CLASS_MODELLED
from nbv.report.figures import picture
from nbv.report.figures.picture import Picture
from nbv.report.figures.surface_values import FineCoverage, fine_coverage
from nbv.report.viewer.layers import (
    NOTHING,
    Category,
    Classes,
    Colour,
    Layer,
    Lines,
    Marker,
    Numbers,
    Sightings,
    Viewer,
    count_channel,
    incidence_channel,
)
from nbv.visibility.visibility import REASONS
from nbv.visibility.zones import EVERYWHERE, Zones
from scenes.checks import BoolArray, FloatArray
from scenes.mesh.labelled_mesh import Appearance
from scenes.scan.colour import surface_rgb
from scenes.world.scene import Scene

_SAMPLES_A_FACE = 1.0
_NEAR_HULL = 0.02  # of the scene's extent: what encloses it
_AT_FACES_M = 1e-3  # of the region
PALE: Colour = (0.962, 0.856, 0.658)  # of the unknown, laid over white
_OUTSIDE = Category("outside the region", (0.86, 0.86, 0.84))
_REASON_COLOURS = (3, 2, 5, 6, 1, 7, 11)  # numbers in the palette of surfaces


def scene_view(
    scene: Scene,
    coverage: Coverage,
    seen: VisibilityHistory,
    *,
    markers: tuple[Marker, ...] = (),
    lines: tuple[Lines, ...] = (),
    zones: Zones = EVERYWHERE,
    pictures: tuple[Picture, ...] = (),
    cut_m: float | None = None,
) -> Viewer:
    """Return the view of a scene whose coverage is known, by what the views have seen of its samples.

    What lies outside the region of `zones` counts for nothing; `pictures` stand in for the view, which shows
    nothing above `cut_m` (metres) at first.
    """
    fine = fine_coverage(scene.mesh, coverage, _SAMPLES_A_FACE)
    place = np.where(
        zones.of_interest(fine.corners.mean(axis=1), _AT_FACES_M), fine.sample, len(coverage.samples)
    )
    channels, sightings = channels_of(coverage, seen), sightings_of(seen)
    skin = _skin(scene.mesh.appearance, fine)
    layers = []
    for key, label, here in _parts(scene, fine):
        vertices = fine.corners[here].reshape(-1, 3)
        appearance = None if skin is None else skin_of_faces(skin, np.flatnonzero(here))
        shown = (vertices, np.arange(len(vertices)).reshape(-1, 3), _OUTSIDE)
        layers.append(Layer(key, label, *shown, place[here], channels, sightings=sightings, skin=appearance))
    met = seen.met if len(seen.met) > 1 else ()
    sentence, is_room = f"{scene.name}: what the views measure.", scene.mode == "room"
    return Viewer(
        sentence,
        tuple(layers),
        markers=markers,
        lines=lines,
        is_room=is_room,
        met=met,
        pictures=pictures,
        cut_m=cut_m,
    )


def _parts(scene: Scene, fine: FineCoverage) -> list[tuple[str, str, BoolArray]]:
    """What encloses a room apart from what stands in it; an object is one."""
    if scene.mode == "room":
        inner = ~near_hull(fine.corners.mean(axis=1), scene.mesh.vertices)
        if inner.any() and not inner.all():
            return [("enclosure", "walls, floor, ceiling", ~inner), ("occluders", "occluders", inner)]
    return [("surface", "", np.ones(len(fine.corners), np.bool_))]


def near_hull(points: FloatArray, vertices: FloatArray) -> BoolArray:
    """Tell which points (n, 3) lie near the convex hull's boundary of vertices; all where there is none."""
    try:
        sides = ConvexHull(vertices).equations
    except QhullError:
        return np.ones(len(points), np.bool_)
    sides = np.unique(np.round(sides, 9), axis=0)
    depth = np.full(len(points), -np.inf)
    for side in sides:
        depth = np.maximum(depth, points @ side[:3] + side[3])
    return np.asarray(depth >= -_NEAR_HULL * float(np.ptp(vertices, axis=0).max()))


def channels_of(coverage: Coverage, seen: VisibilityHistory) -> tuple[Classes | Numbers, ...]:
    """What is known of each sample, and at the end of a place outside the region."""
    is_seen, absent = coverage.n_views > 0, "seen by no view"
    angle = np.where(is_seen, np.degrees(np.arccos(np.clip(coverage.best_cosine, 0, 1))), np.nan)
    n_views = np.where(is_seen, coverage.n_views, np.nan).astype(np.float64)
    most = max(float(np.nanmax(n_views, initial=1)), 2.0)
    return (
        _state_channel(coverage, seen),
        incidence_channel(np.append(angle, np.nan), absent, coverage.requirement.max_incidence_deg),
        count_channel("Views that see it", np.append(n_views, np.nan), most, absent),
        *_reason_channel(coverage),
        _surface_channel(coverage),
    )


def _state_channel(coverage: Coverage, seen: VisibilityHistory) -> Classes:
    """Measured or not; with completion, the classes."""
    met, unknown = Category("measured as required", picture.MEASURED), picture.UNKNOWN
    first = np.where(seen.first_met == NEVER, 0, seen.first_met)
    categories: tuple[Category, ...]
    if coverage.classes is None:
        categories = (
            Category("out of reach", PALE),
            Category("reachable, not measured", unknown, "hatched"),
            met,
        )
        since = np.where(coverage.state == MET, first, 0)
        return _state(categories, coverage.state, since, REACHABLE)
    categories = (
        met,
        Category("modelled", picture.MODELLED, "dotted"),
        Category("inferred", picture.INFERRED),
        Category("unknown", unknown, "hatched"),
    )
    late = np.isin(coverage.classes, (CLASS_MODELLED, CLASS_INFERRED))
    since = np.where(coverage.classes == CLASS_MET, first, np.where(late, len(seen.met) - 1, 0))
    return _state(categories, coverage.classes, since, len(categories) - 1)


def _state(
    categories: tuple[Category, ...], values: NDArray[np.int8], since: NDArray[np.int64], before: int
) -> Classes:
    kinds = np.append(values.astype(np.uint16), np.uint16(NOTHING))
    return Classes("state", "State", categories, kinds, np.append(since, 0), before=before, can_hide=True)


def _reason_channel(coverage: Coverage) -> tuple[Classes, ...]:
    """Why samples are out of reach; nothing where none is."""
    away = coverage.state == UNREACHABLE
    if not away.any():
        return ()
    reasons = np.unique(coverage.reason[away])
    categories = tuple(
        Category(REASONS[k].replace("_", " "), surface_rgb(_REASON_COLOURS[k])) for k in reasons
    )
    values = np.where(away, np.searchsorted(reasons, coverage.reason), len(reasons))
    categories += (Category("can be reached", (0.80, 0.81, 0.81)),)
    return (Classes("reason", "Why out of reach", categories, _and_nothing(values)),)


def _surface_channel(coverage: Coverage) -> Classes:
    ids, index = np.unique(coverage.samples.surface, return_inverse=True)
    categories = tuple(
        Category(coverage.surface_names[surface], surface_rgb(number))
        for number, surface in enumerate(ids, 1)
    )
    return Classes("surface", "Surface", categories, _and_nothing(index))


def _and_nothing(values: NDArray[np.int64]) -> NDArray[np.uint16]:
    return np.append(values, NOTHING).astype(np.uint16)


def sightings_of(seen: VisibilityHistory) -> Sightings:
    """Return sightings for the view, with a place outside the region at the end."""
    angle = np.degrees(np.arccos(np.clip(seen.cosine, 0, 1)))
    return Sightings(np.append(seen.start, seen.start[-1]), seen.view, angle)


def _skin(look: Appearance | None, fine: FineCoverage) -> Appearance | None:
    """The scene's own colours on the pieces of its faces."""
    if look is None:
        return None
    colour = np.einsum("mij,mjk->mik", fine.weights, look.corner_colour[fine.face])
    if not look.images or look.face_image is None or look.corner_uv is None:
        return Appearance(colour.astype(np.float32))
    uv = np.einsum("mij,mjk->mik", fine.weights, look.corner_uv[fine.face])
    return Appearance(
        colour.astype(np.float32), look.images, look.face_image[fine.face], uv.astype(np.float32)
    )


def skin_of_faces(skin: Appearance, chosen: NDArray[np.int64]) -> Appearance:
    """Return the colours of the `chosen` (m,) faces."""
    return replace(
        skin,
        corner_colour=skin.corner_colour[chosen],
        face_image=None if skin.face_image is None else skin.face_image[chosen],
        corner_uv=None if skin.corner_uv is None else skin.corner_uv[chosen],
    )


def colours_of_views(n: int, highlighted: Sequence[int]) -> list[Colour | None]:
    """The colour of each of `n` views: that of what is inferred for those whose scans were completed."""
    return [picture.INFERRED if k in set(highlighted) else None for k in range(n)]
