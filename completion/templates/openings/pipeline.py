# SPDX-License-Identifier: MIT
"""Openings of one wall on one page: doorways, windows and niches, from the beams that reach for it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from completion.fitting.result import SurfaceFit
from completion.observe.observation import Observation
from completion.templates.engine.template import Given, TemplateFit
from completion.templates.openings.decision import Opened, decide
from completion.templates.openings.fitting import fit_recess, floor_of, height_of, with_unseen, with_wall
from completion.templates.openings.mirror import image_share
from completion.templates.openings.walls.proposals import WallChart, propose
from completion.templates.openings.walls.support import all_sides
from completion.templates.openings.walls.wall import Wall
from completion.templates.openings.walls.wall_beams import WallFrame, wall_beams
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Plane

_BESIDE_M = 0.5  # round what was measured of a wall
_LEAST_WALL_M = 0.4  # of its width and height
SIDEWAYS = 0.26  # of a wall's normal along up: steeper planes have no doors


def find_openings_in(
    wall: Wall,
    observations: Sequence[Observation],
    up: FloatArray,
    floors: Sequence[SurfaceFit],
    given: Given,
) -> Iterator[TemplateFit]:
    """Yield the openings that are proposed in a wall, accepted or refused, the most probable first.

    Parameters
    ----------
    wall : Wall
        The plane.
    observations : sequence of Observation
        All scans, in one frame.
    up : (3,) float
        What is up in that frame.
    floors : sequence of SurfaceFit
        Level planes, of which one may be the floor before the wall.
    given : mapping
        What a person knows: "width", "height", "depth", "sill" (above the floor), metres.
    """
    # 1. Frame: u to the right as seen from the room, v up, y into the wall.
    plane = wall.fit.surface
    if not isinstance(plane, Plane) or abs(float(plane.normal_direction @ up)) > SIDEWAYS:
        return
    before = np.mean([seen.scan.origin for seen in observations], axis=0)
    frame = WallFrame.of(plane, before, up)
    local = frame.local(wall.points)[:, [0, 2]]
    if np.ptp(local, axis=0).min() < _LEAST_WALL_M:
        return
    low, high = local.min(axis=0) - _BESIDE_M, local.max(axis=0) + _BESIDE_M
    levels = [height_of(frame, floor) for floor in floors]

    # 2. Beams: where each crosses the wall's plane, and whether it stopped before, at, or behind it.
    beams = wall_beams(frame, observations, low, high, wall)

    # 3. Propose: the rectangles whose beams speak most for no wall, exactly.
    chart = WallChart.of(beams) if len(beams) else None
    for rough, _ in propose(chart):
        # 4. Fit: sides, depth and turn, each by its posterior with the others as they are.
        recess, known, turn = fit_recess(beams, rough, given, levels)
        turned = beams.turned(turn)
        known = with_wall(turned, recess, known, wall, frame.turned(turn))
        floor = None if (level := floor_of(recess, levels)) is None else level.value

        # 5. Support: tiles along each side, which confirm or contradict it.
        sides = all_sides(turned, recess, known, floor)
        recess, sides, slack = with_unseen(turned, recess, sides, given)
        share = image_share(frame, turned.chosen(recess.holds(turned.uv)), observations)

        # 6. Decide: found, ambiguous, or none, and why.
        opened = Opened(
            frame=frame.turned(turn),
            recess=recess,
            known=known,
            sides=sides,
            floor=floor,
            image_share=share,
            wall=wall,
            slack=slack,
            chart=chart,
        )
        yield decide(opened, turned, observations, given)
