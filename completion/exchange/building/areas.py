# SPDX-License-Identifier: MIT
"""Areas: polygons of a plane, joined, cut and measured; lines and points that come of cutting are dropped."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import shapely

from scenes.checks import FloatArray

_LEAST_M2 = 1e-6  # of a polygon; what is smaller came of rounding
_MITRE = 1.5
_APART_M = 2e-5  # half the least distance of sides from each other
_STRAIGHT_M, _ROUNDING_M, _LEAST_SMOOTH_M2 = 5e-4, 1e-6, 1e-4


def polygons(area: Any, least_m2: float = _LEAST_M2) -> list[Any]:
    """Return the polygons of an area that are not smaller than `least_m2`, largest first."""
    parts = shapely.get_parts(shapely.get_parts(area))  # of collections too
    return sorted(
        (one for one in parts.tolist() if one.geom_type == "Polygon" and one.area >= least_m2),
        key=lambda one: (-one.area, *one.bounds),
    )


def joined(areas: Iterable[Any]) -> Any:
    """The union of areas."""
    return _clean(shapely.union_all([shapely.make_valid(area) for area in areas]))


def common(one: Any, other: Any) -> Any:
    """What two areas have in common."""
    return _clean(shapely.intersection(one, other))


def less(area: Any, others: Iterable[Any]) -> Any:
    """An area without others."""
    return _clean(shapely.difference(area, joined(others)))


def buffered(area: Any, reach_m: float) -> Any:
    """An area grown by a reach, or shrunk, with its corners as corners."""
    with np.errstate(divide="ignore", invalid="ignore"):  # flags that GEOS leaves behind are no faults
        return shapely.buffer(area, reach_m, join_style="mitre")


def wide(area: Any, least_m: float) -> Any:
    """What is at least so wide of an area, with its corners as they are."""
    core = buffered(area, -least_m / 2)
    return common(area, buffered(core, _MITRE * least_m / 2))


def filled(area: Any) -> Any:
    """An area without its holes."""
    return joined(shapely.Polygon(one.exterior) for one in polygons(area))


def straightened(area: Any) -> Any:
    """An area without the corners that are within half a millimetre of a straight side."""
    return _clean(shapely.simplify(area, _STRAIGHT_M))


def smoothed(area: Any, slit_m: float) -> Any:
    """An area without slits and splinters narrower than `slit_m`, and holes that touch its outline."""
    area = straightened(area)
    for step in (slit_m / 2, -slit_m, slit_m / 2 - _APART_M):  # so that sides come near, but never touch
        area = buffered(area, step)
    return shapely.MultiPolygon(polygons(shapely.simplify(area, _ROUNDING_M), _LEAST_SMOOTH_M2))


def inside(area: Any) -> FloatArray:
    """A place (2,) as far inside an area as there is, by the largest of its polygons."""
    line = shapely.maximum_inscribed_circle(polygons(area)[0], tolerance=0.01)
    return np.asarray(shapely.get_coordinates(line)[0])


def rings(polygon: Any) -> Sequence[FloatArray]:
    """Outline anticlockwise, then holes clockwise, (n, 2) each, the first point not repeated."""
    turned = shapely.geometry.polygon.orient(polygon)
    return [np.asarray(ring.coords)[:-1] for ring in (turned.exterior, *turned.interiors)]


def _clean(area: Any) -> Any:
    return shapely.MultiPolygon(polygons(area))
