# SPDX-License-Identifier: MIT
"""Border: where the measured facets of a surface end, and the places on it that are nearest to points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from completion.panels.healing import edges_of
from completion.panels.model import PanelModel
from scenes.checks import FloatArray

_TRIED = 6  # samples of the border around a point whose edges are tried


@dataclass(frozen=True, slots=True, eq=False)
class OnBorder:
    """The places on a border that are nearest to n points.

    Attributes
    ----------
    edge : (n,) int
        Which edge each is on; -1 where the border is out of reach.
    share : (n,) float
        How far along it, 0 at its first vertex and 1 at its second.
    """

    edge: NDArray[np.int64]
    share: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Border:
    """The edges of measured facets beside which their surface was not measured: at holes, folds, shadows.

    Attributes
    ----------
    vertices : (n, 3) float
        Of the light model.
    edges : (m, 2) int
        Vertices of each edge, once for every surface whose border it is.
    surface : (m,) int
        Number of that surface.
    """

    vertices: FloatArray
    edges: NDArray[np.int64]
    surface: NDArray[np.int64]

    @classmethod
    def of(cls, panels: PanelModel) -> Border:
        """Return the border of all surfaces of a light model."""
        edges, surface = [np.zeros((0, 2), np.int64)], [np.zeros(0, np.int64)]
        measured = panels.is_measured
        for number in np.unique(panels.face_surface[measured]).tolist():
            found, count, _ = edges_of(panels.faces[measured & (panels.face_surface == number)])
            edges.append(found[count == 1])
            surface.append(np.full(np.count_nonzero(count == 1), number))
        return cls(panels.vertices, np.concatenate(edges), np.concatenate(surface))

    def nearest(self, points: FloatArray, owner: NDArray[np.int64], reach_m: FloatArray) -> OnBorder:
        """Return the places on the borders of the points' owners that are nearest to points (n, 3).

        `owner` (n,) are numbers of surfaces, 0 for none; `reach_m` (surfaces,) how far away it may be.
        """
        result = OnBorder(np.full(len(points), -1, np.int64), np.zeros(len(points)))
        for number in np.unique(owner[owner > 0]).tolist():
            asked, own = np.flatnonzero(owner == number), np.flatnonzero(self.surface == number)
            if not len(own):
                continue
            edge, share, off = self._nearest(points[asked], own, float(reach_m[number - 1]))
            near = off <= reach_m[number - 1]
            result.edge[asked[near]], result.share[asked[near]] = edge[near], share[near]
        return result

    def _nearest(
        self, points: FloatArray, own: NDArray[np.int64], spacing_m: float
    ) -> tuple[NDArray[np.int64], FloatArray, FloatArray]:
        """The nearest of some edges to points (n, 3), how far along it (n,), and how far off (n,), metres."""
        begin, way = self.vertices[self.edges[own, 0]], np.diff(self.vertices[self.edges[own]], axis=1)[:, 0]
        n_pieces = np.ceil(np.linalg.norm(way, axis=1) / spacing_m).astype(np.int64) + 1
        of = np.repeat(np.arange(len(own)), n_pieces)
        step = np.arange(len(of)) - np.repeat(np.cumsum(n_pieces) - n_pieces, n_pieces)
        samples = begin[of] + (step / np.maximum(n_pieces[of] - 1, 1))[:, None] * way[of]
        k = min(_TRIED, len(samples))
        tried = of[cKDTree(samples).query(points, k=k)[1].reshape(len(points), k)]
        length = np.maximum((way * way).sum(axis=1), 1e-18)
        share = ((points[:, None] - begin[tried]) * way[tried]).sum(axis=2) / length[tried]
        share = np.clip(share, 0.0, 1.0)
        off = np.linalg.norm(begin[tried] + share[..., None] * way[tried] - points[:, None], axis=2)
        row, best = np.arange(len(points)), off.argmin(axis=1)
        return own[tried[row, best]], share[row, best], off[row, best]

    def at(self, place: OnBorder) -> FloatArray:
        """Return the points (k, 3) of those places that are within reach."""
        on = place.edge >= 0
        begin, end = (self.vertices[self.edges[place.edge[on], k]] for k in (0, 1))
        return np.asarray(begin + place.share[on, None] * (end - begin), dtype=np.float64)
