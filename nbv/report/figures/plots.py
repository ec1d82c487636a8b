# SPDX-License-Identifier: MIT
"""Plots: curves of coverage, in both themes."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from PIL import Image

from nbv.report.figures.picture import Picture
from scenes.checks import FloatArray

_DPI = 180
_DASHES = ((1, 1.5), (4, 1.5), (6, 1.5, 1, 1.5), (10, 2))  # of other planners' curves
_LAST_STEP = 0.6  # views that the last of stacked steps is wide


@dataclass(frozen=True, slots=True)
class Theme:
    """Colours of a plot on a light or a dark page."""

    ink: str
    faint: str
    line: str
    accent: str
    fill: str
    measured: str
    modelled: str
    dot: str
    inferred: str


LIGHT = Theme(
    ink="#22313a", faint="#8b979d", line="#4a5a63", accent="#b36b00", fill="#e8edf0",
    measured="#9ea3a3", modelled="#dbe0e0", dot="#6c7377", inferred="#2e7acc",
)  # fmt: skip
_DARK = Theme(
    ink="#dfe6ea", faint="#7d8a92", line="#b4c2c9", accent="#f0ad3d", fill="#26323a",
    measured="#9ea3a3", modelled="#dbe0e0", dot="#6c7377", inferred="#5aa2ea",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Plot:
    """The same plot for light and dark pages, PNG with a see-through ground; size in pixels."""

    light: bytes
    dark: bytes
    width: int
    height: int

    def picture(self, title: str, caption: str = "") -> Picture:
        """Return it as a picture of a page."""
        return Picture(title, caption, self.light, self.width, self.height, dark_png=self.dark)


def coverage_curve(
    met: Sequence[float],
    reachable: float | None,
    target: float | None,
    bound: int | None,
    inferred: tuple[int, float, float] | None = None,
    start: float = 0.0,
    others: Mapping[str, FloatArray] | None = None,
) -> Plot:
    """Plot the measured share of the area against the number of views.

    `met` is the share after each view, `start` that before the first; `target` is a share of what is
    `reachable`, and `bound` the number of views that any plan needs. `inferred` are a number of scans, the
    share that they measured, and the share after what was inferred from them; `others` the shares (n,) that
    other planners reach, by name.
    """

    def draw(axes: Axes, theme: Theme) -> None:
        views = np.arange(len(met) + 1)
        share = 100 * np.array([start, *met])
        axes.fill_between(views, share, step="post", color=theme.line, alpha=0.14, linewidth=0)
        for (name, curve), dashes in zip((others or {}).items(), _DASHES, strict=False):
            steps = np.arange(len(curve) + 1)
            axes.plot(steps, 100 * np.array([start, *curve]), color=theme.faint, linewidth=1.2, dashes=dashes,
                      label=name)  # fmt: skip
        if others:
            axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=2, frameon=False, fontsize=7.5,
                        handlelength=2.6, borderaxespad=0.2, labelcolor=theme.ink)  # fmt: skip
        axes.step(views, share, where="post", color=theme.line, linewidth=2)
        axes.plot(views[1:], share[1:], "o", color=theme.line, markersize=3.2 if len(met) <= 60 else 0)
        last = max(len(met), bound or 0, 1)
        if reachable is not None:
            _level(axes, 100 * reachable, "reachable", theme)
            if target is not None and target < 1:
                _level(axes, 100 * reachable * target, f"target {100 * target:g} % of it", theme, below=True)
        if bound:
            axes.axvline(bound, color=theme.faint, linewidth=1, linestyle=":")
            right = bound > 0.5 * last
            axes.annotate(
                f"the target takes {bound} or more", (bound, 4),
                xytext=(-4 if right else 4, 0), ha="right" if right else "left",
                textcoords="offset points", color=theme.faint, fontsize=8,
            )  # fmt: skip
        if inferred:
            n_scans, low, high = inferred
            axes.plot([n_scans] * 2, [100 * low, 100 * high], color=theme.inferred, linewidth=6, zorder=4,
                      solid_capstyle="butt")  # fmt: skip
            axes.annotate(
                f"{100 * high:.0f} % by {n_scans} scans\nand inference", (n_scans, 100 * high),
                ha="right" if n_scans > 0.6 * last else "left", va="top",
                xytext=(-6 if n_scans > 0.6 * last else 6, 0), textcoords="offset points",
                color=theme.inferred, fontsize=8.5, fontweight="bold",
            )  # fmt: skip
        axes.set_xlim(0, last * 1.02)
        label_views(axes, "measured as required, % of the area")

    return drawn_plot(draw, (5.4, 4.1))


def class_curve(tops: FloatArray, reachable: float, target: float | None) -> Plot:
    """Plot the shares of the area that are measured as required, modelled and inferred, as stacked steps.

    `tops` (3, n + 1) are what is measured; that or modelled; these or inferred: before the first view and
    after each. The target is a share of what is reachable.
    """

    def draw(axes: Axes, theme: Theme) -> None:
        n = tops.shape[1] - 1
        views = np.append(np.arange(n + 1), n + _LAST_STEP)
        levels = 100 * np.vstack([np.zeros(n + 1), tops])
        levels = np.hstack([levels, levels[:, -1:]])
        styles = (
            ("measured as required", theme.measured, None),
            ("modelled", theme.modelled, "...."),
            ("inferred", theme.inferred, None),
        )
        for below, above, (name, colour, pattern) in zip(levels, levels[1:], styles, strict=False):
            label = f"{name} {above[-1] - below[-1]:.1f} %"
            axes.fill_between(views, below, above, step="post", facecolor=colour, hatch=pattern, linewidth=0,
                              edgecolor=theme.dot, label=label)  # fmt: skip
        axes.step(views, levels[1], where="post", color=theme.line, linewidth=2)
        _level(axes, 100 * reachable, "reachable", theme)
        if target is not None and target < 1:
            _level(axes, 100 * reachable * target, f"target {100 * target:g} % of it", theme, below=True)
        axes.set_xlim(0, n + _LAST_STEP)
        label_views(axes, "% of the area")
        axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=3, frameon=False, fontsize=8,
                    handlelength=1.4, columnspacing=1.2, borderaxespad=0.2)  # fmt: skip

    return drawn_plot(draw, (5.4, 4.1))


def label_views(axes: Axes, text: str, top: float = 106) -> None:
    """Let views run to the right, and percent with the label `text` up to `top`."""
    axes.set_ylim(0, top)
    axes.set_xlabel("views")
    axes.set_ylabel(text)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))


def _level(axes: Axes, percent: float, text: str, theme: Theme, *, below: bool = False) -> None:
    axes.axhline(percent, color=theme.accent, linewidth=1.1, linestyle="--" if below else "-")
    axes.annotate(
        f"{text} {percent:.1f} %" if not below else text, (0, percent), xytext=(5, -10 if below else 3),
        textcoords="offset points", color=theme.accent, fontsize=8,
    )  # fmt: skip


def on_white(plot: Plot) -> bytes:
    """Return the light plot on a white ground, PNG."""
    image = Image.open(io.BytesIO(plot.light)).convert("RGBA")
    ground, data = Image.new("RGBA", image.size, "white"), io.BytesIO()
    Image.alpha_composite(ground, image).convert("RGB").save(data, "PNG")
    return data.getvalue()


def drawn_plot(draw: Callable[[Axes, Theme], None], size: tuple[float, float]) -> Plot:
    """Return the plot that `draw` makes of an axes, in both themes; `size` in inches."""
    drawn = {theme: _draw_figure(draw, theme, size) for theme in dict.fromkeys((LIGHT, _DARK))}
    return Plot(drawn[LIGHT], drawn[_DARK], round(size[0] * _DPI), round(size[1] * _DPI))


def _draw_figure(draw: Callable[[Axes, Theme], None], theme: Theme, size: tuple[float, float]) -> bytes:
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rc("font", family="DejaVu Sans", size=9)
        mpl.rc("text", color=theme.ink)
        mpl.rc("axes", labelcolor=theme.ink, edgecolor=theme.faint, grid=True, axisbelow=True)
        mpl.rc("axes.spines", top=False, right=False)
        mpl.rc("grid", color=theme.fill, linewidth=0.8)
        for axis in ("xtick", "ytick"):
            mpl.rc(axis, color=theme.ink)
        figure = Figure(figsize=size, dpi=_DPI, layout="constrained", facecolor="none")
        axes = figure.add_subplot(facecolor="none")
        draw(axes, theme)
        canvas: Any = FigureCanvasAgg(figure)  # its methods have no types
        data = io.BytesIO()
        canvas.draw()  # once: `savefig` draws all of it once more before, for the layout
        Image.fromarray(np.asarray(canvas.buffer_rgba())).save(data, "PNG")
    return data.getvalue()
