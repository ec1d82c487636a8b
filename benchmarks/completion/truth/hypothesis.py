# SPDX-License-Identifier: MIT
"""Hypothesis: inferred area as arrays, whatever method made it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from completion.evidence.chart_grid import ChartGrid
from scenes.checks import BoolArray, FloatArray, InputError, check_faces, check_points, frozen_copy
from scenes.scan.range_image import RangeImage
from scenes.surfaces.surface import Opening


@dataclass(frozen=True, slots=True, eq=False)
class Hypothesis:
    """Inferred area as a triangle mesh, world coordinates.

    Parameters
    ----------
    vertices, faces : (n, 3) float, (m, 3) int
        Metres.
    surface : (m,) int
        Number of the inferred surface that each face belongs to, from 0.
    sd : (m,) float
        Predicted standard deviation along the normal, metres.
    confidence : (m,) float
        Predicted probability that there is such surface, 0..1.
    true_surface : (k,) int
        For each inferred surface the id of the true one that it continues, -1 for none.
    openings : tuple of Opening
        Openings that were found; they name inferred surfaces.
    reason : (m,) int, optional
        Why each face is inferred: index into `reasons`; the first for all when not given.
    reasons : tuple of str
        What the reasons are called.

    Raises
    ------
    InputError
        Arrays for another number of faces, or a face that names no surface or no reason.
    """

    vertices: FloatArray
    faces: NDArray[np.int32]
    surface: NDArray[np.int32]
    sd: FloatArray
    confidence: FloatArray
    true_surface: NDArray[np.int32]
    openings: tuple[Opening, ...] = ()
    reason: NDArray[np.int32] | None = None
    reasons: tuple[str, ...] = ("inferred",)

    def __post_init__(self) -> None:
        vertices = check_points("vertices", self.vertices)
        object.__setattr__(self, "vertices", frozen_copy(vertices))
        object.__setattr__(self, "faces", frozen_copy(check_faces(self.faces, len(vertices))))
        if self.reason is None:
            object.__setattr__(self, "reason", np.zeros(len(self.faces), np.int32))
        kinds = {"surface": np.int32, "sd": np.float64, "confidence": np.float64, "reason": np.int32}
        for name, dtype in kinds.items():
            array = np.asarray(getattr(self, name), dtype=dtype)
            if array.shape != (len(self.faces),):
                raise InputError(f"expected {name} with shape ({len(self.faces)},), got {array.shape}")
            object.__setattr__(self, name, frozen_copy(array))
        object.__setattr__(self, "true_surface", frozen_copy(self.true_surface, np.int32))
        _check_names("surfaces", self.surface, len(self.true_surface))
        _check_names("reasons", self.face_reason, len(self.reasons))

    @property
    def face_reason(self) -> NDArray[np.int32]:
        """Why each face is inferred: index (m,) into `reasons`."""
        return np.zeros(len(self.faces), np.int32) if self.reason is None else self.reason


def _check_names(what: str, named: NDArray[np.int32], n: int) -> None:
    if len(named) and not 0 <= named.min() <= named.max() < n:
        raise InputError(f"faces name {what} {named.min()}..{named.max()} of {n}")


def mesh_of_cells(grid: ChartGrid, filled: BoolArray) -> tuple[FloatArray, NDArray[np.int32]]:
    """Return the cells of a chart as triangles: vertices (4 n, 3) and faces (2 n, 3)."""
    row, column = (index.astype(np.float64) for index in np.nonzero(filled))
    ring = [(row, column), (row, column + 1), (row + 1, column + 1), (row + 1, column)]
    corners = np.stack([grid.uv_of(r, c) for r, c in ring], axis=1)
    start = 4 * np.arange(len(row), dtype=np.int32)[:, None]
    faces = np.concatenate([start + [0, 1, 2], start + [0, 2, 3]])
    return grid.surface.from_uv(corners.reshape(-1, 2)), faces.astype(np.int32)


def continued_surfaces(
    owners: Sequence[NDArray[np.int32]], scans: Sequence[RangeImage], n_inferred: int
) -> NDArray[np.int32]:
    """Return for each inferred surface the true one that most of its pixels lie on, -1 without pixels.

    Parameters
    ----------
    owners : sequence of (rows, columns) int
        For each scan the number of the inferred surface of each pixel, from 1; 0 for none.
    scans : sequence of RangeImage
        Those without truth say nothing.
    n_inferred : int
        How many surfaces were inferred.
    """
    result, most = np.full(n_inferred, -1, np.int32), np.zeros(n_inferred, np.int64)
    known = [
        (owner, scan.truth.surface)
        for owner, scan in zip(owners, scans, strict=True)
        if scan.truth is not None
    ]
    n_true = 1 + max((int(surface.max(initial=-1)) for _, surface in known), default=-1)
    count = np.zeros((n_inferred + 1, n_true + 1), np.int64)
    for owner, surface in known:
        np.add.at(count, (owner.ravel(), surface.ravel()), 1)
    if n_true:
        result, most = count[1:, :n_true].argmax(axis=1).astype(np.int32), count[1:, :n_true].max(axis=1)
    return np.where(most > 0, result, -1).astype(np.int32)
