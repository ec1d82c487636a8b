# SPDX-License-Identifier: MIT
"""Plans of registered scans: what each measured from above, by how much they differ, and other poses."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from completion.registration.motions import composed
from completion.registration.network import Network
from completion.registration.registered import PairVerdict
from nbv.report.figures.plots import Plot, Theme, drawn_plot
from scenes.checks import FloatArray
from scenes.scan.colour import surface_colour

_SIZE, _SMALL = (6.2, 6.2), (3.6, 3.6)  # inches
_SPREAD = 3.0  # median sizes of residuals at which colours end
_LEAST_MM = 1e-3


def registration_plan(network: Network, places: Sequence[FloatArray], world: FloatArray) -> Plot:
    """Draw the facets of each scan of a group from above, its place, and the pairs that share surface.

    Parameters
    ----------
    network : Network
        The group.
    places : sequence of (n, 3) float
        The facets of all scans, each in its own frame, metres.
    world : (3, 4) float
        The pose of the group's first scan in the world, whose z is up.
    """
    poses = {number: composed(world, pose) for number, pose in network.group.poses.items()}

    def draw(axes: Axes, theme: Theme) -> None:
        for number, pose in poses.items():
            _dots(axes, places[number], pose, surface_colour(number + 1))
        for edge in network.edges:
            ends = np.array([poses[number][:2, 3] for number in edge.scans])
            axes.plot(ends[:, 0], ends[:, 1], color=theme.ink, linewidth=0.8)
        for number, pose in poses.items():
            _station(axes, theme, number, pose)
        _label(axes)

    return drawn_plot(draw, _SIZE)


def residual_plan(places: FloatArray, offsets: FloatArray, world: FloatArray) -> Plot:
    """Draw from above by how much facets of scans are off where they met.

    Parameters
    ----------
    places : (n, 3) float
        Where they met, frame of the group, metres.
    offsets : (n,) float
        By how much, metres.
    world : (3, 4) float
        The pose of the group's frame in the world, whose z is up.
    """
    there = places @ world[:, :3].T + world[:, 3]
    end = max(_SPREAD * 1000 * float(np.median(np.abs(offsets))), _LEAST_MM)

    def draw(axes: Axes, theme: Theme) -> None:
        dots = axes.scatter(
            there[:, 0], there[:, 1], c=1000 * offsets, s=3, cmap="coolwarm", vmin=-end, vmax=end
        )
        bar = axes.figure.colorbar(dots, ax=axes, shrink=0.7)
        bar.set_label("behind the earlier scan, mm", color=theme.ink)
        bar.ax.tick_params(colors=theme.ink)
        _label(axes)

    return drawn_plot(draw, _SIZE)


def alternative_plan(pair: PairVerdict, number: int, places: Sequence[FloatArray], world: FloatArray) -> Plot:
    """Draw one of the poses that two scans may have to each other from above, in the first one's world.

    Parameters
    ----------
    pair : PairVerdict
        The two.
    number : int
        Which of its alternatives.
    places : sequence of (n, 3) float
        The facets of all scans, each in its own frame, metres.
    world : (3, 4) float
        The pose of the first scan.
    """
    first, second = pair.scans
    pose = composed(world, pair.alternatives[number])

    def draw(axes: Axes, theme: Theme) -> None:
        for scan, own in ((first, world), (second, pose)):
            _dots(axes, places[scan], own, surface_colour(scan + 1))
            _station(axes, theme, scan, own)
        _label(axes)

    return drawn_plot(draw, _SMALL)


def _dots(axes: Axes, places: FloatArray, pose: FloatArray, colour: str) -> None:
    """Facets (n, 3) at a pose (3, 4)."""
    there = places @ pose[:, :3].T + pose[:, 3]
    axes.plot(there[:, 0], there[:, 1], ".", color=colour, markersize=1.6)


def _station(axes: Axes, theme: Theme, number: int, pose: FloatArray) -> None:
    """The place of a scan, with its number."""
    x, y = float(pose[0, 3]), float(pose[1, 3])
    axes.plot(x, y, "o", color=surface_colour(number + 1), markeredgecolor=theme.ink, zorder=4)
    axes.annotate(str(number + 1), (x, y), xytext=(6, 6), textcoords="offset points", color=theme.ink)


def _label(axes: Axes) -> None:
    axes.set_aspect("equal")
    axes.set_xlabel("x, m")
    axes.set_ylabel("y, m")
