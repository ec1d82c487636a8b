# SPDX-License-Identifier: MIT
"""Candidates of a known scene: in its rooms, or around it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from nbv.scanning.sensors.sensor import Sensor
from nbv.visibility.samples import WISHED_SAMPLES, SurfaceSamples, default_spacing, sample_surface
from nbv.visibility.standing.bounding import bounding_surface
from nbv.visibility.standing.site import Site, find_site
from nbv.visibility.standing.site_options import SiteOptions
from nbv.visibility.viewpoints import TRIPOD_HEIGHTS_M, Candidates, room_lattice, viewing_sphere
from nbv.visibility.zones import EVERYWHERE, Zones
from scenes.checks import FloatArray, InputError
from scenes.rays.raycast import RayCaster
from scenes.world.scene import Scene

_SAME_LEVEL_M = 0.1
_ROUNDING_M = 1e-6  # a surface may lie on the region's faces
_ENOUGH, _FINER = 0.9, 4.0  # share of the wished samples that must count; and times as many samples in all


@dataclass(frozen=True, slots=True, eq=False)
class Standing:
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

    Where much is set apart, or lies off the region, all is sampled more finely, up to `_FINER` times, so that
    about as many samples count as in a scene of which all does.

    Raises
    ------
    InputError
        No surface in the region, or none that bounds the rooms.
    """
    spacing = default_spacing(scene.mesh)
    samples, apart = counted(within(sample_surface(scene.mesh, spacing), zones, scene), standing, caster)
    share = float(np.count_nonzero(samples.areas)) / WISHED_SAMPLES
    if share > _ENOUGH:
        return samples, apart
    finer = sample_surface(scene.mesh, spacing * float(np.sqrt(max(share, 1 / _FINER))))
    return counted(within(finer, zones, scene), standing, caster)


def within(samples: SurfaceSamples, zones: Zones, scene: Scene) -> SurfaceSamples:
    """Return the samples in the region."""
    if zones.region is None:
        return samples
    inside = zones.of_interest(samples.points, _ROUNDING_M)
    if not inside.any():
        low, high = scene.mesh.bounds().round(2).tolist()
        raise InputError(
            f"no surface of {scene.name} lies in the region; the scene goes from {low} to {high}, metres"
        )
    return samples.some(inside)


def counted(
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
    first = np.append(True, np.diff(levels) > _SAME_LEVEL_M)
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
