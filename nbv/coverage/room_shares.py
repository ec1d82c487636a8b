# SPDX-License-Identifier: MIT
"""Room shares: what a coverage met of the surface that bounds each room, with standard errors."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from nbv.coverage.coverage import MET, UNREACHABLE, Coverage
from nbv.coverage.share_error import share_error
from nbv.visibility.standing.candidates import room_before
from nbv.visibility.standing.site import Site
from scenes.rays.raycast import RayCaster


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
    samples, found = coverage.samples, []
    counts = samples.areas > 0
    of = np.zeros(len(samples), np.int64)
    of[counts] = room_before(samples.some(counts), site, caster)
    met, reachable = coverage.state == MET, coverage.state != UNREACHABLE
    for number in site.chosen:
        here = of == number
        area = float(samples.areas[here].sum())
        shares = [float(samples.areas[here & part].sum()) / max(area, 1e-12) for part in (met, reachable)]
        errors = [share_error(samples, part, here) for part in (met, reachable)]
        found.append(
            RoomShare(
                room=number,
                surface_m2=area,
                met=shares[0],
                met_standard_error=errors[0],
                reachable=shares[1],
                reachable_standard_error=errors[1],
            )
        )
    return tuple(found)
