# SPDX-License-Identifier: MIT
"""Arrangement: a sheet's chart divided into faces by its outline, its provenances, folds and facets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from completion.export.panels import limits
from completion.export.panels.fold import Fold, FoldCurve, facet_lines
from completion.export.panels.outline import polygon_parts
from completion.export.panels.sheet import Sheet, left_of, polygons_of_cells
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Cylinder

_AROUND = 20  # cells beyond a chart to which its seam goes on


@dataclass(frozen=True, slots=True, eq=False)
class Trace:
    """A curve in a chart: places (n, 2) of its stations, and their parameters (n,)."""

    curve: FoldCurve
    key: int  # of the curve: the same in the charts of both surfaces
    uv: FloatArray
    t: FloatArray

    @property
    def line(self) -> Any:
        """The polyline, as shapely has it."""
        return shapely.linestrings(self.uv)


@dataclass(frozen=True, slots=True, eq=False)
class Arrangement:
    """The chart of one sheet, divided.

    Attributes
    ----------
    sheet : Sheet
        The surface.
    faces : (n,) shapely polygons
        They touch in whole edges.
    provenance : (n,) int8
        Of each.
    tracks : tuple of Trace
        The curves of its folds in the chart as far as it reaches, and the seam of one that wraps.
    """

    sheet: Sheet
    faces: NDArray[Any]
    provenance: NDArray[np.int8]
    tracks: tuple[Trace, ...]


def arrange(sheet: Sheet, folds: Sequence[Fold]) -> Arrangement:
    """Divide the chart of a sheet by its outline, the borders of provenance, folds, and facets of cylinders.

    The area is filled up to the folds at which it ends, and cut off beyond. `folds` are those of the sheet.
    """
    traces = [trace(sheet, fold, fold.start, fold.end) for fold in folds]
    area = _fit_area(sheet, folds, traces)
    lines = [fold_trace.line for fold_trace in traces]
    labels = _labelled_area(sheet, area, lines)
    if not len(labels):
        return Arrangement(sheet, np.zeros(0, object), np.zeros(0, np.int8), ())
    whole = shapely.union_all(labels)
    facets = shapely.intersection(_facet_lines(sheet, whole), whole)
    faces = _polygonize([*shapely.boundary(labels), *lines, facets])
    inner = shapely.point_on_surface(faces)
    held = np.full(len(faces), -1, np.int64)
    place, label = shapely.STRtree(labels).query(inner, predicate="intersects")
    held[place] = label
    kept = held >= 0
    provenance = sheet.provenance_at(_inner(labels))
    tracks = [*_tracks(sheet, folds), *(_seams(sheet) if sheet.wraps else ())]
    return Arrangement(sheet, faces[kept], provenance[held[kept]], tuple(tracks))


def _tracks(sheet: Sheet, folds: Sequence[Fold]) -> list[Trace]:
    """The curves of folds in a chart, each once, as far as the surface reaches."""
    grid = sheet.patch.grid
    corners = grid.surface.from_uv(
        grid.uv_of(*np.array([[0, 0, 1, 1], [0, 1, 0, 1]]) * np.array(grid.shape)[:, None])
    )
    size = float(np.linalg.norm(np.ptp(corners, axis=0))) + 20 * sheet.cell_m
    tracks: dict[int, Trace] = {}
    for fold in folds:
        middle = fold.curve.at(np.array([fold.start]))[0]
        low, high = fold.curve.span(np.stack([middle - size, middle + size]))
        tracks.setdefault(fold.number, trace(sheet, fold, low, high))
    return list(tracks.values())


def trace(sheet: Sheet, fold: Fold, start: float, end: float) -> Trace:
    """Return the curve of a fold from one parameter to another in the chart of one of its surfaces."""
    t = fold.curve.stations(start, end)
    uv = sheet.surface.to_uv(fold.curve.at(t))
    period = sheet.surface.period
    if np.isfinite(period):
        uv[:, 0] = np.unwrap(uv[:, 0], period=period)
        uv[:, 0] -= period * np.round(uv[:, 0].mean() / period)
    return Trace(fold.curve, fold.number, uv, t)


@dataclass(frozen=True, slots=True, eq=False)
class _Seam:
    """The line at which the chart of a cylinder closes; `t` is the height."""

    cylinder: Any

    def span(self, box: FloatArray) -> tuple[float, float]:  # noqa: ARG002 -- that of its protocol
        """All heights."""
        return -np.inf, np.inf

    def at(self, t: FloatArray) -> FloatArray:
        """Points (n, 3) at heights (n,)."""
        return np.asarray(self.cylinder.from_uv(np.stack([np.full_like(t, self.cylinder.period / 2), t], -1)))

    def stations(self, low: float, high: float) -> FloatArray:
        """The two ends."""
        return np.array([low, high])


def _seams(sheet: Sheet) -> tuple[Trace, ...]:
    """Both sides of the seam of a chart that wraps."""
    low, high = (
        sheet.patch.grid.corner[1] + row * sheet.patch.grid.cell[1] for row in (0, sheet.patch.grid.shape[0])
    )
    t = np.array([low - sheet.cell_m * 20, high + sheet.cell_m * 20])
    half, curve = sheet.surface.period / 2, _Seam(sheet.surface)
    return tuple(
        Trace(curve, -sheet.number, np.stack([np.full(2, side * half), t], axis=1), t) for side in (-1.0, 1.0)
    )


def _fit_area(sheet: Sheet, folds: Sequence[Fold], traces: Sequence[Trace]) -> Any:
    """The area, filled up to the folds at which the sheet ends and cut off beyond."""
    width, inside, outside = limits.STRIP_CELLS * sheet.cell_m, [], []
    for fold, fold_trace in zip(folds, traces, strict=True):
        left, right = fold.sides[0 if fold.first == sheet.number else 1]
        if left == right:
            continue
        sign = 1.0 if left else -1.0
        inside.append(_strip(fold_trace.uv, sign * width))
        outside.append(_strip(fold_trace.uv, -sign * width))
    plain = shapely.coverage_simplify(polygon_parts(sheet.area), limits.CORNER_CELLS * sheet.cell_m)
    area = shapely.union_all(plain)
    if inside:
        area = shapely.union_all([area, *inside], grid_size=limits.PRECISION_M)
        area = shapely.difference(area, shapely.union_all(outside), grid_size=limits.PRECISION_M)
    least = limits.LEAST_CELLS * sheet.patch.grid.cell_area
    parts = [part for part in polygon_parts(shapely.make_valid(area)) if part.area >= least]
    if sheet.wraps:
        half, (low, high) = sheet.surface.period / 2, shapely.total_bounds(parts)[[1, 3]] if parts else (0, 1)
        parts = polygon_parts(
            shapely.intersection(shapely.union_all(parts), shapely.box(-half, low, half, high))
        )
    return shapely.union_all(parts)


def _strip(uv: FloatArray, width: float) -> Any:
    """The strip to the left of a polyline (n, 2), of a width in metres; to its right if that is negative."""
    beside = uv + width * left_of(uv)
    return shapely.make_valid(shapely.polygons(np.concatenate([uv, beside[::-1]])))


def _labelled_area(sheet: Sheet, area: Any, lines: Sequence[Any]) -> NDArray[Any]:
    """The area divided by provenance into polygons that share their borders; slivers join a neighbour."""
    zones = _zones(sheet)
    faces = _polygonize([shapely.boundary(area), *shapely.boundary(zones), *lines])
    inner = shapely.point_on_surface(faces)
    shapely.prepare(area)
    kept = shapely.intersects(area, inner)
    faces, inner = faces[kept], inner[kept]
    if not len(faces):
        return np.zeros(0, object)
    labels = sheet.provenance_at(shapely.get_coordinates(inner)).astype(np.int64)
    small = np.flatnonzero(shapely.area(faces) < limits.SLIVER_CELLS * sheet.patch.grid.cell_area)
    _absorb(faces, labels, small)
    union = [shapely.coverage_union_all(faces[labels == label]) for label in np.unique(labels)]
    parts = np.array([part for area in union for part in polygon_parts(area)], dtype=object)
    return np.asarray(shapely.coverage_simplify(parts, limits.COLLINEAR_M))


def _absorb(faces: NDArray[Any], labels: NDArray[np.int64], small: NDArray[np.int64]) -> None:
    """Give small faces the label of the larger face with which they share the longest border."""
    if not len(small) or len(small) == len(faces):
        return
    is_small = np.zeros(len(faces), np.bool_)
    is_small[small] = True
    small_face, other = shapely.STRtree(faces).query(faces[small], predicate="touches")
    large = ~is_small[other]
    small_face, other = small[small_face[large]], other[large]
    shared = shapely.length(shapely.intersection(faces[small_face], faces[other]))
    order = np.lexsort((other, -shared, small_face))
    first = np.unique(small_face[order], return_index=True)[1]
    labels[small_face[order][first]] = labels[other[order][first]]


def _zones(sheet: Sheet) -> NDArray[Any]:
    """The cells of each provenance as polygons of the chart with smooth borders that they share."""
    grid, none = sheet.patch.grid, np.zeros((0, 3, 2))
    zones = [
        shapely.transform(
            polygons_of_cells(sheet.provenance == why, none), lambda xy: grid.uv_of(xy[:, 1], xy[:, 0])
        )
        for why in np.unique(sheet.provenance)
    ]
    if len(zones) < 2:
        return np.zeros(0, object)
    parts = np.array([part for zone in zones for part in polygon_parts(zone)], dtype=object)
    return np.asarray(
        shapely.coverage_simplify(parts, limits.CORNER_CELLS * sheet.cell_m, simplify_boundary=False)
    )


def _polygonize(lines: Sequence[Any]) -> NDArray[Any]:
    """The faces between lines, noded to the precision of a chart; (n,) shapely polygons."""
    noded = shapely.union_all([shapely.GeometryCollection(list(lines))], grid_size=limits.PRECISION_M)
    faces = shapely.get_parts(shapely.polygonize([noded]))
    return np.asarray(faces[shapely.area(faces) > 0], dtype=object)


def _inner(polygons: NDArray[Any]) -> FloatArray:
    """A place (n, 2) in each polygon."""
    return np.asarray(shapely.get_coordinates(shapely.point_on_surface(polygons)), dtype=np.float64)


def _facet_lines(sheet: Sheet, area: Any) -> Any:
    """The lines between the facets of a cylinder."""
    surface = sheet.surface
    if not isinstance(surface, Cylinder):
        return shapely.MultiLineString()
    left, low, right, high = area.bounds
    s = facet_lines(surface, left, right)
    return shapely.MultiLineString([((x, low - 1.0), (x, high + 1.0)) for x in s])
