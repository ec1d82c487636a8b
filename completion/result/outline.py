# SPDX-License-Identifier: MIT
"""Outline: where a completed surface ends, each part with its kind, provenance and confidence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from completion.boundary.continuation import Cue
from completion.evidence.chart_grid import ChartGrid
from completion.evidence.evidence import Label
from completion.extension.patch import Patch
from scenes.checks import BoolArray, FloatArray
from scenes.surfaces.catalogue import Surface

_LEAST_CHAIN = 4  # cells of an outline
_BESIDE = 1.5  # cells between an outline and what it follows
_BESIDE_IT = np.array([[0, 1, 0], [1, 0, 1], [0, 1, 0]])


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
    """What would be said of each cell if it lay on the outline."""

    inside: BoolArray  # (rows, columns) measured and inferred cells
    kinds: NDArray[np.str_]  # (rows, columns) as of `BoundarySegment`
    provenances: NDArray[np.str_]  # (rows, columns) as of `BoundarySegment`
    confidence: FloatArray  # (rows, columns) probability that the surface ends there


def outline_cells(patch: Patch) -> OutlineCells:
    """Return what is said of the cells of a surface's outline."""
    mask, labels = patch.observed | patch.hypothesised, patch.evidence.labels
    unknown = np.isin(labels, (Label.OUT, Label.NO_RETURN)) & patch.is_within
    still = np.where(unknown, 1.0, patch.confidence)  # out of sight it may as well go on
    label, still = _greatest_outside(labels, mask, Label.OUT), _greatest_outside(still, mask, 1.0)
    provenances = _provenances(patch)
    ends = np.where(provenances == "user", 1.0, np.maximum(patch.confidence - np.maximum(still, 0.0), 0.0))
    return OutlineCells(mask, _kinds(patch, label), provenances, ends)


def _greatest_outside(values: NDArray[Any], mask: BoolArray, beyond: float) -> NDArray[Any]:
    """The greatest value in the four cells beside each that are not in the mask, -1 for none of them."""
    outside = np.where(mask, -1, values)
    return np.asarray(ndimage.maximum_filter(outside, footprint=_BESIDE_IT, mode="constant", cval=beyond))


def trace_boundary(grid: ChartGrid, cells: OutlineCells) -> list[BoundarySegment]:
    """Return the outline of the measured and inferred cells, cut where its kind or provenance changes."""
    kinds, provenances, ends = cells.kinds, cells.provenances, cells.confidence
    segments = []
    for chain in trace_cells(cells.inside):
        if len(chain) < _LEAST_CHAIN:
            continue
        row, column = chain.T
        code = list(zip(kinds[row, column].tolist(), provenances[row, column].tolist(), strict=True))
        for start, end in runs_of(code):
            kind, provenance = code[start]
            stretch = np.take(chain, range(start, end + 2), axis=0, mode="wrap")
            confidence = float(np.mean(ends[row[start : end + 1], column[start : end + 1]]))
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


def _kinds(patch: Patch, label: NDArray[np.int8]) -> NDArray[np.str_]:
    """Kind that each cell would have on the outline, by the strongest label just outside."""
    kind = np.select(
        [label == Label.FREE, label == Label.VISIBLE, label == Label.OCCLUDED, label == Label.NO_RETURN],
        ["edge", "crease", "occluded", "no-return"],
        "frame",
    )
    return np.where(_near(patch, _found_cuts(patch)), "crease", kind)


def _provenances(patch: Patch) -> NDArray[np.str_]:
    """Provenance that each cell would have on the outline."""
    grid = patch.grid
    beside = _BESIDE * float(grid.cell.max())
    uv = grid.centres_uv()
    result = np.full(grid.shape, "shadow-limit", dtype="<U16")
    for stretch in patch.stretches:
        progress = stretch.progress(uv)
        hidden = (progress >= -beside) & (progress <= abs(stretch.end - stretch.start) + beside)
        result[hidden & (np.abs(stretch.curve.across(uv)) <= beside)] = str(stretch.provenance)
    result[_near(patch, _found_cuts(patch))] = str(Cue.ARCHITECTURAL)
    result[_near(patch, patch.verdict.ends) | _near_openings(patch)] = "user"
    return np.where(patch.hypothesised, result, "measured")


def _found_cuts(patch: Patch) -> list[Surface]:
    """Surfaces that this one ends at without a person's saying so."""
    return [cut for cut in patch.limits.cuts if cut not in patch.verdict.ends]


def _near_openings(patch: Patch) -> BoolArray:
    """Cells within about a cell of a declared opening."""
    sides = [trim.cells for trim in patch.verdict.trims(patch.grid)]
    crossed = np.logical_or.reduce([np.zeros(patch.grid.shape, dtype=np.bool_), *sides])
    return np.asarray(ndimage.binary_dilation(crossed, np.ones((3, 3))), dtype=np.bool_)


def _near(patch: Patch, others: Sequence[Surface]) -> BoolArray:
    """Cells within one and a half cells of others that the surface ends at."""
    centres = patch.grid.centres()
    near = np.zeros(len(centres), dtype=np.bool_)
    for cut in others:
        near |= cut.distance(centres) <= _BESIDE * float(patch.grid.cell.max())
    return near.reshape(patch.grid.shape)


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
