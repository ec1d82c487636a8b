# SPDX-License-Identifier: MIT
"""Boundary: the outline of a completed surface, each stretch with its kind, provenance and confidence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from completion.chart import ChartGrid
from completion.evidence import Label
from completion.extension import Patch
from scenes.checks import BoolArray, FloatArray
from scenes.surfaces import Plane


@dataclass(frozen=True, slots=True, eq=False)
class BoundarySegment:
    """A stretch of outline.

    Attributes
    ----------
    kind : str
        What lies beyond it: "edge" (beams went through), "crease" (another surface), "occluded",
        "frame" (the edge of the field of view) or "no-return".
    provenance : str
        "measured", or why the inferred part ends there: "intersection" (it meets a measured surface),
        "architectural" (it meets the enclosing plane beyond its own extent), "collinear" (its own straight
        edge continued), "shadow-limit" (the hidden zone ends) or "user" (a person says so).
    confidence : float
        Prior probability that the surface ends there; not calibrated.
    points : (n, 3) float
        Polyline, metres, working frame.
    """

    kind: str
    provenance: str
    confidence: float
    points: FloatArray


_CONFIDENCE = {
    "measured": 1.0,
    "user": 1.0,
    "intersection": 0.9,
    "architectural": 0.75,
    "collinear": 0.7,
    "shadow-limit": 0.3,
}


def trace_boundary(patch: Patch) -> list[BoundarySegment]:
    """Outline of the measured and inferred cells, cut where its kind or provenance changes."""
    mask = patch.observed | patch.hypothesised
    kinds, provenances = _classify(patch, mask)
    segments = []
    for contour in _contours(mask):
        row, column = contour[:, 0], contour[:, 1]
        code = [(str(kinds[r, c]), str(provenances[r, c])) for r, c in zip(row, column, strict=True)]
        for start, end in _runs(code):
            kind, provenance = code[start]
            stretch = np.take(contour, range(start, end + 2), axis=0, mode="wrap")
            points = _polyline(patch.grid, stretch)
            segments.append(BoundarySegment(kind, provenance, _CONFIDENCE[provenance], points))
    return segments


def _classify(patch: Patch, mask: BoolArray) -> tuple[NDArray[np.str_], NDArray[np.str_]]:
    """Kind and provenance that each cell of the mask would have on the outline."""
    labels = np.pad(patch.evidence.labels, 1, constant_values=Label.OUT)
    outside = np.pad(~mask, 1, constant_values=True)
    worst = np.full(mask.shape, -1, np.int8)  # strongest label among the neighbours outside
    for step_row, step_column in ((-1, 0), (1, 0), (0, -1), (0, 1)):
        window = (
            slice(1 + step_row, 1 + step_row + mask.shape[0]),
            slice(1 + step_column, 1 + step_column + mask.shape[1]),
        )
        worst = np.where(outside[window], np.maximum(worst, labels[window]), worst)
    kind = np.select(
        [worst == Label.FREE, worst == Label.VISIBLE, worst == Label.OCCLUDED, worst == Label.NO_RETURN],
        ["edge", "crease", "occluded", "no-return"],
        "frame",
    )
    at_said = _near_planes(patch, patch.verdict.ends) | _near_openings(patch)
    at_cut = _near_planes(patch, [cut for cut in patch.limits.cuts if cut not in patch.verdict.ends])
    kind = np.where(at_cut, "crease", kind)
    uv = patch.grid.centres_uv()
    reach = 1.5 * patch.grid.cell
    limits = patch.limits
    at_side = (np.abs(uv[..., None, :] - limits.ends) <= reach).any(axis=(-1, -2))
    beyond_own = ((uv < limits.own_low) | (uv > limits.own_high)).any(axis=-1)
    inferred = np.select(
        [at_said, at_cut & beyond_own, at_cut, at_side],
        ["user", "architectural", "intersection", "collinear"],
        "shadow-limit",
    )
    return kind, np.where(patch.hypothesised, inferred, "measured")


def _near_openings(patch: Patch) -> BoolArray:
    """Cells within about a cell of a declared opening."""
    sides = [trim.cells for trim in patch.verdict.trims(patch.grid)]
    crossed = np.logical_or.reduce([np.zeros(patch.grid.shape, dtype=np.bool_), *sides])
    return np.asarray(ndimage.binary_dilation(crossed, np.ones((3, 3))), dtype=np.bool_)


def _near_planes(patch: Patch, planes: Sequence[Plane]) -> BoolArray:
    """Cells within one and a half cells of planes that the surface ends at."""
    centres = patch.grid.centres()
    near = np.zeros(len(centres), dtype=np.bool_)
    for cut in planes:
        near |= cut.distance(centres) <= 1.5 * float(patch.grid.cell.max())
    return near.reshape(patch.grid.shape)


def _contours(mask: BoolArray) -> list[NDArray[np.int64]]:
    """Closed chains (n, 2) of boundary cells, row and column, outer ones and holes."""
    found, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    return [np.asarray(contour[:, 0, ::-1], dtype=np.int64) for contour in found if len(contour) >= 4]


def _runs(code: Sequence[tuple[str, str]]) -> list[tuple[int, int]]:
    """First and last index of each stretch of equal entries."""
    change = [i for i in range(1, len(code)) if code[i] != code[i - 1]]
    return list(zip([0, *change], [c - 1 for c in [*change, len(code)]], strict=True))


def _polyline(grid: ChartGrid, chain: NDArray[np.int64]) -> FloatArray:
    """World points of a chain of cells, straightened to within a cell."""
    straight = cv2.approxPolyDP(chain.astype(np.int32).reshape(-1, 1, 2), 1.0, closed=False).reshape(-1, 2)
    cells = straight.astype(np.float64) + 0.5
    return grid.surface.from_uv(grid.uv_of(cells[:, 0], cells[:, 1]))
