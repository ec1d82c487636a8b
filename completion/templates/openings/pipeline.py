# SPDX-License-Identifier: MIT
"""Openings of one wall on one page: doorways, windows and niches, from the beams that reach for it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from completion.fitting.result import SurfaceFit
from completion.observe.observation import Observation
from completion.templates.openings.decision import DOOR_M, Opened, decide
from completion.templates.openings.mirror import image_share
from completion.templates.openings.proposals import CELL_M, propose
from completion.templates.openings.recess import SIDES, Recess
from completion.templates.openings.sides import (
    Estimate,
    fit_depth,
    fit_side,
    fit_turn,
    near_side,
    open_limits,
)
from completion.templates.openings.support import all_sides
from completion.templates.openings.wall import Wall
from completion.templates.openings.wall_beams import WallBeams, WallFrame, wall_beams
from completion.templates.template import Given, Seen, Side, TemplateFit
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Plane

_BESIDE_M = 0.5  # round what was measured of a wall
_ROUNDS = 2
_FLOOR_M = 0.15  # between an opening's foot and the floor that it stands on
_OPPOSITE = {"left": "right", "right": "left", "bottom": "top", "top": "bottom"}
_SIZE = {"left": "width", "right": "width", "bottom": "height", "top": "height"}
_SIDEWAYS = 0.26  # of a wall's normal along up: steeper planes have no doors


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
    if not isinstance(plane, Plane) or abs(float(plane.normal_direction @ up)) > _SIDEWAYS:
        return
    before = np.mean([seen.scan.origin for seen in observations], axis=0)
    frame = WallFrame.of(plane, before, up)
    local = frame.local(wall.points)[:, [0, 2]]
    low, high = local.min(axis=0) - _BESIDE_M, local.max(axis=0) + _BESIDE_M
    levels = [_height(frame, floor) for floor in floors]

    # 2. Beams: where each crosses the wall's plane, and whether it stopped before, at, or behind it.
    beams = wall_beams(frame, observations, low, high, wall)

    # 3. Propose: the rectangles whose beams speak most for no wall, exactly.
    for rough, _ in propose(beams):
        # 4. Fit: sides, depth and turn, each by its posterior with the others as they are.
        recess, known, turn = _fitted(beams, rough, given, levels)
        turned = beams.turned(turn)
        known = _with_wall(turned, recess, known, wall, frame.turned(turn))
        floor = None if (level := _floor_of(recess, levels)) is None else level.value

        # 5. Support: tiles along each side, which confirm or contradict it.
        sides = all_sides(turned, recess, known, floor)
        recess, sides, slack = _with_unseen(turned, recess, sides, given)
        share = image_share(frame, turned.chosen(recess.holds(turned.uv)), observations)

        # 6. Decide: found, ambiguous, or none, and why.
        opened = Opened(frame.turned(turn), recess, known, sides, floor, share, wall, slack)
        yield decide(opened, turned, observations, given)


def _fitted(
    beams: WallBeams, rough: Recess, given: Given, levels: Sequence[Estimate]
) -> tuple[Recess, dict[str, Estimate], float]:
    """The recess at its most probable, how well its parameters are known, and its turn in the wall."""
    floor, reach = _floor_of(rough, levels), 2 * CELL_M
    recess = rough if floor is None else rough.moved("bottom", floor.value)
    known = {"bottom": floor or Estimate(rough.bottom, np.inf)}
    sides = [side for side in SIDES if side != "bottom" or floor is None]
    for side in sides:
        known[side] = fit_side(beams, recess, side, reach)
        recess = recess.moved(side, known[side].value)
    turn, recess = fit_turn(beams, recess, reach)
    beams = beams.turned(turn.value)
    for _ in range(_ROUNDS):
        recess, known["depth"], odds = fit_depth(beams, recess, given.get("depth"))
        for side in sides:
            known[side] = fit_side(beams, recess, side, reach / 2)
            recess = recess.moved(side, known[side].value)
    known |= {"closed": Estimate(odds, 0.0), "turn": turn}
    return recess, known, turn.value


def _with_unseen(
    beams: WallBeams, recess: Recess, sides: tuple[Side, ...], given: Given
) -> tuple[Recess, tuple[Side, ...], dict[str, tuple[float, float]]]:
    """The recess with sides that nobody saw where beams still went through, as uncertain as that leaves them.

    Of a width or height that is given, a side that was seen says where the other one is. How far inwards and
    outwards each side may be off comes with it.
    """
    seen, slack = {side.name: side for side in sides}, {side.name: (0.0, 0.0) for side in sides}
    for side in sides:
        if side.state is not Seen.UNSEEN:
            continue
        opposite, size = _OPPOSITE[side.name], given.get(_SIZE[side.name])
        if size is not None and seen[opposite].is_seen:
            sign = 1.0 if side.name in ("right", "top") else -1.0
            recess = recess.moved(side.name, getattr(recess, opposite) + sign * size)
            seen[side.name] = replace(side, deviation=seen[opposite].deviation)
            continue
        inner, outer = open_limits(beams, recess, side.name)
        recess, slack[side.name] = recess.moved(side.name, inner), (0.0, abs(outer - inner))
        seen[side.name] = replace(side, deviation=float(abs(outer - inner) / np.sqrt(3.0)))
    return recess, tuple(seen.values()), slack


def _with_wall(
    beams: WallBeams, recess: Recess, known: dict[str, Estimate], wall: Wall, frame: WallFrame
) -> dict[str, Estimate]:
    """What is known of the sides, with what the errors of the wall's plane and of the turn add to it."""
    out, centre = dict(known), recess.corners().mean(axis=0)
    for side in SIDES:
        axis = 0 if side in ("left", "right") else 1
        near = near_side(beams, recess, side, CELL_M)
        if not near.any() or not np.isfinite(known[side].deviation):
            continue
        place = np.where(np.arange(2) == axis, getattr(recess, side), centre)
        off = wall.fit.standard_deviation(frame.points(place[None]))[0]
        by_wall = float(off * np.median(np.abs(beams.slope[near, axis])))
        by_turn = known["turn"].deviation * recess.size[1 - axis] / np.sqrt(12)
        sd = float(np.sqrt(known[side].deviation ** 2 + by_wall**2 + by_turn**2))
        out[side] = Estimate(known[side].value, sd)
    return out


def _height(frame: WallFrame, fit: SurfaceFit) -> Estimate:
    """Height in the wall's frame at which a level plane meets the wall."""
    floor = fit.surface
    normal = frame.axes @ floor.normal(frame.origin[None])[0]
    if abs(normal[2]) < 0.5:
        return Estimate(np.inf, np.inf)
    off = float(floor.distance(frame.origin[None])[0])
    sd = float(fit.standard_deviation(frame.origin[None])[0])
    return Estimate(-off / normal[2], sd)


def _floor_of(recess: Recess, levels: Sequence[Estimate]) -> Estimate | None:
    """The level that an opening stands on, None for none: what is lower than people stands on none."""
    if recess.size[1] < DOOR_M:
        return None
    near = [level for level in levels if abs(level.value - recess.bottom) <= _FLOOR_M]
    return min(near, key=lambda level: abs(level.value - recess.bottom), default=None)
