# SPDX-License-Identifier: MIT
"""Openings of one wall on one page: doorways, windows and niches, from the beams that reach for it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from completion.features.engine.template import Given, Status, TemplateFit
from completion.features.openings.decision import Opened, decide, silent_feature
from completion.features.openings.fitting import (
    all_sides,
    fit_recess,
    floor_of,
    height_of,
    is_strip,
    with_unseen,
    with_wall,
)
from completion.features.openings.proposals import WallChart, propose
from completion.features.openings.recess import Recess
from completion.features.openings.sides import Estimate
from completion.features.openings.walls import Floor, Wall, WallBeams, WallFrame, wall_beams
from completion.observe.observation import Observation
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Plane

_FEW = 50  # images that a beam answered for, below which nothing is said
_TOLERANCE = 0.02, 3.0  # metres, and deviations of the range


def image_share(frame: WallFrame, beams: WallBeams, observations: Sequence[Observation]) -> float:
    """Return the share of points behind a wall whose mirror images were measured before it; NaN of too few.

    Each point is reflected in the wall. A beam through its image that ends there agrees; one that goes on
    refutes it, since a mirror would show what stands there; one that ends before says nothing.
    """
    agrees = refutes = 0
    for number in np.unique(beams.scan):
        seen = observations[int(number)]
        of_scan = beams.chosen((beams.scan == number) & np.isfinite(beams.ranges))
        points = seen.points_at(of_scan.pixel)
        into = frame.axes[1]
        images = points - 2 * ((points - frame.origin) @ into)[:, None] * into
        for other in observations:
            said = _said(images, other)
            agrees, refutes = agrees + said[0], refutes + said[1]
    return agrees / (agrees + refutes) if agrees + refutes >= _FEW else np.nan


def _said(images: FloatArray, seen: Observation) -> tuple[int, int]:
    """How many images (n, 3) a scan's beams end at, and how many they go on behind."""
    place = seen.scan.pixels(images)
    rows, columns = seen.scan.shape
    with np.errstate(invalid="ignore"):
        row, column = np.rint(place).T
        inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
    flat = (row[inside] * columns + column[inside]).astype(np.int64)
    away = np.linalg.norm(images[inside] - seen.scan.origin, axis=1)
    measured = seen.scan.ranges.ravel()[flat]
    slack = _TOLERANCE[0] * np.maximum(away, 1.0) + _TOLERANCE[1] * seen.noise.deviation(away)
    back = np.isfinite(measured)
    agrees = back & (np.abs(measured - away) <= slack)
    return int(agrees.sum()), int((back & (measured > away + slack)).sum())


_FEWEST_SILENT, _MOSTLY = 60, 0.5  # beams from which nothing came back, and their share of a rectangle
_BESIDE_M = 0.5  # round what was measured of a wall
_LEAST_WALL_M = 0.4  # of its width and height
SIDEWAYS = 0.26  # of a wall's normal along up: steeper planes have no doors


def find_openings_in(
    wall: Wall,
    observations: Sequence[Observation],
    up: FloatArray,
    floors: Sequence[Floor],
    given: Given,
    *,
    is_assigned: bool = True,
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
    floors : sequence of Floor
        Level planes, of which one may be the floor before the wall; no opening goes on above a second one.
    given : mapping
        What a person knows: "width", "height", "depth", "sill" (above the floor), metres.
    is_assigned : bool
        Whether they say which face each pixel is of: a number for every pixel of every scan.
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
    levels = [height_of(frame, floor.fit) for floor in floors]
    reached = [_meets(frame, floor) for floor in floors]

    # 2. Beams: where each crosses the wall's plane, and whether it stopped before, at, or behind it.
    beams = wall_beams(frame, observations, low, high, wall)

    def closely(rough: Recess) -> WallBeams:
        corners = rough.corners()
        low, high = corners.min(axis=0) - _BESIDE_M, corners.max(axis=0) + _BESIDE_M
        return wall_beams(frame, observations, low, high, wall, among=beams)

    def decided(rough: Recess, every: WallBeams, chart: WallChart, others: Sequence[Recess]) -> TemplateFit:
        near = closely(rough)
        some = near.silent_as_open() if every is not beams else near
        opened = _opened(
            wall, frame, (some, every), rough, observations=observations, given=given, levels=levels
        )
        turned = some.turned(opened.turn)
        bare = [
            side.name
            for side in opened.sides
            if side.is_seen
            and is_strip(turned, opened.recess, side.name, opened.known[side.name], others=others)
        ]
        fit = decide(replace(opened, chart=chart, bare=tuple(bare)), some, observations, given)
        return fit if is_assigned else replace(fit, assignment=np.zeros(0, np.int64))

    # 3. Propose, fit, decide: the rectangles whose beams speak most for no wall, exactly.
    found: list[TemplateFit] = []
    if len(beams):
        chart = WallChart.of(beams)
        proposed = [rough for rough, _ in propose(chart, reached)]
        found = [decided(rough, beams, chart, _without(proposed, rough)) for rough in proposed]
    yield from found

    # 4. Silence: rectangles from which nothing came back may be panes; they are told, and never claimed.
    silent = beams.is_silent
    if silent.sum() < _FEWEST_SILENT:
        return
    as_open = beams.silent_as_open()
    chart = WallChart.of(as_open)
    proposed = [rough for rough, _ in propose(chart, reached)]
    for rough in proposed:
        inside = rough.holds(beams.uv)
        share = float(silent[inside].mean()) if inside.any() else 0.0
        if share > _MOSTLY and not any(_overlaps(fit, frame, rough) for fit in found):
            yield silent_feature(decided(rough, as_open, chart, _without(proposed, rough)), share)


def _without(proposed: Sequence[Recess], rough: Recess) -> list[Recess]:
    return [one for one in proposed if one is not rough]


def _meets(frame: WallFrame, floor: Floor) -> FloatArray:
    """Where points of a floor that lie before a wall, close to it, meet its plane: u and v (n, 2)."""
    local = frame.local(floor.points)
    return np.asarray(local[(local[:, 1] > -_BESIDE_M) & (local[:, 1] < 0)][:, [0, 2]])


def _opened(
    wall: Wall,
    frame: WallFrame,
    near_and_all: tuple[WallBeams, WallBeams],
    rough: Recess,
    *,
    observations: Sequence[Observation],
    given: Given,
    levels: Sequence[Estimate],
) -> Opened:
    """A proposed rectangle fitted by the beams near it, with what supports each of its sides."""
    beams, every = near_and_all
    # a. Fit: sides, depth and turn, each by its posterior with the others as they are.
    recess, known, turn = fit_recess(beams, rough, given, levels)
    turned = beams.turned(turn)
    known = with_wall(turned, recess, known, wall, frame.turned(turn))
    floor = None if (level := floor_of(recess, levels)) is None else level.value

    # b. Support: tiles along each side, which confirm or contradict it.
    sides = all_sides(turned, recess, known, floor)
    recess, sides, slack = with_unseen(turned, recess, sides, given, farther=every.turned(turn))
    return Opened(
        frame=frame.turned(turn),
        turn=turn,
        recess=recess,
        known=known,
        sides=sides,
        floor=floor,
        lowest=min((level.value for level in levels if np.isfinite(level.value)), default=np.nan),
        image_share=lambda: image_share(frame, turned.chosen(recess.holds(turned.uv)), observations),
        wall=wall,
        slack=slack,
        bare=(),
        chart=None,
    )


def _overlaps(fit: TemplateFit, frame: WallFrame, rough: Recess) -> bool:
    """Whether the middle of a rectangle lies in an opening that was found."""
    corners = frame.local(np.asarray(fit.geometry["corners"]))[:, [0, 2]]
    middle = rough.corners().mean(axis=0)
    inside = (middle > corners.min(axis=0)).all() and (middle < corners.max(axis=0)).all()
    return bool(inside) and fit.status is not Status.NONE
