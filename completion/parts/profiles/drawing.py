# SPDX-License-Identifier: MIT
"""Drawing: a sheet with a view of each profile, to one scale, and its dimensions in millimetres.

Places are ordinates from the lower left of a view, as for a machine: each edge along an axis, each centre,
each corner of slanted lines. Circles and arcs have diameters and radii, slanted lines their angle. Every
number has its 95 % interval by the profile's joint covariance. Of a revolution the section is drawn whole,
with diameters in place of ordinates across the axis.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from scipy.optimize import isotonic_regression

from completion.parts.profiles.measures import SIGMA, Measure, leaders_of, ordinates_of
from completion.parts.profiles.profile import Loop, Profile
from scenes.checks import FloatArray

Layer = Literal["outline", "cut", "centre", "dimension", "frame"]
_SIZES_MM = ((297.0, 210.0), (420.0, 297.0), (594.0, 420.0), (841.0, 594.0))  # A4 to A1
_TALLEST = 64  # times A1's height, where nothing less shows all, as ISO 5457 makes sheets longer
_SCALES = tuple(m * 10.0**e for e in range(1, -5, -1) for m in (1.0, 0.5, 0.2))  # ISO 5455
_LEAST_VIEW_MM = 60.0  # of the widest view, below which a larger sheet is taken
_MARGIN_MM, _BLOCK_MM, _TEXT_MM, _LINE_MM, _GAP_MM = 10.0, 22.0, 2.5, 4.0, 3.4
_SIDE_MM, _FOOT_MM, _ROOM_MM = 30.0, 30.0, 12.0  # for ordinates, and between views
_REACHES_MM = tuple(np.arange(9.0, 34.0, 3.5).tolist())  # of leaders
_WIDE = 0.55  # of a letter, over its height
_SAME = 1e-4  # millimetres or degrees within which measures are one
_EXACT_MM = 5e-4  # half an interval that is less than the last digit, as of models, is not shown
_STEPS_MM = (3.0, 7.0, 8.5)  # from a view to the bends of an ordinate's line, and its end


@dataclass(frozen=True, slots=True, eq=False)
class Stroke:
    """A line through places (n, 2), millimetres; `bulge` (n,) bends each part: the tangent of turn / 4."""

    layer: Layer
    places: FloatArray
    bulge: FloatArray
    is_closed: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Circle:
    """A whole circle, millimetres."""

    layer: Layer
    centre: FloatArray
    radius: float


@dataclass(frozen=True, slots=True, eq=False)
class Lettering:
    """A text from a place (2,) on, millimetres, turned by degrees; `anchor`: which of its ends is there."""

    place: FloatArray
    text: str
    turn_deg: float = 0.0
    anchor: Literal["start", "middle", "end"] = "start"
    size_mm: float = _TEXT_MM


Item = Stroke | Circle | Lettering
OnPaper = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True, slots=True, eq=False)
class Sheet:
    """A drawing: its size, scale, and what is on it, millimetres of paper from the lower left."""

    width_mm: float
    height_mm: float
    scale: float
    items: tuple[Item, ...]


class _View(NamedTuple):
    """A profile in millimetres from its lower left (2,), metres, its size (2,), and the texts below."""

    profile: Profile
    low: FloatArray
    size: FloatArray
    captions: list[str]

    @classmethod
    def of(cls, profile: Profile, number: int) -> _View:
        places = np.concatenate([one.places() for loop in profile.loops for one in loop.segments])
        low, high = places.min(axis=0), places.max(axis=0)
        if profile.sweep.kind == "revolved":
            low = np.array([low[0], -high[1]])
        return cls(profile, low, 1e3 * (high - low), list(_captions(profile, number)))

    def room(self, scale: float) -> FloatArray:
        """Paper (2,) that it takes, millimetres."""
        return self.size * scale + [_SIDE_MM + _ROOM_MM, _FOOT_MM + _ROOM_MM + _LINE_MM * len(self.captions)]


def drawn_sheet(profiles: Sequence[Profile], title: str) -> Sheet:
    """Return the sheet that shows profiles; the smallest of A4 to A1 on which they are not too small.

    Where A1 is too small for all texts, it is made higher.
    """
    views = [_View.of(profile, number) for number, profile in enumerate(profiles, start=1)]
    widest = max((float(view.size.max()) for view in views), default=1.0)
    width, height = _SIZES_MM[-1]
    higher = [(width, k * height) for k in range(2, _TALLEST + 1)]
    rooms = {scale: [view.room(scale) for view in views] for scale in _SCALES}
    for sizes in (_SIZES_MM, higher):
        fitting = [(size, scale, corners) for size in sizes for scale in _SCALES
                   if (corners := _placed(rooms[scale], size)) is not None]  # fmt: skip
        if fitting:
            break
    large = [each for each in fitting if each[1] * widest >= _LEAST_VIEW_MM]
    size, scale, corners = large[0] if large else max(fitting, key=lambda each: each[1])
    items = [
        item for view, corner in zip(views, corners, strict=True) for item in _drawn(view, corner, scale)
    ]
    return Sheet(*size, scale, (*items, *_block(size, scale_text(scale), title)))


def scale_text(scale: float) -> str:
    """A scale in words."""
    return f"{scale:g} : 1" if scale >= 1 else f"1 : {1 / scale:g}"


def _placed(rooms: Sequence[FloatArray], size: tuple[float, float]) -> list[FloatArray] | None:
    """Lower left (2,) of each view, row by row from the upper left; None where they do not fit."""
    left, top = _MARGIN_MM, size[1] - _MARGIN_MM
    corners, x, row = list[FloatArray](), left, 0.0
    for room in rooms:
        if x + room[0] > size[0] - _MARGIN_MM and x > left:
            x, top, row = left, top - row, 0.0
        if x + room[0] > size[0] - _MARGIN_MM or top - room[1] < _MARGIN_MM + _BLOCK_MM:
            return None
        corners.append(np.array([x, top - room[1]]))
        x, row = x + room[0], max(row, float(room[1]))
    return corners


def _captions(profile: Profile, number: int) -> Iterator[str]:
    along = ", ".join(f"{round(float(value), 3) + 0.0:g}" for value in profile.sweep.direction)
    alike = f", {profile.alike} alike" if profile.alike > 1 else ""
    is_turned = profile.sweep.kind == "revolved"
    yield f"Profile {number}: {'turned about' if is_turned else 'extruded along'} ({along}){alike}"
    base = min((loop.low_m for loop in profile.loops), default=0.0)
    texts = Counter[str]()
    for loop in () if is_turned else profile.loops:
        heights = zip(("from", "to"), (loop.low_m, loop.high_m), loop.end_sd_m, strict=True)
        ends = [f" {word} {value_text(1e3 * (height - base), 1e3 * SIGMA * sd)}"
                for word, height, sd in heights if np.isfinite(sd)]  # fmt: skip
        texts[f"{loop.kind} through" if loop.is_through else f"{loop.kind}{''.join(ends)}"] += 1
    yield from (text if n == 1 else f"{n}\u00d7 {text}" for text, n in texts.items())


def value_text(value: float, half: float, sign: str = "") -> str:
    """A number with half its 95 % interval, rounded up, to the digits that this leaves, at most three."""
    if value == 0 and half == 0:
        return "0"
    if not np.isfinite(half):
        return f"{sign}{round(value, 2) + 0.0:.2f}"
    if half < _EXACT_MM:
        return f"{sign}{round(value, 3) + 0.0:.3f}"
    digits = int(np.clip(np.ceil(-np.log10(max(half, 1e-9))), 1, 3))
    up = max(np.ceil(half * 10**digits - 1e-9), 1) / 10**digits
    return f"{sign}{round(value, digits) + 0.0:.{digits}f} \u00b1{up:.{digits}f}"


def _drawn(view: _View, corner: FloatArray, scale: float) -> Iterator[Item]:
    """The view's lines, axis, centres, dimensions and captions, its room's lower left at a corner (2,)."""
    origin = corner + [_SIDE_MM, _FOOT_MM + _LINE_MM * len(view.captions)]

    def on_paper(places: FloatArray) -> FloatArray:
        return np.asarray(origin + 1e3 * scale * (places - view.low))

    is_turned = view.profile.sweep.kind == "revolved"
    for loop in view.profile.loops:
        yield from _outline(loop, on_paper, 1e3 * scale, is_turned)
    if is_turned:
        ends = view.low + np.array([[-4.0 / scale, 0.0], view.size + [4.0 / scale, 0.0]]) * 1e-3
        yield Stroke("centre", on_paper(ends * [1.0, 0.0]), np.zeros(2))
    middle = origin + scale * view.size / 2
    taken = list[FloatArray]()
    for axis in (0, 1):
        rows = [each for each, _ in _counted(ordinates_of(view.profile, axis))]
        for item in _ordinates(rows, axis, on_paper, origin):
            taken += [_room_of(item)] if isinstance(item, Lettering) else []
            yield item
    for measure, n in _counted(leaders_of(view.profile)):
        place = on_paper(measure.place)
        is_outward = measure.way @ (place - middle) >= 0 or measure.sign == "\u2300"
        outward = measure.way if is_outward else -measure.way
        text = (f"{n}\u00d7 " if n > 1 else "") + _measure_text(measure)
        for reach, way in [(reach, sign * outward) for reach in _REACHES_MM for sign in (1, -1)]:
            end = place + (reach + 0.8) * way - [0.0, _TEXT_MM / 3]
            lettering = Lettering(end, text, 0.0, "start" if way[0] >= 0 else "end")
            room = _room_of(lettering)
            if not any((room[0] < other[1]).all() and (other[0] < room[1]).all() for other in taken):
                break
        taken.append(room)
        yield Stroke("dimension", np.stack([place, place + reach * way]), np.zeros(2))
        yield lettering
    for k, text in enumerate(view.captions):
        yield Lettering(corner + [2.0, _LINE_MM * (len(view.captions) - k) - 1.0], text)


def _room_of(item: Lettering) -> FloatArray:
    """Lower left and upper right (2, 2) of a text that is not turned, or turned by 90 degrees."""
    length = _WIDE * item.size_mm * len(item.text)
    start = {"start": 0.0, "middle": -length / 2, "end": -length}[item.anchor]
    if item.turn_deg:
        return np.asarray(item.place + [[-item.size_mm, start], [0.0, start + length]])
    return np.asarray(item.place + [[start, 0.0], [start + length, item.size_mm]])


def _outline(loop: Loop, on_paper: OnPaper, scale: float, is_turned: bool) -> Iterator[Item]:
    """A loop, of a revolution with its mirror image below the axis."""
    layer: Layer = "cut" if loop.is_hollow else "outline"
    segments, signs = [one for one in loop.segments if one.wall >= 0], (1.0, -1.0) if is_turned else (1.0,)
    if segments[0].centre is not None and segments[0].is_whole:
        for sign in signs:
            centre, radius = on_paper(segments[0].centre * [1.0, sign]), scale * segments[0].radius
            yield Circle(layer, centre, radius)
            for way in np.eye(2):
                yield Stroke("centre", centre + np.outer([-1.0, 1.0], way) * (radius + 2.0), np.zeros(2))
        return
    places = np.array([one.start for one in segments] + [segments[-1].end])
    bulge = np.array([np.tan(one.sweep_rad / 4) for one in segments] + [0.0])
    is_ring = bool(np.allclose(places[0], places[-1], rtol=0, atol=1e-9))
    n = len(segments) + (not is_ring)
    for sign in signs:
        yield Stroke(layer, on_paper(places[:n] * [1.0, sign]), sign * bulge[:n], is_ring)


def _counted(measures: Sequence[Measure]) -> list[tuple[Measure, int]]:
    """Measures of one value once, and how many."""
    found: list[tuple[Measure, int]] = []
    for measure in measures:
        same = (k for k, (other, _) in enumerate(found)
                if other.sign == measure.sign and abs(other.value - measure.value) < _SAME)  # fmt: skip
        if (k := next(same, -1)) >= 0:
            found[k] = found[k][0], found[k][1] + 1
        else:
            found.append((measure, 1))
    return found


def _measure_text(measure: Measure) -> str:
    sign = measure.sign
    text = value_text(measure.value, measure.half, "" if sign == "\u00b0" else sign)
    return text + sign if sign == "\u00b0" else text


def _ordinates(
    measures: Sequence[Measure], axis: int, on_paper: OnPaper, origin: FloatArray
) -> Iterator[Item]:
    """Places along x below the view, or along y (of a revolution diameters) to its left."""
    if not measures:
        return
    at = np.array([on_paper(measure.place)[axis] for measure in measures])
    steps, other = _GAP_MM * np.arange(len(at)), 1 - axis
    spread = np.asarray(isotonic_regression(at - steps).x) + steps
    for measure, here, there in zip(measures, at, spread, strict=True):
        places = np.zeros((4, 2))
        places[:, axis] = here, here, there, there
        places[:, other] = on_paper(measure.place)[other], *(origin[other] - np.array(_STEPS_MM))
        yield Stroke("dimension", places, np.zeros(4))
        foot = places[3] + (np.array([_TEXT_MM / 3, -0.8]) if axis == 0 else np.array([-0.8, -_TEXT_MM / 3]))
        yield Lettering(foot, _measure_text(measure), 90.0 * other, "end")


def _block(size: tuple[float, float], scale: str, title: str) -> Iterator[Item]:
    """The frame and what the drawing is."""
    low, high, top = np.array([5.0, 5.0]), np.array(size) - 5.0, _BLOCK_MM + 3.0
    frame = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    yield Stroke("frame", frame, np.zeros(4), True)
    yield Stroke("frame", np.array([[low[0], top], [high[0], top]]), np.zeros(2))
    yield Lettering(np.array([9.0, top - 6.5]), title, size_mm=4.0)
    told = (
        f"Dimensions in mm, scale {scale}. \u00b1: 95 % interval, no tolerance.",
        "Ordinates from the lowest edge of each view, or the centre of a round one.",
    )
    for k, text in enumerate(told):
        yield Lettering(np.array([9.0, top - 11.5 - 4.0 * k]), text)
