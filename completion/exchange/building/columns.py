# SPDX-License-Identifier: MIT
"""Columns and pipes: solid cylinders, and four upright planes around a post."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
import shapely

from completion.exchange.building.areas import common, joined
from completion.exchange.building.bodies import Body
from completion.exchange.building.elements import CylinderElement
from completion.exchange.building.faces import LEVEL
from completion.exchange.building.storeys import Storey

_LEAST_RADIUS_M, _LEAST_HIGH_M = 0.05, 1.5  # of a column
_FOOT_M = 0.15  # between a column and the floor that it stands on
_PIPE_RADIUS_M, _PIPE_LONG_M, _SLENDER = 0.3, 0.3, 2.0  # of a pipe at most, at least; diameters in its length
_SAME = 0.7  # of the footprint of two walls across each other, which are the sides of one post then


@dataclass(frozen=True, slots=True, eq=False)
class Column:
    """A column.

    Attributes
    ----------
    surfaces : tuple of int
        Its cylinder, or its four planes.
    cylinder : CylinderElement or None
        None of one with four sides.
    footprint : shapely polygon
        Seen from above, world x and y.
    bottom_m, top_m : float
        Heights of its ends.
    sd_m : float
        Standard deviation of its radius, or of its thicker side.
    measured_share : float
        Of its sides.
    """

    surfaces: tuple[int, ...]
    cylinder: CylinderElement | None
    footprint: Any
    bottom_m: float
    top_m: float
    sd_m: float
    measured_share: float


def find_columns(
    cylinders: Sequence[CylinderElement], bodies: Sequence[Body], storeys: Sequence[Storey]
) -> tuple[Column, ...]:
    """Return what stands on a floor: upright solid cylinders, and posts of four planes."""
    floors = [face for storey in storeys for face in storey.floors]
    levels = [storey.elevation_m for storey in storeys]
    found = [_round(one) for one in cylinders if _is_upright(one)]
    found += [
        post
        for one, other in combinations([body for body in bodies if body.kind == "wall"], 2)
        if (post := _post(one, other)) is not None
    ]
    return tuple(
        one
        for one in found
        if floors
        and one.top_m - one.bottom_m >= _LEAST_HIGH_M
        and min(abs(one.bottom_m - level) for level in levels) < _FOOT_M
    )


def find_pipes(
    cylinders: Sequence[CylinderElement], columns: Sequence[Column]
) -> tuple[CylinderElement, ...]:
    """Return the straight segments of pipes: slender solid cylinders that are no columns."""
    taken = {number for column in columns for number in column.surfaces}
    return tuple(
        one
        for one in cylinders
        if one.number not in taken
        and one.is_solid
        and one.radius_m <= _PIPE_RADIUS_M
        and one.length_m >= max(_PIPE_LONG_M, 2 * _SLENDER * one.radius_m)
    )


def _is_upright(one: CylinderElement) -> bool:
    if not one.is_solid or one.radius_m < _LEAST_RADIUS_M or one.length_m <= 0:
        return False
    return abs(float(one.ends[1, 2] - one.ends[0, 2])) >= LEVEL * one.length_m


def _round(one: CylinderElement) -> Column:
    middle = one.ends.mean(axis=0)[:2]
    return Column(
        surfaces=(one.number,),
        cylinder=one,
        footprint=shapely.Point(middle).buffer(one.radius_m),
        bottom_m=float(one.ends[:, 2].min()),
        top_m=float(one.ends[:, 2].max()),
        sd_m=one.radius_sd_m,
        measured_share=one.measured_share,
    )


def _post(one: Body, other: Body) -> Column | None:
    """The post whose four sides two bodies are, across each other; None where they are not."""
    prints = [_footprint(body) for body in (one, other)]
    shared = common(*prints)
    if shared.is_empty or shared.area < _SAME * max(part.area for part in prints):
        return None
    if abs(float(one.frame.normal @ other.frame.normal)) > np.sin(np.radians(10.0)):
        return None
    heights = [body.frame.place(shapely.get_coordinates(body.area))[:, 2] for body in (one, other)]
    return Column(
        surfaces=(*one.surfaces, *other.surfaces),
        cylinder=None,
        footprint=shared.convex_hull,
        bottom_m=float(min(z.min() for z in heights)),
        top_m=float(max(z.max() for z in heights)),
        sd_m=max(one.thickness_sd_m, other.thickness_sd_m),
        measured_share=float(np.mean([one.measured_share, other.measured_share])),
    )


def _footprint(body: Body) -> Any:
    """A body seen from above."""
    uv = shapely.get_coordinates(body.area)
    ends = body.frame.place(np.array([[uv[:, 0].min(), 0.0], [uv[:, 0].max(), 0.0]]))[:, :2]
    depth = body.thickness_m * body.frame.normal[:2]
    return joined([shapely.Polygon([*ends, *(ends[::-1] - depth)])])
