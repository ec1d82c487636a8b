# SPDX-License-Identifier: MIT
"""Outline: where a completed surface ends, each part with its kind, provenance and confidence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

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
    """What would be said of each cell if it lay on the outline.

    Attributes
    ----------
    inside : (rows, columns) bool
        Measured and inferred cells.
    kinds, provenances : (rows, columns) str
        As of `BoundarySegment`.
    confidence : (rows, columns) float
        Probability that the surface ends there.
    """

    inside: BoolArray
    kinds: NDArray[np.str_]
    provenances: NDArray[np.str_]
    confidence: FloatArray


def outline_cells(patch: Patch) -> OutlineCells:
    """Return what is said of the cells of a surface's outline."""
    mask = patch.observed | patch.hypothesised
    beyond = _Beyond.of(patch, mask)
    provenances = _provenances(patch)
    ends = np.where(provenances == "user", 1.0, np.maximum(patch.confidence - beyond.confidence, 0.0))
    return OutlineCells(mask, _kinds(patch, beyond), provenances, ends)


def trace_boundary(grid: ChartGrid, cells: OutlineCells) -> list[BoundarySegment]:
    """Return the outline of the measured and inferred cells, cut where its kind or provenance changes.

    Parameters
    ----------
    grid : ChartGrid
        The chart's cells.
    cells : OutlineCells
        What is known of each.
    """
    kinds, provenances, ends = cells.kinds, cells.provenances, cells.confidence
    segments = []
    for chain in trace_cells(cells.inside):
        if len(chain) < _LEAST_CHAIN:
            continue
        row, column = chain.T
        code = [(str(kinds[r, c]), str(provenances[r, c])) for r, c in zip(row, column, strict=True)]
        for start, end in _runs(code):
            kind, provenance = code[start]
            stretch = np.take(chain, range(start, end + 2), axis=0, mode="wrap")
            confidence = float(np.mean(ends[row[start : end + 1], column[start : end + 1]]))
            segments.append(BoundarySegment(kind, provenance, confidence, _polyline(grid, stretch)))
    return segments


def trace_cells(mask: BoolArray, *, holes: bool = True) -> list[NDArray[np.int64]]:
    """Return the outlines of a mask (rows, columns) as closed chains of its own cells.

    Parameters
    ----------
    mask : (rows, columns) bool
        Cells to go round.
    holes : bool
        Whether the outlines of holes are wanted, too.

    Returns
    -------
    list of (n, 2) int64
        Row and column of neighbouring cells; the first follows the last.
    """
    mode = cv2.RETR_CCOMP if holes else cv2.RETR_EXTERNAL
    found, _ = cv2.findContours(mask.astype(np.uint8), mode, cv2.CHAIN_APPROX_NONE)
    return [np.asarray(contour[:, 0, ::-1], dtype=np.int64) for contour in found]


def straight_corners(chain: NDArray[np.int64], slack: float, *, closed: bool) -> NDArray[np.int64]:
    """Return those cells (k, 2) of a chain (n, 2) whose polygon stays within `slack` cells of the others."""
    points = chain[:, ::-1].astype(np.int32).reshape(-1, 1, 2)
    corners = cv2.approxPolyDP(points, slack, closed=closed).reshape(-1, 2)
    return np.asarray(corners[:, ::-1], dtype=np.int64)


@dataclass(frozen=True, slots=True, eq=False)
class _Beyond:
    """What is just outside each cell: the strongest label, and how surely the surface is still there."""

    label: NDArray[np.int8]
    confidence: FloatArray

    @classmethod
    def of(cls, patch: Patch, mask: BoolArray) -> _Beyond:
        unknown = np.isin(patch.evidence.labels, (Label.OUT, Label.NO_RETURN))
        still = np.where(
            unknown & patch.is_within, 1.0, patch.confidence
        )  # out of sight it may as well go on
        label, confidence = np.full(mask.shape, -1, np.int8), np.zeros(mask.shape)
        outside = np.pad(~mask, 1, constant_values=True)
        labels = np.pad(patch.evidence.labels, 1, constant_values=Label.OUT)
        still = np.pad(still, 1, constant_values=1.0)
        for row, column in ((-1, 0), (1, 0), (0, -1), (0, 1)):
            window = (
                slice(1 + row, 1 + row + mask.shape[0]),
                slice(1 + column, 1 + column + mask.shape[1]),
            )
            label = np.where(outside[window], np.maximum(label, labels[window]), label)
            confidence = np.where(outside[window], np.maximum(confidence, still[window]), confidence)
        return cls(label, confidence)


def _kinds(patch: Patch, beyond: _Beyond) -> NDArray[np.str_]:
    """Kind that each cell would have on the outline."""
    label = beyond.label
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


def _runs(code: Sequence[tuple[str, str]]) -> list[tuple[int, int]]:
    """First and last index of each stretch of equal entries."""
    change = [i for i in range(1, len(code)) if code[i] != code[i - 1]]
    return list(zip([0, *change], [c - 1 for c in [*change, len(code)]], strict=True))


def _polyline(grid: ChartGrid, chain: NDArray[np.int64]) -> FloatArray:
    """World points of a chain of cells, straightened to within a cell."""
    row, column = straight_corners(chain, 1.0, closed=False).T.astype(np.float64) + 0.5
    return grid.surface.from_uv(grid.uv_of(row, column))
