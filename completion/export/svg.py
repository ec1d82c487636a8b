# SPDX-License-Identifier: MIT
"""SVG: a floor plan to scale, measured lines solid and inferred ones dashed, with dimensions."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from xml.sax.saxutils import escape

import numpy as np
import shapely
from shapely import affinity

from completion.export.building.cut import CutLine, LevelCut, opening_at, plan_of, seen_below
from completion.export.building.model import BuildingModel, told_turn
from completion.export.building.parts import BuildingParts
from completion.export.building.things import STATES
from completion.export.dimension import Dimension
from completion.export.room_dimensions import room_stamps, told_area, widths_of
from scenes.checks import FloatArray

_SCALES = (5, 10, 20, 25, 50, 100, 200, 250, 500, 1000, 2000, 2500, 5000)
_LONG_MM, _SHORT_MM = 297.0, 210.0
_MARGIN_MM, _BLOCK_MM, _AIR_MM = 10.0, 37.0, 10.0  # around; of the title block; between frame and drawing
_LETTER = 0.56  # mean width of a letter over its height
_LINE = 1.35  # from a line of text to the next, heights of a letter
_PLACES = (0.5, 0.35, 0.65, 0.22, 0.78, 0.12, 0.88)  # along a dimension


@dataclass(frozen=True, slots=True, eq=False)
class Paper:
    """A sheet of A4 and where places of the world lie on it.

    Attributes
    ----------
    width_mm, height_mm : float
        Of the sheet.
    scale : int
        1 : scale.
    centre : (2,) float
        Place of the world in the middle of the frame, metres.
    """

    width_mm: float
    height_mm: float
    scale: int
    centre: FloatArray

    @classmethod
    def of(cls, places: FloatArray) -> Paper:
        """Return the sheet, lying or upright, on which places (n, 2) are largest, to a usual scale."""
        low, high = (places.min(axis=0), places.max(axis=0)) if len(places) else (np.zeros(2), np.ones(2))
        sheets = []
        for width, height in ((_LONG_MM, _SHORT_MM), (_SHORT_MM, _LONG_MM)):
            room = np.array([width, height - _BLOCK_MM]) - 2 * (_MARGIN_MM + _AIR_MM)
            least = float((1000 * (high - low) / room).max())
            scale = next((number for number in _SCALES if number >= least), int(np.ceil(least / 1000)) * 1000)
            sheets.append(cls(width, height, scale, (low + high) / 2))
        return min(sheets, key=lambda sheet: sheet.scale)

    @property
    def frame(self) -> tuple[float, float, float, float]:
        """Left, top, width and height of the frame around the drawing, millimetres."""
        wide = self.width_mm - 2 * _MARGIN_MM
        return _MARGIN_MM, _MARGIN_MM, wide, self.height_mm - 2 * _MARGIN_MM - _BLOCK_MM

    def place(self, points: FloatArray) -> FloatArray:
        """Millimetres (n, 2) from the sheet's upper left of places (n, 2 or 3) of the world."""
        left, top, wide, high = self.frame
        middle = np.array([left + wide / 2, top + high / 2])
        return np.asarray(middle + (points[:, :2] - self.centre) * np.array([1000.0, -1000.0]) / self.scale)


@dataclass(slots=True, eq=False)
class Lettering:
    """Text along lines, where no other text is."""

    taken: list[shapely.Geometry] = field(default_factory=list)

    def along(self, ends: FloatArray, text: str, size_mm: float) -> tuple[FloatArray, float] | None:
        """Return the middle of a text's foot on the line between two ends (2, 2), and its turn in degrees.

        All in millimetres of paper, y down. It reads from below or from the right. None where all is taken.
        """
        direction = ends[1] - ends[0]
        turn = float(np.degrees(np.arctan2(direction[1], direction[0])))
        turn = turn - 180 if turn > 89.9 else turn + 180 if turn <= -90.1 else turn
        wide = _LETTER * size_mm * len(text)
        for share in _PLACES:
            middle = ends[0] + share * direction
            box = affinity.rotate(
                shapely.box(-wide / 2, -1.5 * size_mm, wide / 2, 0.2 * size_mm), turn, origin=(0, 0)
            )
            box = affinity.translate(box, *middle)
            if not any(box.intersects(other) for other in self.taken):
                self.taken.append(box)
                return middle, turn
        return None

    def block(
        self, foot: FloatArray, texts: Sequence[str], size_mm: float
    ) -> list[tuple[FloatArray, float]] | None:
        """Return where the lines of a level block of text go, about a foot (2, 2); None where taken."""
        wide = _LETTER * size_mm * max(map(len, texts))
        step, middle = _LINE * size_mm, foot.mean(axis=0)
        top = middle[1] - step * (len(texts) - 1) / 2
        low, high = middle[0] - wide / 2, middle[0] + wide / 2
        box = shapely.box(low, top - 1.2 * size_mm, high, top + step * (len(texts) - 1) + 0.3 * size_mm)
        if any(box.intersects(other) for other in self.taken):
            return None
        self.taken.append(box)
        return [(np.array([middle[0], top + step * k]), 0.0) for k in range(len(texts))]

    def keep(self, ends: Sequence[FloatArray]) -> None:
        """Keep text off polylines (n, 2)."""
        self.taken += [shapely.LineString(end).buffer(0.3) for end in ends]


_TEXT_MM, _TICK_MM, _OUTSIDE_MM = 2.6, 1.2, 4.0
_STYLE = """
svg { background: #fff; font-family: Helvetica, Arial, sans-serif; }
path, line, polyline { fill: none; stroke: #000; stroke-linejoin: round; }
text { fill: #000; font-size: 2.6px; }
.measured { stroke-width: 0.5; }
.inferred { stroke-width: 0.4; stroke: #1f5fbf; stroke-dasharray: 2 1; }
.rest { stroke-width: 0.13; stroke: #b36b00; }
.below { stroke-width: 0.18; stroke: #999; }
.thing-measured { stroke-width: 0.25; }
.thing-inferred { stroke-width: 0.25; stroke: #1f5fbf; stroke-dasharray: 1.2 0.6; }
.thing-unknown { stroke-width: 0.25; stroke: #777; stroke-dasharray: 0.25 0.7; }
.opening { stroke-width: 0.18; }
.thin { stroke-width: 0.18; }
.dimension line, .dimension path { stroke-width: 0.18; }
.dimension text, .label { text-anchor: middle; paint-order: stroke; stroke: #fff; stroke-width: 0.7; }
.dimension.on-inferred line { stroke: #1f5fbf; stroke-dasharray: 1 0.6; }
.dimension.on-inferred text { fill: #1f5fbf; }
.full { fill: #000; stroke: none; }
.frame { stroke-width: 0.25; }
""".strip()
_TOLD_WIDTHS = "Widths between walls in metres; \u00b1 is the 95 % interval."
_TOLD_UNKNOWN = "Widths between walls in metres; how exact they are is not known."
_TOLD_AREAS = "Areas are between walls, doorways and things not taken off."
_TOLD_NOTHING = "No room is closed by walls, and no two walls face each other: no area and no width."
_TOLD_INFERRED = " Blue ones rest on inferred wall."
_SCALE_BAR_MM = 50.0  # its length at most
_LEGEND = 4  # kinds of lines in a row of the legend

_SAME_M = 1e-6  # height of the plan's own widths
_BESIDE_MM = [np.array([x, y]) for y in (0.0, -8.0, 8.0, -16.0, 16.0) for x in (0.0, 20.0, -20.0)]
_STOREY_M = 1.3  # between the plan and the middle of a room that it cuts


def svg_of(building: BuildingParts) -> str:
    """Return the floor plan of a building as SVG: a sheet of A4 in millimetres; the same one, the same text.

    Lines are `measured` (solid), `inferred` (dashed, blue) or `rest` (of no surface, thin); thin grey ones
    lie below the cut; outlines of things are `thing-measured`, `thing-inferred` or `thing-unknown`. Each
    group `dimension` has the width of a room between two walls as `data-value-m`, the ends of its 95 %
    interval as `data-low-m` and `data-high-m`, and the walls as `data-surfaces`.
    """
    model, plan = building.model, plan_of(building.model)
    standing = [thing for thing in model.things if thing.vertices[:, 2].min() < plan.height_m]
    taken = {number for thing in standing for number in thing.surfaces}
    below = seen_below(model, plan.height_m, taken)
    drawn_lines = [line.points[:, :2] for line in plan.lines if line.surface] + below
    places = drawn_lines or [line.points[:, :2] for line in plan.lines]
    paper = Paper.of(np.concatenate([np.zeros((0, 2)), *places]))
    lines = {state: _points(plan.lines, state) for state in ("rest", "inferred", "measured")}
    outlines = {
        f"thing-{state}": [line for thing in standing for other, line in thing.outline if other == state]
        for state in STATES
    }
    strokes_of = {"below": below, **outlines, **lines}
    drawn = {state: strokes for state, strokes in strokes_of.items() if strokes}
    lettering = Lettering()
    edges = [line for state, strokes in drawn.items() if state not in ("below", "rest") for line in strokes]
    lettering.keep([paper.place(line) for line in edges])
    drawn_widths = [width for width in widths_of(building) if abs(width.ends[0, 2] - plan.height_m) < _SAME_M]
    widths = _dimensions(drawn_widths, paper, lettering)
    stamps = _stamps(building, plan, paper, lettering)
    left, top, wide, high = paper.frame
    body = [
        f'<clipPath id="frame"><rect x="{_n(left)}" y="{_n(top)}" width="{_n(wide)}" height="{_n(high)}"/>'
        "</clipPath>",
        '<g clip-path="url(#frame)">',
        *(_path(paper, strokes, state) for state, strokes in drawn.items()),
        *_openings(model, plan, paper, lettering),
        *widths,
        *stamps,
        "</g>",
        f'<path class="frame" d="M{_n(left)} {_n(top)}h{_n(wide)}v{_n(high)}h{_n(-wide)}z"/>',
        *_block(
            paper,
            [_told_scans(building.model, plan), *(_told_widths(widths, bool(stamps)) if drawn else ())],
            drawn,
        ),
    ]
    size = f'width="{_n(paper.width_mm)}mm" height="{_n(paper.height_mm)}mm"'
    return "\n".join(
        [
            '<?xml version="1.0" encoding="UTF-8"?>',
            f'<svg xmlns="http://www.w3.org/2000/svg" {size} '
            f'viewBox="0 0 {_n(paper.width_mm)} {_n(paper.height_mm)}" data-scale="{paper.scale}">',
            f"<title>Floor plan, 1 : {paper.scale}</title>",
            f"<desc>{escape(plan.caption)}{told_turn(model.drawing_from_world)}</desc>",
            f"<style>{_STYLE}</style>",
            *body,
            "</svg>\n",
        ]
    )


def _points(lines: Sequence[CutLine], state: str) -> list[FloatArray]:
    """Polylines of measured, inferred or rest lines."""
    kept = [line for line in lines if (line.surface == 0) == (state == "rest")]
    return [line.points for line in kept if state == "rest" or line.is_measured == (state == "measured")]


def _path(paper: Paper, lines: Sequence[FloatArray], state: str) -> str:
    """Polylines (n, 2 or 3) of the world as one path."""
    drawn = ["M" + "L".join(f"{_n(x)} {_n(y)}" for x, y in paper.place(points)) for points in lines]
    return f'<path class="{state}" d="{"".join(drawn)}"/>'


def _openings(model: BuildingModel, plan: LevelCut, paper: Paper, lettering: Lettering) -> list[str]:
    """Openings that the plan cuts, as thin lines with what they are outside of the wall."""
    outward = {wall.number: -wall.normal[:2] / np.hypot(*wall.normal[:2]) for wall in model.walls}
    openings = []
    for opening in model.openings:
        places = opening_at(opening, plan.height_m) if opening.surface in outward else None
        if places is None:
            continue
        ends = paper.place(places)
        aside = outward[opening.surface] * np.array([1.0, -1.0])
        openings.append(_line(ends, "opening"))
        text = f"{opening.kind} {opening.width_m:.2f} \u00d7 {opening.height_m:.2f}"
        reach = _OUTSIDE_MM if aside[1] > 0 or aside[0] > 0.5 else 1.2
        put = lettering.along(ends + reach * aside, text, _TEXT_MM)
        inside = 1.2 if reach == _OUTSIDE_MM else _OUTSIDE_MM
        put = put or lettering.along(ends - inside * aside, text, _TEXT_MM)
        openings += [_text(*put, text, ' class="label"')] if put else []
    return openings


def _dimensions(dimensions: Sequence[Dimension], paper: Paper, lettering: Lettering) -> list[str]:
    """Dimensions whose text finds a place: line, ticks, text, and the numbers as attributes."""
    drawn = []
    for dimension in dimensions:
        ends, text = paper.place(dimension.ends), told_width(dimension)
        along = (ends[1] - ends[0]) / max(float(np.linalg.norm(ends[1] - ends[0])), 1e-9)
        across = np.array([-along[1], along[0]])
        upright = along[1] ** 2 > 0.99  # the foot stands to the left of an upright line
        put = lettering.along(
            ends + (np.array([-0.8, 0]) if upright else np.array([0, -0.8])), text, _TEXT_MM
        )
        if put is None:
            continue
        lettering.keep([ends])
        slant = _TICK_MM * (along + across) / np.sqrt(2)
        state = "" if dimension.measured_share == 1 else " on-inferred"
        drawn += [
            f'<g class="dimension{state}" data-surfaces="{dimension.surfaces[0]} {dimension.surfaces[1]}" '
            f'data-value-m="{dimension.value:.6f}" data-low-m="{dimension.low:.6f}" '
            f'data-high-m="{dimension.high:.6f}">',
            _line(ends, "thin"),
            *(f'<path d="M{_xy(end - slant)}L{_xy(end + slant)}"/>' for end in ends),
            _text(*put, text),
            "</g>",
        ]
    return drawn


def _stamps(building: BuildingParts, plan: LevelCut, paper: Paper, lettering: Lettering) -> list[str]:
    """Name, area and height of each closed room that the plan cuts, in its middle or as near as is free."""
    drawn = []
    for stamp in room_stamps(building):
        if abs(stamp.area.ends[0, 2] - plan.height_m) > _STOREY_M:
            continue
        middle = paper.place(stamp.area.ends)[0]
        lines = [(stamp.name, "label"), (told_area(stamp.area), "label area")]
        if stamp.height_m is not None:
            lines.append((f"height {stamp.height_m:.2f} m", "label"))
        for off in _BESIDE_MM:
            foot = middle + off + np.array([[-1.0, 0.0], [1.0, 0.0]])
            put = lettering.block(foot, [text for text, _ in lines], _TEXT_MM)
            if put is not None:
                drawn += [
                    _text(*at, text, f' class="{kind}"') for at, (text, kind) in zip(put, lines, strict=True)
                ]
                break
    return drawn


def _told_scans(model: BuildingModel, plan: LevelCut) -> str:
    """The title: of which scans it is, and where it is cut."""
    return f"{model.title}: {plan.caption}" if model.title else plan.caption


def _told_widths(drawn: Sequence[str], has_stamps: bool) -> list[str]:
    """What is said of widths and areas, if any are drawn."""
    is_inferred = any("on-inferred" in text for text in drawn)
    sentence = _TOLD_WIDTHS if any("\u00b1" in text for text in drawn) else _TOLD_UNKNOWN
    told = [sentence + (_TOLD_INFERRED if is_inferred else "")] if drawn else []
    told += [_TOLD_AREAS] if has_stamps else []
    return told or [_TOLD_NOTHING]


def told_width(dimension: Dimension) -> str:
    """Return a width as drawings show it: metres to the millimetre, the interval, if known, rounded up."""
    if not np.isfinite(dimension.half):
        return f"{dimension.value:.3f}"
    digits = 3 if dimension.half >= 5e-4 else 4
    half = np.ceil(dimension.half * 10**digits - 1e-9) / 10**digits
    return f"{dimension.value:.{digits}f} \u00b1 {max(half, 10.0**-digits):.{digits}f}"


def _block(paper: Paper, sentences: Sequence[str], states: Collection[str]) -> list[str]:
    """Below the frame: what it is, what the lines of some states are, the scale bar and the axes."""
    left, top, wide, high = paper.frame
    foot, right = top + high, left + wide
    drawn = [
        f'<text x="{_n(left)}" y="{_n(foot + 6 + 4 * k)}">{escape(text)}</text>'
        for k, text in enumerate(sentences)
    ]
    names = {
        "measured": "measured",
        "inferred": "inferred",
        "rest": "of no surface",
        "below": "below the cut",
        "thing-measured": "thing",
        "thing-unknown": "thing, unknown",
    }
    shown = {state: name for state, name in names.items() if state in states}
    for k, (state, name) in enumerate(shown.items()):
        start = np.array([left + 34 * (k % _LEGEND), foot + 18.5 + 4.0 * (k // _LEGEND)])
        drawn.append(_line(np.array([start, start + [10, 0]]), state))
        drawn.append(f'<text x="{_n(start[0] + 12)}" y="{_n(start[1] + 0.9)}">{name}</text>')
    metres = max(
        base * 10.0**power
        for base in (1, 2, 5)
        for power in range(-2, 4)
        if base * 10.0**power * 1000 / paper.scale <= _SCALE_BAR_MM
    )
    bar, base_line = metres * 1000 / paper.scale, foot + 29
    drawn.append(f'<path class="thin" d="M{_n(left)} {_n(base_line)}h{_n(bar)}v-2h{_n(-bar)}z"/>')
    drawn.append(f'<path class="full" d="M{_n(left)} {_n(base_line)}h{_n(bar / 2)}v-2h{_n(-bar / 2)}z"/>')
    drawn.append(f'<text x="{_n(left)}" y="{_n(base_line + 4)}">0</text>')
    drawn.append(f'<text x="{_n(left + bar)}" y="{_n(base_line + 4)}" class="label">{metres:g} m</text>')
    drawn.append(f'<text x="{_n(left + bar + 8)}" y="{_n(base_line)}">1 : {paper.scale} on A4</text>')
    corner = np.array([right - 16, foot + 31.0])
    for name, way in (("+x", np.array([10.0, 0])), ("+y", np.array([0, -10.0]))):
        tip, side = corner + way, np.array([-way[1], way[0]]) * 0.08
        drawn.append(_line(np.array([corner, tip]), "thin"))
        wings = f"M{_xy(tip - 0.2 * way + side)}L{_xy(tip)}L{_xy(tip - 0.2 * way - side)}"
        drawn.append(f'<path class="thin" d="{wings}"/>')
        drawn.append(
            f'<text x="{_n(tip[0] + 1)}" y="{_n(tip[1] + (1 if name == "+x" else 0))}">{name}</text>'
        )
    return drawn


def _line(ends: FloatArray, state: str) -> str:
    (x1, y1), (x2, y2) = ends
    return f'<line class="{state}" x1="{_n(x1)}" y1="{_n(y1)}" x2="{_n(x2)}" y2="{_n(y2)}"/>'


def _text(place: FloatArray, turn: float, text: str, how: str = "") -> str:
    turned = f"translate({_n(place[0])} {_n(place[1])}) rotate({_n(turn)})"
    return f'<text{how} transform="{turned}">{escape(text)}</text>'


def _xy(place: FloatArray) -> str:
    return f"{_n(place[0])} {_n(place[1])}"


def _n(value: float) -> str:
    """A number of millimetres to the hundredth, without needless digits."""
    return f"{round(float(value), 2) + 0.0:g}"
