# SPDX-License-Identifier: MIT
"""Pipes and columns: radii, lengths, and how far columns stand apart."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from completion.exchange.building.building_model import BuildingModel
from completion.exchange.building.elements import CylinderElement
from completion.exchange.dimensions.dimension import Dimension, Support, half_interval
from completion.uncertainty.joint_errors import JointErrors
from scenes.checks import FloatArray

_UPRIGHT = float(np.cos(np.radians(5.0)))
_ENDS_IT = 0.5  # cosine between a plane's normal and an axis, from which on the plane ends a cylinder
_NEAR_CELLS = 3.0  # between a cylinder's last cells and the plane that ends it
_COLUMN_M = 0.06  # radius from which on an upright cylinder is a column, not a pipe


def cylinder_sizes(model: BuildingModel) -> tuple[Dimension, ...]:
    """Return radius and length of each solid cylinder, and the distances between neighbouring columns.

    A cylinder ends on the plane that it shares a fold with there. Without one it is as long as its measured
    and inferred cells, and its end is somewhere in the last of them. Columns are upright; their distance is
    taken between their axes, level, halfway up.
    """
    errors = model.errors
    solid = [one for one in model.cylinders if one.is_solid and one.length_m > 0]
    found = []
    for one in solid:
        found += _own(one, model)
    columns = [one for one in solid if is_column(one)]
    middles = [one.ends.mean(axis=0) for one in columns]
    for k, m in combinations(range(len(columns)), 2):
        ends = np.stack([middles[k], middles[m]])
        ends[:, 2] = ends[:, 2].mean()
        ends = np.stack([_on_axis(columns[k], ends[0]), _on_axis(columns[m], ends[1])])
        apart = np.linalg.norm(ends[1] - ends[0])
        between = [n for n in range(len(columns)) if n not in (k, m)]
        if all(np.linalg.norm(middles[n][:2] - ends.mean(axis=0)[:2]) >= apart / 2 for n in between):
            found.append(_spacing((columns[k], columns[m]), ends, errors))
    return tuple(found)


def is_column(cylinder: CylinderElement) -> bool:
    """Whether a cylinder is taken for a column: upright, and thicker than pipes are."""
    along = cylinder.ends[1] - cylinder.ends[0]
    return bool(abs(along[2]) >= _UPRIGHT * np.linalg.norm(along) and cylinder.radius_m >= _COLUMN_M)


def _own(cylinder: CylinderElement, model: BuildingModel) -> list[Dimension]:
    """Radius and length of a cylinder."""
    is_upright = is_column(cylinder)
    middle, along = cylinder.ends.mean(axis=0), _direction(cylinder)
    sides = [middle + cylinder.radius_m * way for way in _across(along)]
    around = tuple(Support(cylinder, side, -1.0 / len(sides)) for side in sides)
    rows = cylinder.patch.observed.any(axis=1), cylinder.patch.hypothesised.any(axis=1)
    seen = float(rows[0].sum() / max((rows[0] | rows[1]).sum(), 1))
    caps = [_end(cylinder, k, model) for k in (0, 1)]
    ends = np.stack([place for place, _ in caps])
    planes = tuple(on for _, on in caps if on is not None)
    step = float(cylinder.patch.grid.cell[1])
    radius = Dimension(
        kind="column radius" if is_upright else "pipe radius",
        value=cylinder.radius_m,
        half=half_interval(around, model.errors),
        supports=around,
        ends=np.stack([middle, sides[0]]),
        measured_share=1.0,
        existence=1.0,
    )
    length = Dimension(
        kind="column height" if is_upright else "pipe length",
        value=float(np.linalg.norm(ends[1] - ends[0])),
        half=half_interval(planes, model.errors, more_sd=step * np.sqrt((2 - len(planes)) / 12)),
        supports=(Support(cylinder, ends[0], 0.0), *planes),
        ends=ends,
        measured_share=seen,
        existence=_end_confidence(cylinder),
    )
    return [radius, length]


def _end(cylinder: CylinderElement, which: int, model: BuildingModel) -> tuple[FloatArray, Support | None]:
    """Where (3,) the axis ends, and on what, if that shares a fold with the cylinder near its last cells."""
    place, inwards = cylinder.ends[which], _direction(cylinder) * (1 - 2 * which)
    planes = {plane.number: plane for plane in model.planes}
    best, least = None, _NEAR_CELLS * float(cylinder.patch.grid.cell[1])
    for fold in model.folds:
        number = next((n for n in fold.surfaces if n in planes), None)
        if number is None or cylinder.number not in fold.surfaces:
            continue
        slope = float(planes[number].normal @ inwards)
        if abs(slope) < _ENDS_IT:
            continue
        off = float((planes[number].point - place) @ planes[number].normal) / slope
        if abs(off) < least:
            at = place + off * inwards
            best, least = (at, Support(planes[number], at, 1.0 / slope)), abs(off)
    return best or (place, None)


def _spacing(
    columns: tuple[CylinderElement, CylinderElement], ends: FloatArray, errors: JointErrors
) -> Dimension:
    """How far two axes are apart at two places (2, 3) on them."""
    along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    supports = []
    for column, end, way in zip(columns, ends, (along, -along), strict=True):
        for sign in (1.0, -1.0):  # an axis moves as half of what both sides of its cylinder do
            place = end + sign * column.radius_m * way
            supports.append(Support(column, place, 0.5 * sign))
    return Dimension(
        kind="column spacing",
        value=float(np.linalg.norm(ends[1] - ends[0])),
        half=half_interval(supports, errors),
        supports=tuple(supports),
        ends=ends,
        measured_share=1.0,
        existence=1.0,
    )


def _end_confidence(cylinder: CylinderElement) -> float:
    """Probability that the less certain end of a cylinder is there: the surest cell of its last row."""
    cells = cylinder.patch.observed | cylinder.patch.hypothesised
    rows = np.flatnonzero(cells.any(axis=1))
    return float(min(cylinder.patch.confidence[row][cells[row]].max() for row in (rows[0], rows[-1])))


def _direction(cylinder: CylinderElement) -> FloatArray:
    return np.asarray((cylinder.ends[1] - cylinder.ends[0]) / cylinder.length_m)


def _across(along: FloatArray) -> list[FloatArray]:
    """Four directions across a unit vector (3,), a quarter turn from each to the next."""
    first = np.cross(along, np.eye(3)[int(np.argmin(np.abs(along)))])
    first /= np.linalg.norm(first)
    second = np.cross(along, first)
    return [first, second, -first, -second]


def _on_axis(cylinder: CylinderElement, place: FloatArray) -> FloatArray:
    """The place (3,) on a column's axis at the height of another."""
    along = _direction(cylinder)
    return np.asarray(cylinder.ends[0] + (place[2] - cylinder.ends[0][2]) / along[2] * along)
