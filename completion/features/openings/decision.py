# SPDX-License-Identifier: MIT
"""Decision: the most probable recess, whether it is an opening, of which kind, and what of it nobody saw.

The null: how often a room whose wall has no opening shows one as good.
Measured by `python -m benchmarks run nulls --first 4000 --seeds 12 --tail` on simulated walls that are
plain, end, bear pictures or mirrors, lost a patch, or have cupboards, wardrobes, a table or shelves before
them, each scanned once, with boxes, 5 mm of noise and 1 % of strays.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import bdtrc

from completion.features.engine.template import FeatureSide, FeatureStatus, Given, TemplateFit
from completion.features.openings import limits
from completion.features.openings.recess import (
    FACES,
    SIDES,
    Recess,
    SideEstimate,
    expect,
    fit_depth,
    fit_side,
    fit_turn,
    near_side,
    open_limits,
)
from completion.features.openings.rectangles import WallChart
from completion.features.openings.walls import Wall, WallBeams, WallFrame
from completion.fitting.result import SurfaceFit
from completion.observe.observation import Observation
from scenes.checks import FloatArray, IntArray

LEVELS = (-np.inf, 0.0, 8.0, 16.0, 32.0, 64.0, 128.0, 256.0)
"""Nats of evidence."""

N_WALLS = 108
WALLS_AS_GOOD: dict[FeatureStatus, tuple[int, ...]] = {
    FeatureStatus.FOUND: (2, 2, 2, 2, 2, 1, 1, 0),
    FeatureStatus.AMBIGUOUS: (25, 25, 25, 25, 25, 25, 11, 2),
    FeatureStatus.NONE: (66, 47, 42, 41, 39, 35, 25, 25),
}
"""Of each status: on how many walls one came as far with that evidence, or farther."""

_ORDER = (FeatureStatus.NONE, FeatureStatus.AMBIGUOUS, FeatureStatus.FOUND)


def rank(status: FeatureStatus, evidence: float) -> tuple[int, float]:
    """Return by what fits are ordered: how far the rules let them come, then their evidence, nats."""
    return _ORDER.index(status), evidence


def false_fit_probability(status: FeatureStatus, evidence: float) -> float:
    """Return how probably a wall without an opening shows one that comes as far, and is as evident, or more.

    A share of the walls that were simulated, at the tabled evidence below; never less than one of them.
    """
    level = max(int(np.searchsorted(LEVELS, evidence, side="right")) - 1, 0)
    return max(WALLS_AS_GOOD[status][level], 1) / N_WALLS


NAMES = ("u", "sill", "width", "height", "depth")


@dataclass(frozen=True, slots=True, eq=False)
class FittedRecess:
    """A recess as it was fitted, what speaks for it, and how far in and out each side may be off.

    `floor` is the level that it stands on, `lowest` the lowest level that was measured, NaN for none; `bare`
    are the seen sides that a mere strip bounds.
    """

    frame: WallFrame
    turn: float
    recess: Recess
    known: dict[str, SideEstimate]
    sides: tuple[FeatureSide, ...]
    floor: float | None
    lowest: float
    image_share: Callable[[], float]
    wall: Wall
    slack: Mapping[str, tuple[float, float]]
    bare: tuple[str, ...]
    chart: WallChart | None


def decide(
    opened: FittedRecess, beams: WallBeams, observations: Sequence[Observation], given: Given
) -> TemplateFit:
    """Return the opening as a feature, found, ambiguous or refused, with the reason in one sentence."""
    assignment, on_reveals = _assign_faces(opened.recess, beams.turn(opened.turn), observations)
    kind, reason, status = _judge_opening(opened, on_reveals)
    x, covariance = _parameters(opened)
    recess, depth = opened.recess, opened.known["depth"]
    held = tuple(name for name in NAMES if name in given)
    for name in held:
        covariance[NAMES.index(name)] = covariance[:, NAMES.index(name)] = 0.0
    confirmed = sum(side.confirmed for side in opened.sides)
    contradicted = sum(side.contradicted for side in opened.sides)
    evidence = limits.TILE_NATS * (confirmed - contradicted)
    return TemplateFit(
        kind=kind,
        status=status,
        names=NAMES,
        x=x,
        covariance=covariance,
        sides=opened.sides,
        evidence=evidence,
        false_fit_probability=false_fit_probability(status, evidence),
        faces=FACES,
        assignment=assignment,
        reason=reason,
        geometry={
            "corners": opened.frame.points(recess.corners()),
            "depth_m": depth.value,
            "depth_sd_m": depth.deviation,
            "is_closed": recess.is_closed,
            "into": opened.frame.axes[1],
            "surface": opened.wall.number,
            "slack": opened.slack,
        },
        held=held,
    )


def silent_feature(fit: TemplateFit, share: float) -> TemplateFit:
    """Return a rectangle from which nothing came back, a `share` of its beams: never more than ambiguous."""
    if fit.status is FeatureStatus.NONE:
        return fit
    sentence = f"nothing came back from {share:.0%} of it: a window, a mirror or something dark"
    x, covariance, depth = fit.x.copy(), fit.covariance.copy(), NAMES.index("depth")
    x[depth], covariance[depth, depth] = np.nan, np.inf
    geometry = {**fit.geometry, "depth_m": np.nan, "depth_sd_m": np.inf}
    none = np.zeros_like(fit.assignment)
    unknown = replace(fit, x=x, covariance=covariance, geometry=geometry, assignment=none)
    chance = false_fit_probability(FeatureStatus.AMBIGUOUS, fit.evidence)
    return replace(unknown, status=FeatureStatus.AMBIGUOUS, reason=sentence, false_fit_probability=chance)


def _judge_opening(opened: FittedRecess, on_reveals: int) -> tuple[str, str, FeatureStatus]:
    """Kind, reason and status."""
    kind, doubt = _kind(opened)
    width, height = opened.recess.size
    seen = [side.name for side in opened.sides if side.is_seen]
    is_narrow = width < limits.LEAST_SIDE_M and {"left", "right"} <= set(seen)
    if is_narrow or (height < limits.LEAST_SIDE_M and {"bottom", "top"} <= set(seen)):
        return kind, f"it is {1000 * width:.0f} mm by {1000 * height:.0f} mm: too small", FeatureStatus.NONE
    has_floor = opened.floor is not None
    for side in [
        *refuted_sides(opened.sides, has_floor=has_floor),
        *_ending_sides(opened.sides, has_floor=has_floor),
    ]:
        sentence = f"its {side.name} side is contradicted by {side.contradicted} of {side.total} tiles"
        return kind, sentence, FeatureStatus.NONE
    if kind == "niche" and (sentence := _relief(opened)):
        return kind, sentence, FeatureStatus.NONE
    if len(seen) < limits.FEWEST_SIDES or not {"left", "right"} & set(seen):
        sentence = f"only its {' and '.join(seen)} side was seen" if seen else "none of its sides was seen"
        return kind, sentence, FeatureStatus.NONE
    walled = {name for name in seen if name not in opened.bare}
    if opened.floor is not None:
        walled -= {"bottom"}
    if opened.bare and (len(walled) < limits.FEWEST_SIDES or not {"left", "right"} & walled):
        sentence = f"what bounds its {' and '.join(opened.bare)} side is a strip, no wall: beams go on beyond"
        return kind, sentence, FeatureStatus.NONE
    may_be_image = on_reveals < limits.REVEALED and not opened.recess.is_closed
    share = opened.image_share() if may_be_image else 0.0
    if share > limits.MOSTLY:
        sentence = f"opening or mirror: {share:.0%} of what lies behind is the image of what stands"
        return kind, f"{sentence} before it, and no reveal was measured", FeatureStatus.AMBIGUOUS
    if np.isnan(share):
        doubt = "; ".join(
            [*([doubt] if doubt else []), "no reveal and no image is in view: it may be a mirror"]
        )
    return kind, doubt, FeatureStatus.FOUND


def refuted_sides(sides: Sequence[FeatureSide], *, has_floor: bool) -> list[FeatureSide]:
    """Return the sides that more tiles contradict than confirm, a door's foot excepted."""
    return [
        side
        for side in sides
        if side.contradicted > side.confirmed
        and side.contradicted >= limits.REFUTED_SHARE * side.total
        and not (side.name == "bottom" and has_floor)
    ]


def _ending_sides(sides: Sequence[FeatureSide], *, has_floor: bool) -> list[FeatureSide]:
    """The sides that more tiles contradict than would by mistake: the wall ends there, the opening does not.

    Binomial test, over the tiles that tell.
    """
    return [
        side
        for side in sides
        if side.contradicted
        and bdtrc(side.contradicted - 1, side.contradicted + side.confirmed, limits.MISTAKEN_SHARE)
        < limits.MISTAKE_LEVEL
        and not (side.name == "bottom" and has_floor)
        and side.is_seen
    ]


def _relief(opened: FittedRecess) -> str:
    """Why a niche is none: a picture's frame stands around it, or it is as shallow as relief."""
    recess, wall = opened.recess, 0.0 if opened.chart is None else opened.chart.wall_m2
    area = float(np.prod(recess.size))
    if wall < limits.AROUND_SHARE * area:
        return f"what stands around it is a frame: {wall:.2f} m2 around {area:.2f} m2"
    shallow = recess.depth < limits.LEAST_NICHE_M
    return f"it is {1000 * recess.depth:.0f} mm deep: relief" if shallow else ""


def _kind(opened: FittedRecess) -> tuple[str, str]:
    """Doorway, window or niche, and what is doubtful of that."""
    recess, stands = opened.recess, opened.floor is not None
    if recess.is_closed:
        if stands and recess.size[1] > limits.DOOR_M and recess.depth <= limits.CLOSED_M:
            return "doorway", f"closed {1000 * recess.depth:.0f} mm behind the wall"
        return "niche", ""
    bottom = next(side for side in opened.sides if side.name == "bottom")
    if stands:
        return "doorway", ""
    if bottom.is_seen:
        return "window", ""
    return (
        "doorway" if recess.size[1] > limits.DOOR_M else "window"
    ), "its foot was not seen: doorway or window"


def _parameters(opened: FittedRecess) -> tuple[FloatArray, FloatArray]:
    """Left side, sill, width, height and depth (5,), and their covariance (5, 5)."""
    recess = opened.recess
    sd = {side.name: side.deviation for side in opened.sides}
    base = opened.lowest if opened.floor is None else opened.floor
    x = np.array([recess.left, recess.bottom - base, *recess.size, recess.depth])
    deviations = np.array([*(sd[name] for name in SIDES), opened.known["depth"].deviation])
    jacobian = np.zeros((5, 5))
    jacobian[[0, 1, 2, 2, 3, 3, 4], [0, 2, 1, 0, 3, 2, 4]] = 1, 1, 1, -1, 1, -1, 1
    variance = np.square(np.where(np.isfinite(deviations), deviations, 1e3))
    return x, (jacobian * variance) @ jacobian.T


def _assign_faces(
    recess: Recess, beams: WallBeams, observations: Sequence[Observation]
) -> tuple[IntArray, int]:
    """Face of each pixel of all scans in turn, 0 for none, and how many are of reveals."""
    start = np.cumsum([0, *(seen.scan.ranges.size for seen in observations)])
    out = np.zeros(int(start[-1]), np.int64)
    held = {name: np.array([getattr(recess, name)]) for name in SIDES}
    left, right = held.pop("left"), held.pop("right")
    depth = np.array([recess.depth])
    expected, _, face = expect(beams, left, right, **held, depth=depth, is_closed=recess.is_closed)
    with np.errstate(invalid="ignore"):
        on = np.abs(beams.ranges - expected[:, 0]) <= limits.ON_FACE_SD * beams.deviation
    past = beams.ranges - beams.wall_range > limits.ON_FACE_SD * beams.deviation  # else it may be the wall
    on &= (face[:, 0] > 0) & np.isfinite(beams.ranges)
    out[start[beams.scan[on]] + beams.pixel[on]] = face[on, 0]
    return out, int((on & past & (face[:, 0] <= 4)).sum())


@dataclass(frozen=True, slots=True, eq=False)
class _SideTiles:
    """Odds for no wall (n,) of n tiles along a side: just outside it, beyond that, and just inside."""

    outside: FloatArray
    beyond: FloatArray
    inside: FloatArray


def side_support(
    beams: WallBeams, recess: Recess, side: str, known: SideEstimate, *, floor: float | None = None
) -> FeatureSide:
    """Return a side with its tiles: confirmed where wall is just outside it and none just inside.

    Contradicted: no wall just outside, or wall just inside. A door's foot is confirmed where the opening
    reaches down to the `floor`.
    """
    tiles = _tiles(beams, recess, side, known)
    wall_outside, open_inside = tiles.outside < -limits.DECIDED_NATS, tiles.inside > limits.DECIDED_NATS
    open_outside, wall_inside = tiles.outside > limits.DECIDED_NATS, tiles.inside < -limits.DECIDED_NATS
    if side == "bottom" and floor is not None and abs(recess.bottom - floor) < limits.BAND_M:
        confirmed, contradicted = open_inside, wall_inside
    else:
        confirmed, contradicted = wall_outside & open_inside, open_outside | wall_inside
    n = len(confirmed)
    return FeatureSide(side, int(confirmed.sum()), int(contradicted.sum()), n, known.deviation)


def is_strip(
    beams: WallBeams, recess: Recess, side: str, known: SideEstimate, *, others: Sequence[Recess] = ()
) -> bool:
    """Whether what bounds a side is a strip, as of a frame or a board: most of its tiles are open beyond.

    Beyond are the 24 cm outside a tile's own strip. What nobody saw there, or is of `others` of the wall's
    openings, says nothing.
    """
    of_others = np.zeros(len(beams), dtype=np.bool_)
    for other in others:
        of_others |= other.holds(beams.uv) & (beams.nats > 0)
    beyond = _tiles(beams.select(~of_others), recess, side, known).beyond
    return int((beyond > limits.DECIDED_NATS).sum()) > int((beyond < -limits.DECIDED_NATS).sum())


def _tiles(beams: WallBeams, recess: Recess, side: str, known: SideEstimate) -> _SideTiles:
    axis = 0 if side in ("left", "right") else 1
    low, high = ((recess.bottom, recess.top), (recess.left, recess.right))[axis]
    n = max(round((high - low) / limits.TILE_M), 1)
    at = beams.uv[:, axis] - getattr(recess, side)
    outwards = at if side in ("right", "top") else -at
    tile = np.floor((beams.uv[:, 1 - axis] - low) / (high - low) * n).astype(np.int64)
    near = (tile >= 0) & (tile < n)
    margin = (
        min(3 * known.deviation, limits.BAND_M / 2) if np.isfinite(known.deviation) else limits.BAND_M / 2
    )
    beside = beams.gap[near & (np.abs(outwards) < limits.BAND_M)]
    gap = float(np.median(beside)) if len(beside) else limits.BAND_M
    band = max(limits.BAND_M, 2.0 * (gap if np.isfinite(gap) else limits.BAND_M))
    odds = np.clip(beams.nats, -limits.MOST_BEAM_NATS, limits.MOST_BEAM_NATS)

    def sums(first: float, last: float) -> FloatArray:
        where = near & (outwards > first) & (outwards < last)
        return np.asarray(np.bincount(tile[where], odds[where], minlength=n), dtype=np.float64)

    end = margin + band
    return _SideTiles(sums(margin, end), sums(end, end + limits.BEYOND_M), sums(-end, -margin))


def all_sides(
    beams: WallBeams, recess: Recess, known: dict[str, SideEstimate], floor: float | None
) -> tuple[FeatureSide, ...]:
    """Return the support of all four sides."""
    return tuple(side_support(beams, recess, side, known[side], floor=floor) for side in SIDES)


_ROUNDS = 2
_TRIES = 3  # to find a side
_OPPOSITE = {"left": "right", "right": "left", "bottom": "top", "top": "bottom"}
_SIZE = {"left": "width", "right": "width", "bottom": "height", "top": "height"}
_UNKNOWN = SideEstimate(0.0, np.inf)


def fit_recess(
    beams: WallBeams, rough: Recess, given: Given, levels: Sequence[SideEstimate]
) -> tuple[Recess, dict[str, SideEstimate], float]:
    """Return the recess at its most probable, how well its parameters are known, and its turn in the wall.

    Of what the sides refute at once neither depth nor turn is sought.
    """
    floor = floor_of(rough, levels)
    recess = rough if floor is None else rough.move_side("bottom", floor.value)
    known = {"bottom": floor or SideEstimate(rough.bottom, np.inf)}
    sides = [side for side in SIDES if side != "bottom" or floor is None]
    reach = {side: _reach(beams, recess, side) for side in SIDES}
    for side in sides:
        for _ in range(_TRIES):
            known[side] = fit_side(beams, recess, side, reach[side])
            shift = abs(known[side].value - getattr(recess, side))
            recess = recess.move_side(side, known[side].value)
            if shift < limits.FAR_SHARE * reach[side]:  # else it may lie farther on
                break
    first = all_sides(beams, recess, known, None if floor is None else floor.value)
    if refuted_sides(first, has_floor=floor is not None):
        return recess, known | {"depth": _UNKNOWN, "turn": SideEstimate(0.0, 0.0)}, 0.0
    total = 0.0
    for _ in range(_ROUNDS):
        recess, known["depth"], _ = fit_depth(beams, recess, given.get("depth"))
        known["turn"], recess = fit_turn(beams, recess, limits.CELL_M)
        beams, total = beams.turn(known["turn"].value), total + known["turn"].value
        for side in sides:
            closer = limits.CELL_M if reach[side] <= 2 * limits.CELL_M else reach[side]
            known[side] = fit_side(beams, recess, side, closer)
            recess = recess.move_side(side, known[side].value)
    return recess, known, total


def _reach(beams: WallBeams, recess: Recess, side: str) -> float:
    """How far to both ways a side is sought, metres: farther where beams are wider apart than cells."""
    gaps = beams.gap[near_side(beams, recess, side, limits.ABOUT_M)]
    return (
        max(2 * limits.CELL_M, limits.SIDE_GAPS * float(np.quantile(gaps, 0.9)))
        if len(gaps)
        else 2 * limits.CELL_M
    )


def with_unseen(
    beams: WallBeams, recess: Recess, sides: tuple[FeatureSide, ...], given: Given, *, farther: WallBeams
) -> tuple[Recess, tuple[FeatureSide, ...], dict[str, tuple[float, float]]]:
    """Return the recess with sides that nobody saw where beams still went through, as uncertain as that is.

    Of a width or height that is given, a side that was seen says where the other one is. How far inwards and
    outwards each side may be off comes with it. Of walls that `beams` do not reach `farther` ones tell.
    """
    seen, slack = {side.name: side for side in sides}, {side.name: (0.0, 0.0) for side in sides}
    for side in sides:
        if side.is_seen:
            continue
        opposite, size = _OPPOSITE[side.name], given.get(_SIZE[side.name])
        if size is not None and seen[opposite].is_seen:
            sign = 1.0 if side.name in ("right", "top") else -1.0
            recess = recess.move_side(side.name, getattr(recess, opposite) + sign * size)
            seen[side.name] = replace(side, deviation=seen[opposite].deviation)
            continue
        inner, outer = open_limits(beams, recess, side.name)
        if not np.isfinite(outer):
            outer = open_limits(farther, recess, side.name)[1]
        recess, slack[side.name] = recess.move_side(side.name, inner), (0.0, abs(outer - inner))
        seen[side.name] = replace(side, deviation=float(abs(outer - inner) / np.sqrt(3.0)))
    return recess, tuple(seen.values()), slack


def with_wall(
    beams: WallBeams, recess: Recess, known: dict[str, SideEstimate], wall: Wall, frame: WallFrame
) -> dict[str, SideEstimate]:
    """Return what is known of the sides, with what errors of the wall's plane and of the turn add to it."""
    out, centre = dict(known), recess.corners().mean(axis=0)
    for side in SIDES:
        axis = 0 if side in ("left", "right") else 1
        near = near_side(beams, recess, side, limits.CELL_M)
        if not near.any() or not np.isfinite(known[side].deviation):
            continue
        place = np.where(np.arange(2) == axis, getattr(recess, side), centre)
        off = wall.fit.standard_deviation(frame.points(place[None]))[0]
        by_wall = float(off * np.median(np.abs(beams.slope[near, axis])))
        by_turn = known["turn"].deviation * recess.size[1 - axis] / np.sqrt(12)
        sd = limits.INFLATION * float(np.sqrt(known[side].deviation ** 2 + by_wall**2 + by_turn**2))
        out[side] = SideEstimate(known[side].value, sd)
    return out


def height_of(frame: WallFrame, fit: SurfaceFit) -> SideEstimate:
    """Return the height in the wall's frame at which a level plane meets the wall."""
    floor = fit.surface
    normal = frame.axes @ floor.normal(frame.origin[None])[0]
    if abs(normal[2]) < 0.5:
        return SideEstimate(np.inf, np.inf)
    off = float(floor.distance(frame.origin[None])[0])
    sd = float(fit.standard_deviation(frame.origin[None])[0])
    return SideEstimate(-off / normal[2], sd)


def floor_of(recess: Recess, levels: Sequence[SideEstimate]) -> SideEstimate | None:
    """Return the level that an opening stands on, None for none: what is lower than people stands on none."""
    if recess.size[1] < limits.DOOR_M:
        return None
    near = [level for level in levels if abs(level.value - recess.bottom) <= limits.FLOOR_M]
    return min(near, key=lambda level: abs(level.value - recess.bottom), default=None)
