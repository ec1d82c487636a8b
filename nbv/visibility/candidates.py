# SPDX-License-Identifier: MIT
"""Candidates of a known scene: in its rooms, around it, or of planning instances with their patches."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nbv.scanning.sensor import PinholeSensor, Sensor
from nbv.visibility.floors import FloorColumns
from nbv.visibility.limits import ALMOST_ALL, FINER, LIFT_M, PATCH_TOLERANCE_M, SAME_M, SILL_M
from nbv.visibility.rooms import Rooms
from nbv.visibility.samples import WISHED_SAMPLES, SurfaceSamples, default_spacing, sample_surface
from nbv.visibility.site import Site, find_site
from nbv.visibility.site_options import TRIPOD_HEIGHTS_M, SiteOptions
from nbv.visibility.viewpoints import Candidates, room_lattice, viewing_sphere
from nbv.visibility.zones import EVERYWHERE, Zones
from scenes.checks import FloatArray, InputError, Value
from scenes.rays.raycast import RayCaster
from scenes.world.scene import Scene

APART = ("inside_a_solid", "another_room", "another_storey", "outside")
_OUTSIDE = -1  # the number of the open air


@dataclass(frozen=True, slots=True, eq=False)
class BoundingSurface:
    """Samples of which only those count that bound the rooms asked for; the others stand for no area.

    `reason` (n,) is the index into `APART` of what was set apart, -1 elsewhere; `apart_m2` the area of each.
    """

    samples: SurfaceSamples
    reason: NDArray[np.int8]
    apart_m2: Mapping[str, float]


def bounding_surface(samples: SurfaceSamples, site: Site, caster: RayCaster) -> BoundingSurface:
    """Tell which samples bound the rooms that are asked for.

    A sample bounds the room whose air lies before it, on either side of its face. All free spans that are
    open to a room's floor are its air, those over and under furniture among them.
    """
    sides = _sides(samples, site, caster)
    chosen = np.isin(sides, site.chosen).any(axis=1)
    storey = np.array([0, *(room.storey for room in site.rooms.rooms)])
    outside = np.array([False, *(room.is_outside for room in site.rooms.rooms)])
    asked = np.unique(storey[list(site.chosen)])
    known = np.maximum(sides, 0)
    is_room = (sides > 0) & ~outside[known]
    reason = np.select(
        [
            chosen,
            (is_room & np.isin(storey[known], asked)).any(axis=1),
            is_room.any(axis=1),
            ((sides == _OUTSIDE) | outside[known]).any(axis=1),
        ],
        [-1, 1, 2, 3],
        0,
    ).astype(np.int8)
    areas = {name: float(samples.areas[reason == k].sum()) for k, name in enumerate(APART)}
    counted = replace(samples, areas=np.where(reason < 0, samples.areas, 0.0))
    return BoundingSurface(counted, reason, {name: area for name, area in areas.items() if area > 0})


def room_before(samples: SurfaceSamples, site: Site, caster: RayCaster) -> NDArray[np.int64]:
    """Return the room (n,) among those asked for that each sample bounds, 0 for none.

    Of two it is that before the front of the sample's face.
    """
    front, back = _sides(samples, site, caster).T
    asked_front, asked_back = np.isin(front, site.chosen), np.isin(back, site.chosen)
    return np.where(asked_front, front, np.where(asked_back, back, 0))


def _sides(samples: SurfaceSamples, site: Site, caster: RayCaster) -> NDArray[np.int64]:
    """Room (n, 2) of the air before the front and the back of each sample's face."""
    air = room_of_air(site.rooms, caster)
    columns = site.rooms.floors.columns
    return np.column_stack([_air_before(columns, air, samples, side, caster) for side in (1.0, -1.0)])


def room_of_air(rooms: Rooms, caster: RayCaster) -> NDArray[np.int64]:
    """Room (n,) whose air each span of the columns holds; -1 in the open, 0 within solids."""
    columns = rooms.floors.columns
    indices, other = columns.neighbours()
    height = (
        np.maximum(columns.bottom[indices], columns.bottom[other])
        + np.minimum(np.minimum(columns.top[indices], columns.top[other]), 1e6)
    ) / 2
    high = np.isinf(columns.top[indices]) & np.isinf(columns.top[other])
    height[high] = np.maximum(columns.bottom[indices], columns.bottom[other])[high] + 1.0
    ends = [np.column_stack([columns.places(columns.cell[side]), height]) for side in (indices, other)]
    open_ = ~caster.are_blocked(ends[0], ends[1])
    indices, other = indices[open_], other[open_]
    air = rooms.room.astype(np.int64)
    air[(air == 0) & np.isinf(columns.top)] = _OUTSIDE
    both = np.column_stack([np.concatenate([indices, other]), np.concatenate([other, indices])])
    while True:
        reached = both[(air[both[:, 0]] == 0) & (air[both[:, 1]] != 0)]
        if not len(reached):
            return air
        order = np.lexsort((-air[reached[:, 1]], reached[:, 0]))
        first = np.unique(reached[order, 0], return_index=True)[1]
        chosen = reached[order[first]]
        air[chosen[:, 0]] = air[chosen[:, 1]]


def _air_before(
    columns: FloorColumns, air: NDArray[np.int64], samples: SurfaceSamples, side: float, caster: RayCaster
) -> NDArray[np.int64]:
    """Room (n,) of the air a little off each sample on one side of its face, 0 where there is none.

    It is that of the nearest of the lines around to which nothing stands between.
    """
    places = samples.points + side * LIFT_M * samples.normals
    codes = np.where(columns.cells_of(places[:, :2]) < 0, _OUTSIDE, 0)
    steps = np.stack(np.meshgrid([0, -1, 1], [0, -1, 1], indexing="ij"), axis=-1).reshape(-1, 2)
    for step in steps[np.argsort(np.abs(steps).sum(axis=1), kind="stable")]:
        left = np.flatnonzero(codes <= 0)  # a room's air is looked for beyond the open
        cells = columns.cells_of(places[left, :2] + step * columns.cell_m)
        room = _air_at(columns, air, cells, places[left, 2])
        left, cells, room = left[room != 0], cells[room != 0], room[room != 0]
        line = np.column_stack([columns.places(cells), places[left, 2]])
        open_ = ~caster.are_blocked(places[left], line)
        codes[left[open_]] = room[open_]
    return codes


def _air_at(
    columns: FloorColumns, air: NDArray[np.int64], cells: NDArray[np.int64], heights: FloatArray
) -> NDArray[np.int64]:
    """Room (n,) of the span that holds each height (n,) over a cell (n,): the open below all surfaces."""
    inside = np.flatnonzero(cells >= 0)
    n_spans = np.diff(columns.start)[cells[inside]]
    last = np.append(columns.bottom, 0.0)[columns.start[cells[inside] + 1] - 1]
    lowest = np.where(n_spans > 0, last, np.inf)
    codes = np.full(len(cells), _OUTSIDE)
    codes[inside[heights[inside] > lowest]] = 0
    for k in range(int(np.diff(columns.start).max(initial=0))):
        span = columns.start[cells[inside]] + k
        known = span < columns.start[cells[inside] + 1]
        at, span = inside[known], span[known]
        holds = (columns.bottom[span] < heights[at]) & (columns.top[span] > heights[at])
        codes[at[holds]] = air[span[holds]]
    return codes


@dataclass(frozen=True, slots=True, eq=False)
class Standing(Value):
    """Where a sensor may stand in a scene.

    Attributes
    ----------
    candidates : Candidates
        What "reachable" refers to, and offline planners choose from.
    proposals : Candidates
        What the online planner gets, who finds out himself what is free of it: in rooms a lattice.
    site : Site or None
        The rooms; None around an object.
    """

    candidates: Candidates
    proposals: Candidates
    site: Site | None


def find_standing(
    scene: Scene,
    sensor: Sensor,
    options: SiteOptions = SiteOptions(),
    *,
    mode: str | None = None,
    subdivisions: int = 1,
) -> Standing:
    """Find the candidates of a known scene, each position with the sensor's directions all round.

    Room mode: places on the floor of its rooms (`find_site`), with 42 directions for a camera at 1
    subdivision of the icosahedron, 162 at 2. Object mode: the part of a viewing sphere above the plane that
    the object stands on, or all of it where `options` say so.

    Raises
    ------
    InputError
        Another mode, or nowhere to stand.
    """
    mode = mode or scene.mode
    if mode == "object":
        around = viewing_sphere(scene.mesh.bounds(), sensor, all_round=options.all_round)
        return Standing(around, around, None)
    if mode != "room":
        raise InputError(f"mode must be room or object, got {mode!r}")
    site = find_site(scene, options, turns=sensor.kind == "spherical")
    candidates = site.candidates(sensor, subdivisions)
    return Standing(candidates, Candidates(_lattice(scene, site, options), candidates.directions), site)


def samples_that_count(
    scene: Scene, standing: Standing, caster: RayCaster, zones: Zones = EVERYWHERE
) -> tuple[SurfaceSamples, Mapping[str, float]]:
    """Sample what is to be measured of a scene; return the samples and the area of what is set apart.

    Where much is set apart, or lies off the region, all is sampled more finely, up to `FINER` times, so that
    about as many samples count as in a scene of which all does.

    Raises
    ------
    InputError
        No surface in the region, or none that bounds the rooms.
    """
    spacing = default_spacing(scene.mesh)
    samples, apart = restrict_to_rooms(
        within(sample_surface(scene.mesh, spacing), zones, scene), standing, caster
    )
    share = float(np.count_nonzero(samples.areas)) / WISHED_SAMPLES
    if share > ALMOST_ALL:
        return samples, apart
    finer = sample_surface(scene.mesh, spacing * float(np.sqrt(max(share, 1 / FINER))))
    return restrict_to_rooms(within(finer, zones, scene), standing, caster)


def within(samples: SurfaceSamples, zones: Zones, scene: Scene) -> SurfaceSamples:
    """Return the samples in the region."""
    if zones.region is None:
        return samples
    inside = zones.of_interest(samples.points, SAME_M)
    if not inside.any():
        low, high = scene.mesh.bounds().round(2).tolist()
        raise InputError(
            f"no surface of {scene.name} lies in the region; the scene goes from {low} to {high}, metres"
        )
    return samples.some(inside)


def restrict_to_rooms(
    samples: SurfaceSamples, standing: Standing, caster: RayCaster
) -> tuple[SurfaceSamples, Mapping[str, float]]:
    """Return the samples, of which only those of the rooms asked for have area, and the area of the others.

    Around objects, and for given candidates, all of them count.

    Raises
    ------
    InputError
        Nothing bounds the rooms.
    """
    if standing.site is None:
        return samples, {}
    bounding = bounding_surface(samples, standing.site, caster)
    if not bounding.samples.total_m2 > 0:
        rooms = ", ".join(map(str, standing.site.chosen))
        raise InputError(f"no surface bounds the rooms {rooms}; ask for others (--rooms), or finer samples")
    return bounding.samples, bounding.apart_m2


def scene_candidates(
    scene: Scene,
    sensor: Sensor,
    options: SiteOptions = SiteOptions(),
    *,
    mode: str | None = None,
    subdivisions: int = 1,
) -> Candidates:
    """Return the candidates of a known scene: those of `find_standing`, which says what they are."""
    return find_standing(scene, sensor, options, mode=mode, subdivisions=subdivisions).candidates


def room_candidates(
    scene: Scene, sensor: Sensor, options: SiteOptions = SiteOptions(), *, subdivisions: int = 1
) -> Candidates:
    """Return the candidates in the rooms of a scene: places on their floors, the sensor turned all round.

    `subdivisions` of the icosahedron say how finely a camera's directions lie: 42 for 1, 162 for 2.

    Raises
    ------
    InputError
        Nowhere to stand.
    """
    return find_standing(scene, sensor, options, mode="room", subdivisions=subdivisions).candidates


def sphere_candidates(
    scene: Scene, sensor: Sensor, n_positions: int = 200, *, all_round: bool = False
) -> Candidates:
    """Return the candidates around an object: on a sphere, each looking at its centre.

    The sphere is as small as lets the aperture hold the object, within the sensor's range. Without
    `all_round` those are left out that lie below the plane on which the object stands.

    Raises
    ------
    InputError
        The sensor's range gate does not fit around the object; no positions.
    """
    if n_positions < 1:
        raise InputError(f"n_positions must be at least 1, got {n_positions}")
    return viewing_sphere(scene.mesh.bounds(), sensor, n_positions, all_round=all_round)


def _lattice(scene: Scene, site: Site, options: SiteOptions) -> FloatArray:
    """Positions (p, 3) over the levels of the chosen rooms, free or not, and of no other, metres."""
    levels = np.sort([site.rooms.rooms[number - 1].level_m for number in site.chosen])
    first = np.append(True, np.diff(levels) > SILL_M)
    bounds, parts = scene.mesh.bounds(), []
    for level in levels[first]:
        bounds[0, 2] = level
        lattice = room_lattice(
            bounds,
            spacing_m=site.spacing_m,
            heights_m=options.heights_m or TRIPOD_HEIGHTS_M,
            clearance_m=options.clearance_m,
        )
        parts.append(lattice[site.asked_for(lattice, float(level))])
    return np.vstack(parts)


def patch_samples(scene: Scene, caster: RayCaster, candidates: Candidates) -> SurfaceSamples | None:
    """Return the patches of a planning instance as samples of equal area, None when it has none.

    A patch on the rim of a body counts as seen when the line of sight reaches within 1 cm of it.

    Raises
    ------
    InputError
        Patches that lie more than 1 cm from the scene's surface.
    """
    points, normals = candidates.patch_points, candidates.patch_normals
    if points is None or normals is None:
        return None
    if points.shape != normals.shape or not len(points):
        raise InputError(
            f"{len(points)} patch_points with {len(normals)} patch_normals; give as many of both"
        )
    hits = caster.first_hit(points + normals * PATCH_TOLERANCE_M, -normals)
    off = ~(hits.ranges <= 2 * PATCH_TOLERANCE_M)
    if off.any():
        first: FloatArray = points[int(np.argmax(off))]
        raise InputError(
            f"{int(off.sum())} of {len(points)} patches do not lie on {scene.name} within 1 cm "
            f"(first at {first.round(3).tolist()}); are they of another scene?"
        )
    areas = np.full(len(points), float(scene.mesh.face_areas().sum()) / len(points))
    surface = scene.mesh.face_surface[hits.face]
    return SurfaceSamples(
        points=points,
        normals=normals,
        areas=areas,
        face=hits.face,
        surface=surface,
        tolerance_m=PATCH_TOLERANCE_M,
    )


def with_aperture(sensor: Sensor, candidates: Candidates | None) -> Sensor:
    """Return the sensor, with the conical aperture that the candidates ask for."""
    if candidates is None or candidates.half_angle_deg is None:
        return sensor
    name = f"{sensor.name}, cone of half angle {candidates.half_angle_deg:g} deg"
    pixels = 320
    return PinholeSensor(
        fov_deg=2 * candidates.half_angle_deg,
        width=pixels,
        height=pixels,
        min_range_m=sensor.min_range_m,
        max_range_m=sensor.max_range_m,
        name=name,
        aperture="circular",
        effects=sensor.effects,
    )
