# SPDX-License-Identifier: MIT
"""Room on one page: which way is up, and the floors, ceilings and walls that scans show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from completion.merging.scan_surfaces import ScanSurfaces, SurfaceOptions, find_surfaces
from completion.room.coplanar import join_coplanar
from completion.room.planes import RoomPlane
from completion.room.up import find_up
from scenes.inclination import Up
from scenes.pose import Pose
from scenes.run.journal import NO_JOURNAL
from scenes.run.steps import Steps
from scenes.scan.range_image import RangeImage


def find_room(
    scan_surfaces: ScanSurfaces, world_from_reference: Pose, stated: Up | None = None, *, across: bool = True
) -> tuple[Up, ScanSurfaces]:
    """Return which way is up in the world, and the surfaces, of which pieces of one wall or floor are one.

    Parameters
    ----------
    scan_surfaces : ScanSurfaces
        The surfaces that scans show, working frame.
    world_from_reference : Pose
        From the working frame to the world.
    stated : Up, optional
        Which way is up, where a person says it.
    across : bool
        Whether pieces may be joined across what stood before them.
    """
    observations, flatness_m = scan_surfaces.observations, scan_surfaces.tolerance.flatness_m
    planes = [RoomPlane.of(surface, observations, flatness_m) for surface in scan_surfaces.surfaces]

    # 1. Up: by the planes, and by how sensors are held.
    up = stated or find_up(planes, observations, world_from_reference)

    # 2. Join: pieces that lie in one plane, as well as they are known.
    if not across:
        return up, scan_surfaces
    here = up.within(world_from_reference)
    joined = join_coplanar(scan_surfaces.surfaces, planes, observations, flatness_m, here)
    return up, replace(scan_surfaces, surfaces=tuple(joined))


def estimate_up(scans: Sequence[RangeImage], *, n_threads: int | None = None) -> Up:
    """Estimate which way is up in the world of scans, by their surfaces and how sensors are held."""
    with Steps.over([scan.ranges.size for scan in scans], n_threads, None, NO_JOURNAL) as steps:
        surfaces = find_surfaces(scans, SurfaceOptions(), steps)
        return find_room(surfaces, scans[0].world_from_sensor, across=False)[0]
