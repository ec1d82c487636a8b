# SPDX-License-Identifier: MIT
"""Decision: whether an opening is there, what it is, and what of it nobody saw.

The null: how often a room whose wall has no opening shows one as good.
Measured by `python -m benchmarks.features nulls --first 4000 --seeds 12 --tail` on simulated walls that are
plain, end, bear pictures or mirrors, lost a patch, or have cupboards, wardrobes, a table or shelves before
them, each scanned once, with boxes, 5 mm of noise and 1 % of strays.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import bdtrc

from completion.features.engine.template import Given, Side, Status, TemplateFit
from completion.features.openings.proposals import WallChart
from completion.features.openings.recess import FACES, SIDES, Recess, expect
from completion.features.openings.sides import Estimate
from completion.features.openings.walls import Wall, WallBeams, WallFrame
from completion.observe.observation import Observation
from scenes.checks import FloatArray, IntArray

LEVELS = (-np.inf, 0.0, 8.0, 16.0, 32.0, 64.0, 128.0, 256.0)
"""Nats of evidence."""

N_WALLS = 108
WALLS_AS_GOOD: dict[Status, tuple[int, ...]] = {
    Status.FOUND: (2, 2, 2, 2, 2, 1, 1, 0),
    Status.AMBIGUOUS: (25, 25, 25, 25, 25, 25, 11, 2),
    Status.NONE: (66, 47, 42, 41, 39, 35, 25, 25),
}
"""Of each status: on how many walls one came as far with that evidence, or farther."""

_ORDER = (Status.NONE, Status.AMBIGUOUS, Status.FOUND)


def rank(status: Status, evidence: float) -> tuple[int, float]:
    """Return by what fits are ordered: how far the rules let them come, then their evidence, nats."""
    return _ORDER.index(status), evidence


def false_fit_probability(status: Status, evidence: float) -> float:
    """Return how probably a wall without an opening shows one that comes as far, and is as evident, or more.

    A share of the walls that were simulated, at the tabled evidence below; never less than one of them.
    """
    level = max(int(np.searchsorted(LEVELS, evidence, side="right")) - 1, 0)
    return max(WALLS_AS_GOOD[status][level], 1) / N_WALLS


_BY_TILE = 4.0  # nats: of a tile that confirms or contradicts
_LEAST_M = 0.3  # of width and height
_REFUTED = 0.3  # share of a side's tiles
_MISTAKEN, _LEVEL = (
    0.03,
    0.01,
)  # of tiles of true sides (a hundredth, in a house), and of a test that they are
_FEWEST_SEEN = 2  # sides
_ON_FACE = 3.0  # standard deviations
_REVEALED = 10  # points on reveals, from which on they are seen
_LEAST_AROUND = 0.8  # of a niche's area, that must be wall around it: pictures' frames are less
LEAST_NICHE_M = 0.03
_IS_IMAGE = 0.5  # share of what lies behind that stands before, too
DOOR_M = 1.6  # height from which on what stands on the floor is a doorway
_CLOSED_M = 0.15  # depth up to which a door's leaf lies behind its wall
NAMES = ("u", "sill", "width", "height", "depth")


@dataclass(frozen=True, slots=True, eq=False)
class Opened:
    """A recess as it was fitted, what speaks for it, and how far in and out each side may be off.

    `floor` is the level that it stands on, `lowest` the lowest level that was measured, NaN for none; `bare`
    are the seen sides that a mere strip bounds.
    """

    frame: WallFrame
    turn: float
    recess: Recess
    known: dict[str, Estimate]
    sides: tuple[Side, ...]
    floor: float | None
    lowest: float
    image_share: Callable[[], float]
    wall: Wall
    slack: Mapping[str, tuple[float, float]]
    bare: tuple[str, ...]
    chart: WallChart | None


def decide(
    opened: Opened, beams: WallBeams, observations: Sequence[Observation], given: Given
) -> TemplateFit:
    """Return the opening as a feature, found, ambiguous or refused, with the reason in one sentence."""
    assignment, on_reveals = _assigned(opened.recess, beams.turned(opened.turn), observations)
    kind, reason, status = _judged(opened, on_reveals)
    x, covariance = _parameters(opened)
    recess, depth = opened.recess, opened.known["depth"]
    held = tuple(name for name in NAMES if name in given)
    for name in held:
        covariance[NAMES.index(name)] = covariance[:, NAMES.index(name)] = 0.0
    confirmed = sum(side.confirmed for side in opened.sides)
    contradicted = sum(side.contradicted for side in opened.sides)
    evidence = _BY_TILE * (confirmed - contradicted)
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
    if fit.status is Status.NONE:
        return fit
    told = f"nothing came back from {share:.0%} of it: a window, a mirror or something dark"
    x, covariance, depth = fit.x.copy(), fit.covariance.copy(), NAMES.index("depth")
    x[depth], covariance[depth, depth] = np.nan, np.inf
    geometry = {**fit.geometry, "depth_m": np.nan, "depth_sd_m": np.inf}
    none = np.zeros_like(fit.assignment)
    unknown = replace(fit, x=x, covariance=covariance, geometry=geometry, assignment=none)
    chance = false_fit_probability(Status.AMBIGUOUS, fit.evidence)
    return replace(unknown, status=Status.AMBIGUOUS, reason=told, false_fit_probability=chance)


def _judged(opened: Opened, on_reveals: int) -> tuple[str, str, Status]:
    """Kind, reason and status."""
    kind, doubt = _kind(opened)
    width, height = opened.recess.size
    seen = [side.name for side in opened.sides if side.is_seen]
    is_narrow = width < _LEAST_M and {"left", "right"} <= set(seen)
    if is_narrow or (height < _LEAST_M and {"bottom", "top"} <= set(seen)):
        return kind, f"it is {1000 * width:.0f} mm by {1000 * height:.0f} mm: too small", Status.NONE
    has_floor = opened.floor is not None
    for side in [*refuted(opened.sides, has_floor=has_floor), *_ended(opened.sides, has_floor=has_floor)]:
        told = f"its {side.name} side is contradicted by {side.contradicted} of {side.total} tiles"
        return kind, told, Status.NONE
    if kind == "niche" and (told := _relief(opened)):
        return kind, told, Status.NONE
    if len(seen) < _FEWEST_SEEN or not {"left", "right"} & set(seen):
        told = f"only its {' and '.join(seen)} side was seen" if seen else "none of its sides was seen"
        return kind, told, Status.NONE
    walled = {name for name in seen if name not in opened.bare}
    if opened.floor is not None:
        walled -= {"bottom"}
    if opened.bare and (len(walled) < _FEWEST_SEEN or not {"left", "right"} & walled):
        told = f"what bounds its {' and '.join(opened.bare)} side is a strip, no wall: beams go on beyond"
        return kind, told, Status.NONE
    may_be_image = on_reveals < _REVEALED and not opened.recess.is_closed
    share = opened.image_share() if may_be_image else 0.0
    if share > _IS_IMAGE:
        told = f"opening or mirror: {share:.0%} of what lies behind is the image of what stands"
        return kind, f"{told} before it, and no reveal was measured", Status.AMBIGUOUS
    if np.isnan(share):
        doubt = "; ".join(
            [*([doubt] if doubt else []), "no reveal and no image is in view: it may be a mirror"]
        )
    return kind, doubt, Status.FOUND


def refuted(sides: Sequence[Side], *, has_floor: bool) -> list[Side]:
    """Return the sides that more tiles contradict than confirm, a door's foot excepted."""
    return [
        side
        for side in sides
        if side.contradicted > side.confirmed
        and side.contradicted >= _REFUTED * side.total
        and not (side.name == "bottom" and has_floor)
    ]


def _ended(sides: Sequence[Side], *, has_floor: bool) -> list[Side]:
    """The sides that more tiles contradict than would by mistake: the wall ends there, the opening does not.

    Binomial test, over the tiles that tell.
    """
    return [
        side
        for side in sides
        if side.contradicted
        and bdtrc(side.contradicted - 1, side.contradicted + side.confirmed, _MISTAKEN) < _LEVEL
        and not (side.name == "bottom" and has_floor)
        and side.is_seen
    ]


def _relief(opened: Opened) -> str:
    """Why a niche is none: a picture's frame stands around it, or it is as shallow as relief."""
    recess, wall = opened.recess, 0.0 if opened.chart is None else opened.chart.wall_m2
    area = float(np.prod(recess.size))
    if wall < _LEAST_AROUND * area:
        return f"what stands around it is a frame: {wall:.2f} m2 around {area:.2f} m2"
    shallow = recess.depth < LEAST_NICHE_M
    return f"it is {1000 * recess.depth:.0f} mm deep: relief" if shallow else ""


def _kind(opened: Opened) -> tuple[str, str]:
    """Doorway, window or niche, and what is doubtful of that."""
    recess, stands = opened.recess, opened.floor is not None
    if recess.is_closed:
        if stands and recess.size[1] > DOOR_M and recess.depth <= _CLOSED_M:
            return "doorway", f"closed {1000 * recess.depth:.0f} mm behind the wall"
        return "niche", ""
    bottom = next(side for side in opened.sides if side.name == "bottom")
    if stands:
        return "doorway", ""
    if bottom.is_seen:
        return "window", ""
    return ("doorway" if recess.size[1] > DOOR_M else "window"), "its foot was not seen: doorway or window"


def _parameters(opened: Opened) -> tuple[FloatArray, FloatArray]:
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


def _assigned(recess: Recess, beams: WallBeams, observations: Sequence[Observation]) -> tuple[IntArray, int]:
    """Face of each pixel of all scans in turn, 0 for none, and how many are of reveals."""
    start = np.cumsum([0, *(seen.scan.ranges.size for seen in observations)])
    out = np.zeros(int(start[-1]), np.int64)
    held = {name: np.array([getattr(recess, name)]) for name in SIDES}
    left, right = held.pop("left"), held.pop("right")
    depth = np.array([recess.depth])
    expected, _, face = expect(beams, left, right, **held, depth=depth, is_closed=recess.is_closed)
    with np.errstate(invalid="ignore"):
        on = np.abs(beams.ranges - expected[:, 0]) <= _ON_FACE * beams.deviation
    past = beams.ranges - beams.wall_range > _ON_FACE * beams.deviation  # else it may be the wall
    on &= (face[:, 0] > 0) & np.isfinite(beams.ranges)
    out[start[beams.scan[on]] + beams.pixel[on]] = face[on, 0]
    return out, int((on & past & (face[:, 0] <= 4)).sum())
