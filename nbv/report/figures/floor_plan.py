# SPDX-License-Identifier: MIT
"""Floor plan: stations from above, with those that were given, the zones and the ways between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection

from nbv.report.figures.plots import Plot, Theme, drawn_plot
from nbv.run.wording import letters
from nbv.visibility.zones import EVERYWHERE, Box, Zones
from scenes.checks import FloatArray

_NOWHERE = np.zeros((0, 3))
_FAINT = 0.13  # opacity of a field of view
_MOST_NUMBERS = 6  # spelled out at one place of the plan


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
            _draw_given(axes, theme, self.given, size)
            self._draw_stations(axes, theme, size)
            axes.set_aspect("equal")
            pad = 0.06 * float(extent.max())
            axes.set_xlim(low[0] - pad, high[0] + pad)
            axes.set_ylim(low[1] - pad, high[1] + pad)
            axes.set_xlabel("x, m")
            axes.set_ylabel("y, m")
            axes.grid(visible=False)

        return drawn_plot(draw, (width + 0.5, height + 0.4))

    def _extent(self) -> tuple[FloatArray, FloatArray]:
        """Return the smallest and the largest x and y of all there is to see."""
        boxes = [*self.zones.keep_out, *([self.zones.region] if self.zones.region else [])]
        corners = [np.stack([box.low, box.high]) for box in boxes]
        points = np.vstack([self.bounds, self.positions, self.given, *corners])[:, :2]
        return points.min(axis=0), points.max(axis=0)

    def _draw_stations(self, axes: Axes, theme: Theme, size: float) -> None:
        if not len(self.positions):
            return
        special = set(self.highlighted)
        colours = [theme.inferred if k in special else theme.line for k in range(len(self.positions))]
        x, y = self.positions[:, 0], self.positions[:, 1]
        _draw_fields(axes, self.fields, colours)
        axes.scatter(x, y, s=22, color=colours, zorder=4, linewidths=0)
        numbers = [str(number) for number in range(1, len(self.positions) + 1)]
        _label(axes, self.positions, names=numbers, colour=theme.accent, offset=(5, 5), size=size)


def _draw_fields(axes: Axes, fields: Sequence[FloatArray], colours: Sequence[str]) -> None:
    """Draw what stations see, faintly, so that many of them lie over each other."""
    for outline, colour in zip(fields, colours, strict=False):
        axes.fill(*outline.T, facecolor=colour, alpha=_FAINT, linewidth=0, zorder=3)
        axes.plot(*outline.T, color=colour, alpha=0.55, linewidth=0.7, zorder=3)


def _draw_given(axes: Axes, theme: Theme, given: FloatArray, size: float) -> None:
    """Draw the stations that had been there before."""
    if len(given):
        axes.scatter(
            given[:, 0], given[:, 1], s=34, marker="s", facecolors="none", edgecolors=theme.ink, zorder=4
        )
        names = [letters(number) for number in range(len(given))]
        _label(axes, given, names=names, colour=theme.ink, offset=(-6, -13), size=size)


def draw_zones(axes: Axes, theme: Theme, zones: Zones) -> None:
    """Draw the region in dashes, and hatch what is to be kept out of."""
    if zones.region is not None:
        x, y = _ring(zones.region)
        axes.plot(x, y, color=theme.accent, linewidth=1.3, linestyle="--", zorder=2)
    for box in zones.keep_out:
        x, y = _ring(box)
        axes.fill(x, y, facecolor="none", edgecolor=theme.faint, hatch="////", linewidth=0.9, zorder=2)


def _ring(box: Box) -> tuple[FloatArray, FloatArray]:
    """Return x and y of a box's corners seen from above, the first once more at the end."""
    (x0, y0), (x1, y1) = box.low[:2], box.high[:2]
    return np.array([x0, x1, x1, x0, x0]), np.array([y0, y0, y1, y1, y0])


def _label(
    axes: Axes, positions: FloatArray, names: Sequence[str], colour: str, offset: tuple[int, int], size: float
) -> None:
    """Write the names of the stations at each place, those together that lie within a third of `size`."""
    places: dict[tuple[float, float], list[str]] = {}
    for name, (x, y) in zip(names, positions[:, :2].tolist(), strict=True):
        near = (place for place in places if np.hypot(place[0] - x, place[1] - y) < size / 3)
        places.setdefault(next(near, (x, y)), []).append(name)
    for place, here in places.items():
        text = ",".join(here[:_MOST_NUMBERS]) + (" ..." if len(here) > _MOST_NUMBERS else "")
        axes.annotate(
            text, place, xytext=offset, textcoords="offset points", fontsize=7.5, color=colour, zorder=5
        )
