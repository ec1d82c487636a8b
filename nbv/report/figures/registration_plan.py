# SPDX-License-Identifier: MIT
"""The plan of a group of registered scans: what each measured, seen from above, and where it stood."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from completion.registration.candidates.motions import composed
from completion.registration.candidates.station_view import StationView
from completion.registration.network import Network
from nbv.report.figures.plots import Plot, Theme, drawn_plot
from scenes.checks import FloatArray
from scenes.scan.palette import surface_colour

_SIZE = (6.2, 6.2)  # inches


def registration_plan(network: Network, views: Sequence[StationView], world: FloatArray) -> Plot:
    """Draw the facets of each scan of a group from above, its place, and the pairs that share surface.

    Parameters
    ----------
    network : Network
        The group.
    views : sequence of StationView
        Of all scans.
    world : (3, 4) float
        The pose of the group's first scan in the world, whose z is up.
    """
    poses = {number: composed(world, pose) for number, pose in network.group.poses.items()}

    def draw(axes: Axes, theme: Theme) -> None:
        axes.set_aspect("equal")
        for number, pose in poses.items():
            places = views[number].facets.centre @ pose[:, :3].T + pose[:, 3]
            axes.plot(places[:, 0], places[:, 1], ".", color=surface_colour(number + 1), markersize=1.6)
        for edge in network.edges:
            ends = np.array([poses[number][:2, 3] for number in edge.scans])
            axes.plot(ends[:, 0], ends[:, 1], color=theme.ink, linewidth=0.8)
        for number, pose in poses.items():
            axes.plot(
                *pose[:2, 3], "o", color=surface_colour(number + 1), markeredgecolor=theme.ink, zorder=4
            )
            axes.annotate(
                str(number + 1),
                (float(pose[0, 3]), float(pose[1, 3])),
                xytext=(6, 6),
                textcoords="offset points",
                color=theme.ink,
            )
        axes.set_xlabel("x, m")
        axes.set_ylabel("y, m")

    return drawn_plot(draw, _SIZE)
