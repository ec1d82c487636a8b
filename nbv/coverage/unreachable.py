# SPDX-License-Identifier: MIT
"""Unreachable patches: connected parts of a surface that no candidate can measure, each with the reason."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from nbv.coverage.coverage import MET, UNREACHABLE, Coverage, share_error
from nbv.visibility.candidates import room_before
from nbv.visibility.limits import NEAR_SPACINGS
from nbv.visibility.site import Site
from nbv.visibility.visibility import REASONS, Reason
from scenes.checks import FloatArray
from scenes.rays.raycast import RayCaster


@dataclass(frozen=True, slots=True, eq=False)
class UnreachablePatch:
    """A connected part of one surface that is out of reach for one reason.

    `reason` is one of `nbv.visibility.visibility.REASONS`, `centre` (3,) the mean of its samples, metres,
    world coordinates.
    """

    surface: int
    name: str
    reason: Reason
    area_m2: float
    centre: FloatArray

    def to_json(self) -> dict[str, Any]:
        """Return the entry of `coverage.json`."""
        return {
            "surface": self.surface,
            "name": self.name,
            "reason": self.reason,
            "area_m2": self.area_m2,
            "centre": [float(c) for c in self.centre],
        }


def unreachable_patches(coverage: Coverage) -> tuple[UnreachablePatch, ...]:
    """Return the unreachable patches of a scene, the largest first.

    Samples form a patch that lie on one surface, within two spacings, out of reach for the same reason.
    """
    samples = coverage.samples
    away = np.flatnonzero(coverage.state == UNREACHABLE)
    patches = []
    for surface, reason in sorted(set(zip(samples.surface[away], coverage.reason[away], strict=True))):
        here = away[(samples.surface[away] == surface) & (coverage.reason[away] == reason)]
        for part in _connected_groups(samples.points[here], float(np.sqrt(samples.areas[here].max()))):
            members = here[part]
            area = float(samples.areas[members].sum())
            centre = samples.points[members].mean(axis=0)
            name = coverage.surface_names[surface]
            patches.append(UnreachablePatch(int(surface), name, REASONS[reason], area, centre))
    return tuple(sorted(patches, key=lambda patch: -patch.area_m2))


def _connected_groups(points: FloatArray, spacing: float) -> list[NDArray[np.int64]]:
    """Return the groups of points (n, 3) that are connected by steps of two spacings or less."""
    pairs = cKDTree(points).query_pairs(NEAR_SPACINGS * spacing, output_type="ndarray")
    linked = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(points),) * 2)
    n_groups, group = connected_components(linked, directed=False)
    return [np.flatnonzero(group == k) for k in range(n_groups)]


def coverage_record(coverage: Coverage) -> dict[str, Any]:
    """Return `coverage.json`: fractions of area, and each patch out of reach with its reason."""
    patches = [patch.to_json() for patch in unreachable_patches(coverage)]
    return {**coverage.to_json(), "unreachable_patches": patches}


@dataclass(frozen=True, slots=True)
class RoomShare:
    """One room's surface, square metres, and the shares of it that are met and can be reached.

    The errors are standard errors of the shares, from the samples.
    """

    room: int
    surface_m2: float
    met: float
    met_standard_error: float
    reachable: float
    reachable_standard_error: float

    def to_json(self) -> dict[str, Any]:
        """Return what `plan.json` adds to the room's entry."""
        return {name: value for name, value in asdict(self).items() if name != "room"}


def room_shares(coverage: Coverage, site: Site, caster: RayCaster) -> tuple[RoomShare, ...]:
    """Return the share of each room that is asked for; their areas add up to that of all.

    What bounds two rooms, as a wall without thickness does, counts in that before the front of its face.
    """
    samples, room_share = coverage.samples, []
    counts = samples.areas > 0
    of = np.zeros(len(samples), np.int64)
    of[counts] = room_before(samples.some(counts), site, caster)
    met, reachable = coverage.state == MET, coverage.state != UNREACHABLE
    for number in site.chosen:
        here = of == number
        area = float(samples.areas[here].sum())
        shares = [float(samples.areas[here & part].sum()) / max(area, 1e-12) for part in (met, reachable)]
        errors = [share_error(samples, part, here) for part in (met, reachable)]
        room_share.append(
            RoomShare(
                room=number,
                surface_m2=area,
                met=shares[0],
                met_standard_error=errors[0],
                reachable=shares[1],
                reachable_standard_error=errors[1],
            )
        )
    return tuple(room_share)
