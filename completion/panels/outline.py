# SPDX-License-Identifier: MIT
"""Outline: where a completed surface ends, each part with its kind, provenance and confidence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from completion.boundary.continuation import Cue
from completion.edits.edit import SurfaceEdits
from completion.evidence.chart_grid import ChartGrid
from completion.evidence.evidence import Label
from completion.extension.patch import Patch
from scenes.checks import BoolArray, FloatArray
from scenes.surfaces.catalogue import Surface

_LEAST_CHAIN = 4  # cells of an outline
_BESIDE = 1.5  # cells between an outline and what it follows
_STEPS = np.array([[-1, 0], [1, 0], [0, -1], [0, 1]])  # to the four cells beside one


@dataclass(frozen=True, slots=True, eq=False)
class BoundarySegment:
    """A stretch of outline.

    Attributes
    ----------
    kind : str
        What lies beyond it: "edge" (beams went through), "crease" (another surface), "occluded",
        "frame" (the edge of the field of view) or "no-return".
    provenance : str
        "measured", or why the inferred part ends there: a `Cue` of a continued edge, "architectural" (at the
        plane that encloses the room), "shadow-limit" (the hidden zone ends, or it is no longer probable), or
        "user" (a person says so).
    confidence : float
        Probability that the surface ends there: that it is just inside and not just outside.
    points : (n, 3) float
        Polyline, metres, working frame.
    """

    kind: str
    provenance: str
    confidence: float
    points: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class OutlineCells:
    """What is said of the measured and inferred cells that others touch, n of them, row by row."""

    inside: BoolArray  # (rows, columns) all measured and inferred cells
    cells: NDArray[np.int64]  # (n, 2) row and column
    kinds: NDArray[np.str_]  # (n,) as of `BoundarySegment`
    provenances: NDArray[np.str_]  # (n,) as of `BoundarySegment`
    confidence: FloatArray  # (n,) probability that the surface ends there

    def numbers(self, chain: NDArray[np.int64]) -> NDArray[np.int64]:
        """Which of the n the cells (k, 2) of a chain are."""
        flat = (np.ravel_multi_index((*cells.T,), self.inside.shape) for cells in (self.cells, chain))
        return np.asarray(np.searchsorted(*flat), dtype=np.int64)


@dataclass(frozen=True, slots=True, eq=False)
class NearOutline:
    """What is known of a surface's cells beside its outline, and which is nearest to a place of the chart."""

    known: OutlineCells
    tree: cKDTree

    @classmethod
    def of(cls, grid: ChartGrid, known: OutlineCells) -> NearOutline:
        """Return it for the cells of an outline on their grid."""
        row, column = (known.cells + 0.5).T
        return cls(known, cKDTree(grid.uv_of(row, column)))

    def kinds(self, uv: FloatArray) -> NDArray[np.str_]:
        """What lies beyond the outline nearest to places (n, 2) of the chart, (n,)."""
        return np.asarray(self.known.kinds[self.tree.query(uv)[1]], dtype=np.str_)


def outline_cells(patch: Patch) -> OutlineCells:
    """Return what is said of the cells of a surface's outline."""
    inside = patch.observed | patch.hypothesised
    cells = np.argwhere(inside & ~ndimage.binary_erosion(inside, np.ones((3, 3))))
    label, still = _greatest_outside(patch, inside, cells)
    row, column = cells.T
    uv = patch.grid.uv_of(*(cells.T.astype(np.float64) + 0.5))
    at_cuts = _near(patch, uv, [cut for cut in patch.limits.cuts if cut not in patch.verdict.ends])
    kinds = np.where(at_cuts, "crease", _kinds(label))
    provenances = _provenances(patch, cells, uv, at_cuts)
    drop = np.maximum(patch.confidence[row, column] - np.maximum(still, 0.0), 0.0)
    return OutlineCells(inside, cells, kinds, provenances, np.where(provenances == "user", 1.0, drop))


def _greatest_outside(
    patch: Patch, inside: BoolArray, cells: NDArray[np.int64]
) -> tuple[NDArray[np.int64], FloatArray]:
    """The greatest label (n,) and confidence (n,) of the four cells beside each that are not inside.

    -1 for none of them. Out of sight, and beyond the grid, the surface may as well go on.
    """
    beside = cells + _STEPS[:, None]
    limit = np.array(inside.shape) - 1
    in_grid = ((beside >= 0) & (beside <= limit)).all(axis=-1)
    row, column = np.moveaxis(np.clip(beside, 0, limit), -1, 0)
    outside, label = ~inside[row, column], patch.evidence.labels[row, column].astype(np.int64)
    unknown = np.isin(label, (Label.OUT, Label.NO_RETURN, Label.UNLIT)) & patch.is_within[row, column]
    still = np.where(unknown, 1.0, patch.confidence[row, column])
    found = (np.where(in_grid, np.where(outside, label, -1), Label.OUT), np.where(outside, still, -1.0))
    return found[0].max(axis=0), np.where(in_grid, found[1], 1.0).max(axis=0)


def trace_boundary(grid: ChartGrid, cells: OutlineCells) -> list[BoundarySegment]:
    """Return the outline of the measured and inferred cells, cut where its kind or provenance changes."""
    segments = []
    for chain in trace_cells(cells.inside):
        if len(chain) < _LEAST_CHAIN:
            continue
        number = cells.numbers(chain)
        code = list(zip(cells.kinds[number].tolist(), cells.provenances[number].tolist(), strict=True))
        for start, end in runs_of(code):
            kind, provenance = code[start]
            stretch = np.take(chain, range(start, end + 2), axis=0, mode="wrap")
            confidence = float(np.mean(cells.confidence[number[start : end + 1]]))
            segments.append(BoundarySegment(kind, provenance, confidence, _polyline(grid, stretch)))
    return segments


def trace_cells(mask: BoolArray, *, holes: bool = True) -> list[NDArray[np.int64]]:
    """Return the outlines of a mask (rows, columns), those of its `holes` too, as closed chains of its cells.

    Each is (n, 2): row and column of neighbouring cells; the first follows the last.
    """
    mode = cv2.RETR_CCOMP if holes else cv2.RETR_EXTERNAL
    found, _ = cv2.findContours(mask.astype(np.uint8), mode, cv2.CHAIN_APPROX_NONE)
    return [np.asarray(contour[:, 0, ::-1], dtype=np.int64) for contour in found]


def straight_corners(chain: NDArray[np.int64], slack: float, *, closed: bool) -> NDArray[np.int64]:
    """Return those cells (k, 2) of a chain (n, 2) whose polygon stays within `slack` cells of the others."""
    points = chain[:, ::-1].astype(np.int32).reshape(-1, 1, 2)
    corners = cv2.approxPolyDP(points, slack, closed=closed).reshape(-1, 2)
    return np.asarray(corners[:, ::-1], dtype=np.int64)


def _kinds(label: NDArray[np.int64]) -> NDArray[np.str_]:
    """Kind that a cell has on the outline, by the strongest label (n,) just outside."""
    return np.select(
        [
            label == Label.FREE,
            label == Label.VISIBLE,
            label == Label.OCCLUDED,
            (label == Label.NO_RETURN) | (label == Label.UNLIT),
        ],
        ["edge", "crease", "occluded", "no-return"],
        "frame",
    )


def _provenances(
    patch: Patch, cells: NDArray[np.int64], uv: FloatArray, at_cuts: BoolArray
) -> NDArray[np.str_]:
    """Provenance of cells (n, 2) on the outline with their centres (n, 2), some at what was found to cut."""
    row, column = cells.T
    beside = _BESIDE * float(patch.grid.cell.max())
    result = np.full(len(cells), "shadow-limit", dtype="<U16")
    for stretch in patch.stretches:
        progress = stretch.progress(uv)
        hidden = (progress >= -beside) & (progress <= abs(stretch.end - stretch.start) + beside)
        result[hidden & (np.abs(stretch.curve.across(uv)) <= beside)] = str(stretch.provenance)
    result[at_cuts] = str(Cue.ARCHITECTURAL)
    said, fitted = patch.verdict, patch.verdict.of_features
    joints = [joint.plane for joint in fitted.joints]
    of_feature = _near(patch, uv, joints) | _near_openings(patch, fitted)[row, column] | (patch.feature > 0)
    result[of_feature] = "feature"
    by_person = SurfaceEdits(openings=said.openings)
    result[_near(patch, uv, said.ends) | _near_openings(patch, by_person)[row, column]] = "user"
    return np.where(patch.hypothesised[row, column], result, "measured")


def _near_openings(patch: Patch, said: SurfaceEdits) -> BoolArray:
    """Cells (rows, columns) within about a cell of an opening that is said."""
    crossed = np.zeros(patch.grid.shape, dtype=np.bool_)
    for side in said.trims(patch.grid):
        crossed |= side.cells
    return np.asarray(ndimage.binary_dilation(crossed, np.ones((3, 3))), dtype=np.bool_)


def _near(patch: Patch, uv: FloatArray, others: Sequence[Surface]) -> BoolArray:
    """Places (n, 2) of the chart within one and a half cells of others that the surface ends at."""
    points = patch.grid.surface.from_uv(uv)
    near = np.zeros(len(uv), dtype=np.bool_)
    for cut in others:
        near |= cut.distance(points) <= _BESIDE * float(patch.grid.cell.max())
    return near


def runs_of(code: Sequence[tuple[str, str]], least: int = 1) -> list[tuple[int, int]]:
    """First and last index of each stretch of equal entries; short ones join what comes before, or after."""
    starts = [0, *(k for k in range(1, len(code)) if code[k] != code[k - 1])]
    kept: list[int] = []
    for start, end in zip(starts, [*starts[1:], len(code)], strict=True):
        if end - start >= least and (not kept or code[start] != code[kept[-1]]):
            kept.append(start)
    begins = [0, *kept[1:]]
    return list(zip(begins, [b - 1 for b in [*begins[1:], len(code)]], strict=True))


def _polyline(grid: ChartGrid, chain: NDArray[np.int64]) -> FloatArray:
    """World points of a chain of cells, straightened to within a cell."""
    row, column = straight_corners(chain, 1.0, closed=False).T.astype(np.float64) + 0.5
    return grid.surface.from_uv(grid.uv_of(row, column))
