# SPDX-License-Identifier: MIT
"""Naive baselines: five ways to continue the true planes, given which pixels are whose (an oracle)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage
from shapely.geometry.base import BaseGeometry

from benchmarks.metrics.inferred import Hypothesis, mesh_of_cells
from benchmarks.metrics.truth import Sight, TrueCells, TrueModel, sight_of
from completion.evidence.chart_grid import ChartGrid
from scenes.checks import BoolArray, FloatArray
from scenes.rays.raycast import RayCaster
from scenes.scan.range_image import RangeImage
from scenes.surfaces.catalogue import Plane

CELL_M = 0.025
_TOLERANCE_M = 0.02
_SD_M, _CONFIDENCE = 0.002, 0.9  # what a method says that does not know


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """A true plane with what the scans see of it: centres (n, 2) of visible cells in its chart, metres."""

    surface: int
    plane: Plane
    uv: FloatArray


Region = Callable[[Seen, Sequence[Seen], Sequence[RangeImage]], BaseGeometry]


def convex_hull(seen: Seen, _others: Sequence[Seen], _scans: Sequence[RangeImage]) -> BaseGeometry:
    """The convex hull of what is seen."""
    return shapely.MultiPoint(seen.uv).convex_hull


def rectangle(seen: Seen, _others: Sequence[Seen], _scans: Sequence[RangeImage]) -> BaseGeometry:
    """The rectangle around what is seen, along the axes of the plane's chart."""
    return shapely.box(*seen.uv.min(axis=0), *seen.uv.max(axis=0))


def infinite(seen: Seen, _others: Sequence[Seen], scans: Sequence[RangeImage]) -> BaseGeometry:
    """The plane as far as the farthest range reaches, within the box of all that was measured."""
    reach = max(float(scan.ranges[scan.valid].max(initial=0.0)) for scan in scans)
    feet = seen.plane.to_uv(np.stack([scan.origin for scan in scans]))
    return shapely.box(*(feet.min(axis=0) - reach), *(feet.max(axis=0) + reach))


def clipped(seen: Seen, others: Sequence[Seen], scans: Sequence[RangeImage]) -> BaseGeometry:
    """The plane, cut at all planes that have all that is seen on one side: walls, floor and ceiling."""
    region = infinite(seen, others, scans)
    points = seen.plane.from_uv(seen.uv)
    everything = np.concatenate([points, *(other.plane.from_uv(other.uv) for other in others)])
    reach = 4 * float(np.ptp(shapely.bounds(region)))
    for other in others:
        side = other.plane.distance(points)
        way = np.array([seen.plane.u_direction, seen.plane.v_direction]) @ other.plane.normal_direction
        sides = other.plane.distance(everything)
        encloses = bool((sides > -_TOLERANCE_M).all() or (sides < _TOLERANCE_M).all())
        if np.linalg.norm(way) < 1e-6 or not encloses:
            continue
        inward = way / np.linalg.norm(way) * (1.0 if side.mean() > 0 else -1.0)
        nearest = seen.uv[0] - way / (way @ way) * side[0]
        across = np.array([-inward[1], inward[0]]) * reach
        corners = [nearest - across, nearest + across, nearest + across + inward * reach]
        region = region.intersection(shapely.Polygon([*corners, nearest - across + inward * reach]))
    return region


@dataclass(frozen=True, slots=True)
class Baseline:
    """A naive baseline: which region it fills, and whether only where no ray goes through or ends."""

    name: str
    region: Region
    tests_rays: bool


BASELINES = (
    Baseline("convex hull, no ray test", convex_hull, False),
    Baseline("hull + ray test", convex_hull, True),
    Baseline("rectangle + ray test", rectangle, True),
    Baseline("infinite plane + ray test", infinite, True),
    Baseline("clipped by other planes + ray test", clipped, True),
)


def baseline_hypothesis(
    baseline: Baseline,
    model: TrueModel,
    cells: Sequence[TrueCells],
    scans: Sequence[RangeImage],
    n_threads: int | None = None,
) -> Hypothesis:
    """Return what a baseline infers from scans, given the true planes and whose each pixel is.

    `baseline`: one of `BASELINES`. `model`: the truth, as oracle. `cells`: what the scans see of it. `scans`:
    the scans. `n_threads`: threads that cast.
    """
    caster = RayCaster(model.mesh.vertices, model.mesh.faces, n_threads)
    planes = [
        Seen(cell.chart.surface, plane, _rim(cell))
        for cell in cells
        if isinstance(plane := cell.chart.grid.surface, Plane) and cell.visible.any()
    ]
    vertices, faces, surface = [np.zeros((0, 3))], [np.zeros((0, 3), np.int32)], [np.zeros(0, np.int32)]
    start = 0
    for number, seen in enumerate(planes):
        region = baseline.region(seen, [other for other in planes if other is not seen], scans)
        points, triangles = _filled(baseline, seen, region, scans, caster)
        vertices.append(points)
        faces.append(triangles + np.int32(start))
        surface.append(np.full(len(triangles), number, np.int32))
        start += len(points)
    n_faces = sum(len(part) for part in faces)
    return Hypothesis(
        vertices=np.concatenate(vertices),
        faces=np.concatenate(faces),
        surface=np.concatenate(surface),
        sd=np.full(n_faces, _SD_M),
        confidence=np.full(n_faces, _CONFIDENCE),
        true_surface=np.array([seen.surface for seen in planes], np.int32),
    )


def _rim(cell: TrueCells) -> FloatArray:
    """Chart coordinates of the visible cells at the rim of what is seen."""
    seen = cell.visible
    rim = seen & ~ndimage.binary_erosion(seen)
    return np.asarray(cell.chart.grid.centres_uv()[rim], dtype=np.float64)


def _filled(
    baseline: Baseline, seen: Seen, region: BaseGeometry, scans: Sequence[RangeImage], caster: RayCaster
) -> tuple[FloatArray, NDArray[np.int32]]:
    if region.is_empty or region.area == 0:
        return np.zeros((0, 3)), np.zeros((0, 3), np.int32)
    west, south, east, north = region.bounds
    grid = ChartGrid.over(
        seen.plane, np.array([west, south]), np.array([east, north]), CELL_M, full_turn=False
    )
    shapely.prepare(region)
    uv = grid.centres_uv()
    inside: BoolArray = np.asarray(shapely.contains_xy(region, uv[..., 0], uv[..., 1]), dtype=np.bool_)
    low, high = _measured_box(scans)
    within = ((grid.centres() >= low) & (grid.centres() <= high)).all(axis=1)
    inside &= within.reshape(grid.shape)
    centres = grid.centres()[inside.ravel()]
    sight = sight_of(centres, scans, caster, _TOLERANCE_M, seen.plane.normal(centres)).sight
    inside[inside] = sight == Sight.HIDDEN if baseline.tests_rays else sight != Sight.VISIBLE
    return mesh_of_cells(grid, inside)


def _measured_box(scans: Sequence[RangeImage]) -> tuple[FloatArray, FloatArray]:
    """Low and high corner of all that was measured, a cell wider all around."""
    points = np.concatenate([scan.points()[scan.valid] for scan in scans])
    return points.min(axis=0) - CELL_M, points.max(axis=0) + CELL_M
