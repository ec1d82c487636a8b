# SPDX-License-Identifier: MIT
"""Floor plans: stations from above, with those that were given, the zones and the ways between them.

A storey plan shows the walls, rooms and stations of one storey to scale, for paper and for a page.
"""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PathCollection
from matplotlib.figure import Figure
from matplotlib.path import Path as PlotPath

from nbv.report.figures.labels import Label, write_labels
from nbv.report.figures.picture import Picture
from nbv.report.figures.plots import LIGHT, Plot, Theme, drawn_plot
from nbv.run.wording import count, letters
from nbv.visibility.zones import EVERYWHERE, Box, Zones
from scenes.checks import FloatArray

_NOWHERE = np.zeros((0, 3))
_FAINT = 0.13  # opacity of a field of view
_MOST_NUMBERS = 6  # spelled out at one place of the plan
_DARK_GROUND = "#1d282f"  # of cards on dark pages, as style.css has it


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FloorPlan:
    """What a floor plan shows; metres, world coordinates.

    Attributes
    ----------
    outline : (k, 2, 2) float
        Segments of walls and objects at the height of the cut.
    bounds : (2, 3) float
        What to show at least.
    positions, given : (n, 3), (m, 3) float
        Stations in order, numbered from 1; and those that had been there before, with letters.
    fields, given_fields : sequences of (k, 2) float
        Outline of what each of these sees from above; none where that is not to be shown.
    highlighted : sequence of int
        Stations in the colour of what is inferred, counted from 0.
    ways : sequence of (k, 3) float
        Ways from station to station.
    """

    outline: FloatArray
    bounds: FloatArray
    positions: FloatArray
    fields: Sequence[FloatArray] = ()
    highlighted: Sequence[int] = ()
    given: FloatArray = field(default_factory=lambda: _NOWHERE)
    given_fields: Sequence[FloatArray] = ()
    ways: Sequence[FloatArray] = ()
    zones: Zones = EVERYWHERE

    def plot(self) -> Plot:
        """Return it as a picture."""
        low, high = self._extent()
        extent = np.maximum(high - low, 1e-6)
        width = 4.9 if extent[0] >= extent[1] else 4.2
        height = float(np.clip(width * extent[1] / extent[0], 2.2, 6.5))

        def draw(axes: Axes, theme: Theme) -> None:
            lines = list(self.outline)
            axes.add_collection(
                LineCollection(lines, colors=theme.ink, linewidths=1.6, capstyle="round", zorder=2)
            )
            for way in self.ways:
                axes.plot(way[:, 0], way[:, 1], color=theme.accent, linewidth=1, alpha=0.6, zorder=2)
            draw_zones(axes, theme, self.zones)
            size = 0.07 * float(extent.max())
            _draw_fields(axes, self.given_fields, [theme.faint] * len(self.given_fields))
            self._draw_stations(axes, theme)
            _set_frame(axes, low, high, 0.06 * float(extent.max()))
            numbers = [str(number) for number in range(1, len(self.positions) + 1)]
            names = [letters(number) for number in range(len(self.given))]
            labels = _near_labels(self.positions, numbers, theme.accent, _DOT_PT, size)
            labels += _near_labels(self.given, names, theme.ink, _SQUARE_PT, size)
            write_labels(axes, labels, [*self.outline, *(way[:, :2] for way in self.ways)])

        return drawn_plot(draw, (width + 0.5, height + 0.4))

    def _extent(self) -> tuple[FloatArray, FloatArray]:
        """Return the smallest and the largest x and y of all there is to see."""
        boxes = [*self.zones.keep_out, *([self.zones.region] if self.zones.region else [])]
        corners = [np.stack([box.low, box.high]) for box in boxes]
        points = np.vstack([self.bounds, self.positions, self.given, *corners])[:, :2]
        return points.min(axis=0), points.max(axis=0)

    def _draw_stations(self, axes: Axes, theme: Theme) -> None:
        if len(self.given):
            x, y = self.given[:, :2].T
            axes.scatter(x, y, s=34, marker="s", facecolors="none", edgecolors=theme.ink, zorder=4)
        if not len(self.positions):
            return
        special = set(self.highlighted)
        colours = [theme.inferred if k in special else theme.line for k in range(len(self.positions))]
        x, y = self.positions[:, 0], self.positions[:, 1]
        _draw_fields(axes, self.fields, colours)
        axes.scatter(x, y, s=22, color=colours, zorder=4, linewidths=0)


def _draw_fields(axes: Axes, fields: Sequence[FloatArray], colours: Sequence[str]) -> None:
    """Draw what stations see, faintly, so that many of them lie over each other."""
    for outline, colour in zip(fields, colours, strict=False):
        axes.fill(*outline.T, facecolor=colour, alpha=_FAINT, linewidth=0, zorder=3)
        axes.plot(*outline.T, color=colour, alpha=0.55, linewidth=0.7, zorder=3)


def draw_zones(axes: Axes, theme: Theme, zones: Zones) -> None:
    """Draw the region in dashes, and hatch what is to be kept out of."""
    if zones.region is not None:
        x, y = _corner_ring(zones.region)
        axes.plot(x, y, color=theme.accent, linewidth=1.3, linestyle="--", zorder=2)
    for box in zones.keep_out:
        x, y = _corner_ring(box)
        axes.fill(x, y, facecolor="none", edgecolor=theme.faint, hatch="////", linewidth=0.9, zorder=2)


def _corner_ring(box: Box) -> tuple[FloatArray, FloatArray]:
    """Return x and y of a box's corners seen from above, the first once more at the end."""
    (x0, y0), (x1, y1) = box.low[:2], box.high[:2]
    return np.array([x0, x1, x1, x0, x0]), np.array([y0, y0, y1, y1, y0])


def _near_labels(
    positions: FloatArray, names: Sequence[str], colour: str, dot_pt: float, size: float
) -> list[Label]:
    """The names of stations at each place, those together that lie within a third of `size`."""
    places: dict[tuple[float, float], list[str]] = {}
    for name, (x, y) in zip(names, positions[:, :2].tolist(), strict=True):
        near = (place for place in places if np.hypot(place[0] - x, place[1] - y) < size / 3)
        places.setdefault(next(near, (x, y)), []).append(name)
    return [
        Label(joined_numbers(here), np.array(place), colour, _NUMBER_PT, dot_pt)
        for place, here in places.items()
    ]


def joined_numbers(names: Sequence[str]) -> str:
    """Return the names at one place of a plan; of many the first."""
    return ",".join(names[:_MOST_NUMBERS]) + (" ..." if len(names) > _MOST_NUMBERS else "")


_SCALES = (20, 50, 100, 200, 500, 1000, 2000, 5000)
_PAPER_M = (0.40, 0.27)  # an A3 sheet within its margins
_MARGIN_IN = 0.65
_FOOT_IN = 0.75  # below the plan: scale bar and text
_PAGE_IN = 4.9  # width in a report
_INCH_M = 0.0254
_NAME_PT, _NUMBER_PT, _DOT_PT = 6.5, 8.0, 4.8  # of rooms, of stations, and across these
_SQUARE_PT = 6.0  # across a scan
_HEADING_M = 0.6  # length of the stroke that shows where a camera looks


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class StoreyPlan:
    """One storey from above; metres, world coordinates.

    Attributes
    ----------
    storey : int
        Its number.
    title : str
        What it shows.
    outline : (k, 2, 2) float
        Where a level plane at `cut_m` cuts walls and furniture.
    cut_m : float
        Height of that plane above the storey's floor.
    rooms : sequence of (str, (2,) float)
        Text and place of each room's label.
    stations : sequence of (str, (2,) float, sequence of float)
        Number and place of each station, and the headings of its views, degrees clockwise from +y.
    ways : sequence of (k, 2) float
        What of the tour lies on this storey.
    given : sequence of (str, (2,) float)
        Name and place of each scan that had been taken before.
    zones : Zones
        Where surface counts, and where no station may be.
    fills : sequence of (sequence of Path, str, str)
        Areas, their colour, and the pattern that lies over it, as matplotlib names hatches.
    """

    storey: int
    title: str
    outline: FloatArray
    cut_m: float
    rooms: Sequence[tuple[str, FloatArray]]
    stations: Sequence[tuple[str, FloatArray, Sequence[float]]]
    ways: Sequence[FloatArray] = ()
    given: Sequence[tuple[str, FloatArray]] = ()
    zones: Zones = EVERYWHERE
    fills: Sequence[tuple[Sequence[PlotPath], str, str]] = ()
    numbers: str = "their numbers"

    def plot(self, title: str, caption: str = "") -> Picture:
        """Return it as a picture of a page, no scale promised; the caption says what has no label."""
        low, high = self.extent()
        size = np.maximum(high - low, 1e-6)
        height, left_out = float(np.clip(_PAGE_IN * size[1] / size[0], 2.2, 6.5)), list[int]()

        def draw(axes: Axes, theme: Theme) -> None:
            left_out.append(self._draw(axes, theme, 0.04 * float(size.max())))

        plot = drawn_plot(draw, (_PAGE_IN + 0.5, height + 0.4))
        if left_out[0]:
            caption += f" {count(left_out[0], 'label')} found no room."
        return plot.picture(title, caption)

    def picture(self) -> Picture:
        """Return it as a picture of a page that says what it shows."""
        strokes = ", their strokes where views look" if any(stroke for *_, stroke in self.stations) else ""
        caption = f"Dots are stations by {self.numbers}{strokes}. " if self.stations else ""
        caption += f"Walls are cut {self.cut_m:.2f} m above the floor."
        caption += " Squares with letters: scans that have been taken." if self.given else ""
        caption += " Lines: what of the tour lies here." if self.ways else ""
        return self.plot(f"Storey {self.storey}.", caption)

    def svg(self) -> bytes:
        """Return it as SVG to scale, texts as texts."""
        data = io.BytesIO()
        with _plot_settings():
            self.sheet().savefig(data, format="svg", metadata={"Date": None, "Creator": None})
        return data.getvalue()

    def extent(self) -> tuple[FloatArray, FloatArray]:
        """Return the smallest and the largest x and y, (2,) each, of all there is to see."""
        parts = [self.outline.reshape(-1, 2), *(np.reshape(way, (-1, 2)) for way in self.ways)]
        parts += [np.array([place for _, place, _ in self.stations]).reshape(-1, 2)]
        parts += [np.array([place for _, place in [*self.rooms, *self.given]]).reshape(-1, 2)]
        points = np.vstack(parts)
        return points.min(axis=0), points.max(axis=0)

    def sheet(self) -> Figure:
        """Draw the sheet: the plan to scale, a scale bar and what the signs mean below it."""
        _settle()
        low, high = self.extent()
        pad = 0.3
        size = high - low + 2 * pad
        scale = next((s for s in _SCALES if (size / s <= _PAPER_M).all()), _SCALES[-1])
        inches = size / scale / _INCH_M
        sheet = np.maximum(inches + [2 * _MARGIN_IN, 2 * _MARGIN_IN + _FOOT_IN], [4.6, 3.2])
        figure = Figure(figsize=tuple(sheet.tolist()))
        left, bottom = (sheet[0] - inches[0]) / 2, _MARGIN_IN + _FOOT_IN
        bottom += (sheet[1] - _FOOT_IN - 2 * _MARGIN_IN - inches[1]) / 2
        axes = figure.add_axes((left / sheet[0], bottom / sheet[1], *(inches / sheet).tolist()))
        self._draw(axes, LIGHT, pad)
        title = f"{self.title}\n1:{scale}, cut {self.cut_m:.2f} m above the floor"
        axes.set_title(title, fontsize=9, loc="left", color=LIGHT.ink, parse_math=False)
        _draw_scale_bar(figure, sheet, left, scale)
        return figure

    def _draw(self, axes: Axes, theme: Theme, pad: float) -> int:
        """Draw all, with `pad` metres around it, and return how many labels found no room."""
        for areas, colour, pattern in self.fills:
            axes.add_collection(
                PathCollection(areas, facecolors=colour, edgecolors="white", hatch=pattern, linewidths=0)
            )
        axes.add_collection(
            LineCollection(list(self.outline), colors=theme.ink, linewidths=0.5 if self.fills else 1.3)
        )
        for way in self.ways:
            axes.plot(way[:, 0], way[:, 1], color=theme.accent, linewidth=0.9, alpha=0.75, zorder=2)
        draw_zones(axes, theme, self.zones)
        for _, place in self.given:
            axes.plot(*place, "s", markersize=_SQUARE_PT, color=theme.ink, fillstyle="none", zorder=4)
        strokes = list[FloatArray]()
        for _, place, headings in self.stations:
            for heading in headings:
                turn = np.radians(heading)
                end = place + _HEADING_M * np.array([np.sin(turn), np.cos(turn)])
                strokes.append(np.stack([place, end]))
                axes.plot(*strokes[-1].T, color=theme.inferred, linewidth=0.8, zorder=4)
            axes.plot(*place, "o", markersize=_DOT_PT, color=theme.inferred, zorder=5)
        _set_frame(axes, *self.extent(), pad)
        _draw_north(axes, theme)
        return write_labels(axes, self._labels(theme), [*self.outline, *self.ways, *strokes])

    def _labels(self, theme: Theme) -> list[Label]:
        """Numbers of stations and scans beside their signs, and names of rooms."""
        ground = "white" if theme is LIGHT else _DARK_GROUND
        labels = [
            Label(text, place, theme.inferred, _NUMBER_PT, _DOT_PT, is_bold=True)
            for text, place, _ in self.stations
        ]
        labels += [
            Label(text, place, theme.ink, _NUMBER_PT, _SQUARE_PT, is_bold=True) for text, place in self.given
        ]
        return labels + [
            Label(text, place, theme.line, _NAME_PT, ground=ground) for text, place in self.rooms
        ]


def _set_frame(axes: Axes, low: FloatArray, high: FloatArray, pad: float) -> None:
    """Let a plan fill axes to scale, `pad` metres around it."""
    axes.set_aspect("equal")
    axes.set_xlim(low[0] - pad, high[0] + pad)
    axes.set_ylim(low[1] - pad, high[1] + pad)
    axes.set_xlabel("x, m")
    axes.set_ylabel("y, m")
    axes.grid(visible=False)


def sheets_pdf(plans: Sequence[StoreyPlan]) -> bytes:
    """Return the sheets of several storeys as one PDF."""
    from matplotlib.backends.backend_pdf import PdfPages  # slow to import, and plans alone have sheets

    data = io.BytesIO()
    entries = {"CreationDate": None, "Producer": None, "Creator": None}
    with _plot_settings(), PdfPages(data, metadata=entries) as pages:
        for plan in plans:
            pages.savefig(plan.sheet())
    return data.getvalue()


@contextmanager
def _plot_settings() -> Iterator[None]:
    """Leave matplotlib's settings as they were; a sign that the font has not is drawn as a box."""
    with mpl.rc_context(), warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph")
        yield


def _settle() -> None:
    """Set what the drawing depends on, whatever a machine is set to."""
    mpl.rcdefaults()
    mpl.rc("font", family="DejaVu Sans", size=8)
    mpl.rc("axes", labelcolor=LIGHT.ink, edgecolor=LIGHT.faint)
    mpl.rc("axes.spines", top=False, right=False)
    mpl.rc("svg", fonttype="none", hashsalt="unseen")
    for axis in ("xtick", "ytick"):
        mpl.rc(axis, color=LIGHT.ink)


def _draw_north(axes: Axes, theme: Theme) -> None:
    """Draw an arrow along the world's +y axis, from which headings count."""
    axes.annotate(
        "", (1, 1), xytext=(0, -22), xycoords="axes fraction", textcoords="offset points",
        arrowprops={"arrowstyle": "-|>", "color": theme.faint, "linewidth": 1.1, "shrinkA": 0, "shrinkB": 0},
        annotation_clip=False,
    )  # fmt: skip
    axes.annotate(
        "+y", (1, 1), xytext=(-4, -1), xycoords="axes fraction", textcoords="offset points", ha="right",
        va="top", fontsize=6.5, color=theme.faint, annotation_clip=False,
    )  # fmt: skip


def _draw_scale_bar(figure: Figure, sheet: FloatArray, left: float, scale: int) -> None:
    """Draw a bar of a round length, about a fifth of the sheet, below the plan."""
    wished = 0.25 * float(sheet[0]) * _INCH_M * scale
    length = max((m for m in (0.5, 1, 2, 5, 10, 20, 50, 100, 200) if m <= wished), default=0.5)
    inches = length / scale / _INCH_M
    axes = figure.add_axes((left / sheet[0], 0.28 / sheet[1], inches / sheet[0], 0.07 / sheet[1]))
    axes.barh([0, 0], [0.5, 0.5], left=[0, 0.5], height=1, color=[LIGHT.ink, "white"], edgecolor=LIGHT.ink)
    axes.set_xlim(0, 1)
    axes.set_ylim(-0.5, 0.5)
    axes.set_yticks([])
    axes.set_xticks([0, 0.5, 1], ["0", f"{length / 2:g}", f"{length:g} m"], fontsize=7)
    axes.tick_params(length=0, pad=2)
