# SPDX-License-Identifier: MIT
"""The graph of relations drawn: surfaces on a ring, those of one direction side by side, lines between."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from completion.relations.engine.relation import Relation, RelationKind, Status
from completion.relations.frames import shared_directions
from completion.relations.graph import RelationGraph
from nbv.report.figures.plots import Plot, Theme, drawn_plot
from scenes.checks import FloatArray
from scenes.scan.colour import surface_colour

MOST_SURFACES = 60
"""Surfaces, of which more are too many for a drawing."""
_GAP = 0.6  # between directions, of the step between surfaces
_PULL = 0.35  # of the way to the middle that a line keeps away from the ring
_SIZE = (6.2, 6.2)  # inches
_REJECTED = "#c8322b"
_RADII = "#2f8f5b"
_FAMILIES: tuple[tuple[str, str, tuple[RelationKind, ...]], ...] = (
    ("at right angles, at an angle", "line", ("perpendicular", "angle")),
    ("in one plane, on one axis", "accent", ("coplanar", "coaxial", "axis_in_plane")),
    ("of one radius", _RADII, ("equal_radius", "equal_ring_radius")),
    ("apart, evenly spaced, images", "inferred", ("distance", "equal_distance", "regular", "symmetric")),
)


def relation_graph(graph: RelationGraph, names: Sequence[int], places: Sequence[int]) -> Plot:
    """Draw what n surfaces are to each other.

    A band outside joins surfaces of one direction; lines are the accepted relations between others, thin ones
    what these entail, and broken ones what was rejected.

    Parameters
    ----------
    graph : RelationGraph
        At most 60 surfaces.
    names, places : sequence of int
        What the report calls them (n,), and their places (n,) in the palette, from 1.
    """
    groups = shared_directions(graph)
    groups += [[number] for number in range(len(graph.fits)) if not any(number in own for own in groups)]
    angle = _angles(groups, len(graph.fits))
    at = np.stack([np.sin(angle), np.cos(angle)], axis=1)

    def draw(axes: Axes, theme: Theme) -> None:
        axes.set_axis_off()
        axes.set_aspect("equal")
        axes.set_xlim(-1.32, 1.32)
        axes.set_ylim(-1.5, 1.32)
        for own in groups:
            if len(own) > 1:
                round_ = np.linspace(angle[own[0]], angle[own[-1]], 40)
                axes.plot(1.2 * np.sin(round_), 1.2 * np.cos(round_), color=theme.faint, linewidth=3,
                          solid_capstyle="round")  # fmt: skip
        for relation in sorted(graph.relations, key=lambda one: one.status is Status.ACCEPTED):
            colour = _colour(relation, theme)
            if colour:
                for one, two in _lines(relation):
                    _connect(axes, at[one], at[two], colour, relation.status)
        for number, (name, place) in enumerate(zip(names, places, strict=True)):
            axes.plot(*at[number], "o", color=surface_colour(place), markersize=9, zorder=4)
            axes.annotate(str(name), 1.1 * at[number], ha="center", va="center", fontsize=8, color=theme.ink)
        _legend(axes, theme)

    return drawn_plot(draw, _SIZE)


def _angles(groups: Sequence[Sequence[int]], n: int) -> FloatArray:
    """Where each of n surfaces is on the ring, radians from the top, those of a group side by side."""
    angle, step = np.zeros(n), 2 * np.pi / (n + _GAP * len(groups))
    here = 0.0
    for own in groups:
        for number in own:
            angle[number] = here
            here += step
        here += _GAP * step
    return angle


def _lines(relation: Relation) -> Iterator[tuple[int, int]]:
    """Which surfaces a relation's lines join: one after the other in a row, else by pairs."""
    surfaces = relation.surfaces
    yield from (
        pairwise(surfaces) if relation.kind == "regular" else zip(surfaces[::2], surfaces[1::2], strict=False)
    )


def _colour(relation: Relation, theme: Theme) -> str:
    """The colour of a relation's lines; none of what is not drawn."""
    if relation.status is Status.UNDECIDED:
        return ""
    if relation.status is Status.REJECTED:
        return _REJECTED
    return next((_of(name, theme) for _, name, kinds in _FAMILIES if relation.kind in kinds), "")


def _of(name: str, theme: Theme) -> str:
    """A colour by itself, or by its name in the theme."""
    return name if name.startswith("#") else str(getattr(theme, name))


def _connect(axes: Axes, one: FloatArray, two: FloatArray, colour: str, status: Status) -> None:
    """A line that bends towards the middle."""
    share = np.linspace(0, 1, 30)[:, None]
    middle = (1 - _PULL) * (one + two) / 2
    way = (1 - share) ** 2 * one + 2 * share * (1 - share) * middle + share**2 * two
    is_accepted, is_rejected = status is Status.ACCEPTED, status is Status.REJECTED
    axes.plot(
        *way.T,
        color=colour,
        linewidth=1.6 if is_accepted else 0.9,
        alpha=1.0 if is_accepted or is_rejected else 0.35,
        linestyle="--" if is_rejected else "-",
        zorder=3.5 if is_rejected else 3 if is_accepted else 2,
    )


def _legend(axes: Axes, theme: Theme) -> None:
    shown = [Line2D([], [], color=theme.faint, linewidth=3, label="one direction")]
    shown += [Line2D([], [], color=_of(name, theme), label=label) for label, name, _ in _FAMILIES]
    shown.append(Line2D([], [], color=_REJECTED, linestyle="--", label="rejected"))
    axes.legend(handles=shown, loc="lower center", ncols=2, frameon=False, fontsize=7.5, labelcolor=theme.ink)
