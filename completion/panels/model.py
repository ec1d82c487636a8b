# SPDX-License-Identifier: MIT
"""Panel model: few facets, each of one surface and one state, and the folds and corners that they share."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from completion.extension.patch import Provenance
from completion.panels.fold_edge import CornerPoint, FoldEdge
from scenes.checks import BoolArray, FloatArray

_SAME_UV_M = 1e-3  # in a chart that one vertex may be at twice, at the seam of a cylinder


@dataclass(frozen=True, slots=True, eq=False)
class PanelPart:
    """Facets of one surface by themselves: each vertex has one place in the chart."""

    vertices: FloatArray  # (n, 3) metres, working frame
    faces: NDArray[np.int64]  # (m, 3)
    uv: FloatArray  # (n, 2) chart coordinates, metres


@dataclass(frozen=True, slots=True, eq=False)
class RestFacets:
    """What no surface explains, as few triangles, and the pixels that tell of its vertices.

    Attributes
    ----------
    faces : (m, 3) int
        Of the vertices of the light model, some of which panels have too.
    vertex : (n,) int
        The vertices that these triangles use, ascending.
    source : (n,) int
        For each of them the nearest vertex of the pixels' mesh.
    """

    faces: NDArray[np.int64] = field(default_factory=lambda: np.zeros((0, 3), np.int64))
    vertex: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    source: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))


@dataclass(frozen=True, slots=True, eq=False)
class PanelModel:
    """Completed surfaces as few facets; neighbours share the vertices of the fold in which they meet.

    Attributes
    ----------
    vertices : (n, 3) float
        Metres, working frame.
    faces : (m, 3) int
        Anticlockwise seen from the side that was measured.
    face_surface : (m,) int32
        Number of each facet's surface, from 1.
    face_provenance : (m,) int8
        The `Provenance` of each facet.
    corner_uv : (m, 3, 2) float
        Chart coordinates of the facets' corners, metres.
    folds : tuple of FoldEdge
        The edges that two surfaces share.
    corners : tuple of CornerPoint
        Where three meet.
    open_m : dict of str to float
        Length of the edges of a single facet by what lies beyond them (`BoundarySegment.kind`), metres.
    rest : RestFacets
        What no surface explains.
    """

    vertices: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    faces: NDArray[np.int64] = field(default_factory=lambda: np.zeros((0, 3), np.int64))
    face_surface: NDArray[np.int32] = field(default_factory=lambda: np.zeros(0, np.int32))
    face_provenance: NDArray[np.int8] = field(default_factory=lambda: np.zeros(0, np.int8))
    corner_uv: FloatArray = field(default_factory=lambda: np.zeros((0, 3, 2)))
    folds: tuple[FoldEdge, ...] = ()
    corners: tuple[CornerPoint, ...] = ()
    open_m: Mapping[str, float] = field(default_factory=dict)
    rest: RestFacets = field(default_factory=RestFacets)

    @property
    def is_measured(self) -> BoolArray:
        """Which facets (m,) were measured; the others were inferred."""
        return np.asarray(self.face_provenance == Provenance.MEASURED, dtype=np.bool_)

    def part(self, kept: BoolArray) -> PanelPart:
        """Return some facets (m,) of one surface by themselves."""
        corner, uv = self.faces[kept].ravel(), self.corner_uv[kept].reshape(-1, 2)
        fine = np.rint(uv / _SAME_UV_M).astype(np.int64)
        _, first, index = np.unique(
            np.column_stack([corner, fine]), axis=0, return_index=True, return_inverse=True
        )
        return PanelPart(self.vertices[corner[first]], index.reshape(-1, 3).astype(np.int64), uv[first])
