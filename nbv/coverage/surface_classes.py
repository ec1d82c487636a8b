# SPDX-License-Identifier: MIT
"""Classes of surface when completion stands in for views: met, modelled, inferred, unknown.

Completed surfaces of the scans so far, asked point by point.
A place that was measured too obliquely is modelled where its surface is determined well by all of its
pixels. A place that was never seen may be inferred. Both are looked up in the surfaces' charts.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt
from scipy.spatial import cKDTree

from completion.backs.options import BackOptions
from completion.evidence.evidence import Label
from completion.extension.patch import Patch
from completion.observe.tolerance import EvidenceOptions
from completion.options import CompletionOptions
from completion.pipeline import complete
from completion.result.completion import Completion
from nbv.visibility.limits import CLOSE_M, SAME_WAY
from nbv.visibility.samples import SurfaceSamples
from scenes.checks import BoolArray, FloatArray, Value
from scenes.inclination import Up
from scenes.mesh.labelled_mesh import LabelledMesh, triangle_areas
from scenes.mesh.triangle_distance import distances
from scenes.scan.range_image import RangeImage

SURE = 0.95  # confidence from which inferred surface counts
_SYMMETRIC = 0.9  # probability of a symmetry from which the surface that it implies counts
_ASSERTED = 0.98  # confidence of that surface: the share of it within 2 % of the size, of kinds not fitted on
_CONTINUED_M = 3.0  # how far surfaces are asked whether they go on
_MAX_CELLS = 40_000  # of a surface: places a few centimetres apart are told apart in a room


@dataclass(frozen=True, eq=False)
class KnownSurfaces(Value):
    """Surfaces that completion finds in some scans, measured and inferred.

    A surface is known where its fit has a standard deviation of no more than `max_sd_m`, metres, and inferred
    surface where it is there with a probability of `min_confidence` or more.
    """

    completion: Completion
    max_sd_m: float
    min_confidence: float = SURE

    @classmethod
    def of(
        cls,
        scans: Sequence[RangeImage],
        max_sd_m: float | None = None,
        *,
        relates: bool = True,
        n_threads: int | None = None,
    ) -> KnownSurfaces:
        """Complete `scans` of a world whose z is up, without texture.

        `max_sd_m` is completion's own when not given. Back sides of things count as inferred where a symmetry
        of probability 0.9 or more implies them.
        What surfaces are to each other is left out where nothing is to be related: it takes longer than all
        else of a few scans.
        """
        evidence = EvidenceOptions(max_cells=_MAX_CELLS)
        options = CompletionOptions(texture=False, up=Up.along("z"), evidence=evidence)
        options = options if relates else replace(options, relations=None)
        options = replace(options, max_sd_m=max_sd_m or options.max_sd_m, backs=BackOptions(least=_SYMMETRIC))
        return cls(complete(scans, options, rng=0, n_threads=n_threads), options.max_sd_m)

    def on_modelled(self, points: FloatArray, normals: FloatArray, close_m: float) -> BoolArray:
        """Tell which points (n, 3) lie on measured surface whose fit is exact enough.

        Parameters
        ----------
        points, normals : (n, 3) float
            World coordinates in metres, unit normals (of either sign).
        close_m : float
            How far from the fitted surface a point may lie, metres.
        """
        return self._lie_on(points, normals, close_m, self._exact)

    def on_inferred(self, points: FloatArray, normals: FloatArray, close_m: float) -> BoolArray:
        """Tell which points (n, 3) lie on inferred surface; parameters as for `on_modelled`."""
        return self._lie_on(points, normals, close_m, self._sure) | self._lie_on_backs(
            points, normals, close_m
        )

    def inferred_mesh(self) -> tuple[FloatArray, NDArray[np.int32], FloatArray]:
        """Inferred surface: vertices (n, 3) in world coordinates, faces (m, 3), confidence (m,) of each."""
        mesh = self.completion.hypothesised
        vertices = self.completion.world_from_reference.apply(mesh.vertices)
        backs, confidence = self._backs, mesh.confidence[mesh.faces].min(axis=1)
        faces = np.arange(len(vertices), len(vertices) + 3 * len(backs), dtype=np.int32).reshape(-1, 3)
        return (
            np.concatenate([vertices, backs.reshape(-1, 3)]),
            np.concatenate([mesh.faces, faces]),
            np.concatenate([confidence, np.full(len(backs), _ASSERTED)]),
        )

    def inferred_points(self, spacing_m: float) -> tuple[FloatArray, FloatArray]:
        """Points (n, 3) in world coordinates of inferred surface, about so far apart; confidence (n,)."""
        vertices, faces, confidence = self.inferred_mesh()
        corners = vertices[faces]
        edge = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1, initial=0.0)
        n = np.maximum(np.ceil(edge / spacing_m), 1).astype(np.int64)
        points, sure = [corners.mean(axis=1)], [confidence]
        for k in np.unique(n[n > 1]):
            few, (i, j) = n == k, np.nonzero(np.add.outer(np.arange(k), np.arange(k)) < k)
            weights = np.column_stack([i, j, k - 1 - i - j]) / max(k - 1, 1)
            points.append(np.einsum("kc,ncd->nkd", weights, corners[few]).reshape(-1, 3))
            sure.append(np.repeat(confidence[few], len(weights)))
        return np.concatenate(points), np.concatenate(sure)

    def continued_points(self, spacing_m: float) -> tuple[FloatArray, FloatArray]:
        """Where measured surfaces may go on and no scan tells: points (n, 3), world, about so far apart.

        The second array (n,) says how far each lies from what was measured of its surface, metres.
        """
        world, points, away = self.completion.world_from_reference, [np.zeros((0, 3))], [np.zeros(0)]
        for patch in self.completion.patches:
            free = np.isin(patch.evidence.labels, (Label.FREE, Label.VISIBLE))
            cells = patch.is_within & ~(patch.observed | patch.hypothesised | free)
            step = max(int(spacing_m / patch.grid.cell.max()), 1)
            distance = distance_transform_edt(~patch.observed, sampling=patch.grid.cell[::-1])
            few = np.flatnonzero(cells & (distance <= _CONTINUED_M))
            rows, columns = np.divmod(few, patch.grid.shape[1])
            few = few[(rows % step == 0) & (columns % step == 0)]
            points.append(world.apply(patch.grid.centres()[few]))
            away.append(distance.ravel()[few])
        return np.concatenate(points), np.concatenate(away)

    @cached_property
    def _backs(self) -> FloatArray:
        """Triangles (m, 3, 3) of the back sides of things that a symmetry implies, world coordinates."""
        things = [one for one in self.completion.things if one.back is not None and one.is_inferred.any()]
        corners = [one.world_vertices()[one.back.shape.faces[one.is_inferred]] for one in things if one.back]
        return np.concatenate([np.zeros((0, 3, 3)), *corners])

    def _lie_on_backs(self, points: FloatArray, normals: FloatArray, close_m: float) -> BoolArray:
        """Tell which points (n, 3) lie on such back sides, their normals along these."""
        mask, backs = np.zeros(len(points), dtype=np.bool_), self._backs
        if len(backs):
            off = np.cross(backs[:, 1] - backs[:, 0], backs[:, 2] - backs[:, 0])
            off /= np.maximum(np.linalg.norm(off, axis=1, keepdims=True), 1e-15)
            away, face = cKDTree(backs.mean(axis=1)).query(points)
            edge = np.linalg.norm(backs[:, 1] - backs[:, 0], axis=1).max()
            near = np.flatnonzero(away <= close_m + edge)
            gap = np.einsum("ij,ij->i", points[near] - backs[face[near], 0], off[face[near]])
            along = np.abs(np.einsum("ij,ij->i", off[face[near]], normals[near])) >= SAME_WAY
            mask[near] = along & (np.abs(gap) <= close_m)
        return mask

    def _sure(self, patch: Patch) -> BoolArray:
        return patch.hypothesised & (patch.confidence >= self.min_confidence)

    def _exact(self, patch: Patch) -> BoolArray:
        return patch.observed & (patch.spread <= self.max_sd_m)

    def _lie_on(
        self, points: FloatArray, normals: FloatArray, close_m: float, cells_of: Callable[[Patch], BoolArray]
    ) -> BoolArray:
        """Tell which points lie near such cells of a surface, their normals along its own."""
        mask = np.zeros(len(points), dtype=np.bool_)
        reference_from_world = self.completion.world_from_reference.inverse()
        local, turned = reference_from_world.apply(points), reference_from_world.rotate(normals)
        for patch in self.completion.patches:
            surface, cells = patch.grid.surface, cells_of(patch)
            near = np.flatnonzero(np.abs(surface.distance(local)) <= close_m)
            along = np.abs(np.einsum("ij,ij->i", surface.normal(local[near]), turned[near])) >= SAME_WAY
            near = near[along]
            index, cell = patch.grid.cells_of(local[near])
            mask[near[index]] |= cells.ravel()[cell]
        return mask


MET, MODELLED, INFERRED, UNKNOWN = range(4)
CLASSES = ("met", "modelled", "inferred", "unknown")


@dataclass(frozen=True, slots=True)
class ClassShares(Value):
    """Shares of a scene's area by class after some views, and how much of the inferred area is right.

    Attributes
    ----------
    met : float
        Measured as required.
    modelled : float
        Seen, the requirement missed, but within 2 cm of a fitted surface that is exact enough there.
    inferred : float
        Neither met nor modelled, within 2 cm of inferred surface.
    unknown : float
        The rest.
    reached : float
        Share of the reachable area that is not unknown; 1 where nothing is reachable.
    inferred_m2, right_m2 : float
        Area of inferred surface in square metres, and how much of it lies within 2 cm of the true surface.
    """

    views: int
    met: float
    modelled: float
    inferred: float
    unknown: float
    reached: float
    inferred_m2: float
    right_m2: float

    @property
    def known(self) -> float:
        """Share of the area that is met, modelled or inferred."""
        return self.met + self.modelled + self.inferred

    def to_json(self) -> dict[str, float]:
        """Return the entry of `plan.json`."""
        return asdict(self)


def classify(
    samples: SurfaceSamples, met: BoolArray, seen: BoolArray, completed: KnownSurfaces
) -> NDArray[np.int8]:
    """Return the class (n,) of each sample of the true surface.

    Views have measured `met` (n,) of them as required, and `seen` (n,); `completed` is made of their scans.
    """
    classes = np.full(len(samples), UNKNOWN, np.int8)
    classes[completed.on_inferred(samples.points, samples.normals, CLOSE_M)] = INFERRED
    classes[seen & completed.on_modelled(samples.points, samples.normals, CLOSE_M)] = MODELLED
    classes[met] = MET
    return classes


def shares_of(
    classes: NDArray[np.int8],
    samples: SurfaceSamples,
    reachable: BoolArray,
    completed: KnownSurfaces,
    truth: LabelledMesh,
    views: int,
) -> ClassShares:
    """Return the shares of `classes` (n,) of the samples, and how much inferred area is true.

    `reachable` (n,) tells which samples some candidate could measure as required.
    """
    met, modelled, inferred, unknown = (
        float(samples.areas[classes == kind].sum()) / samples.total_m2 for kind in range(len(CLASSES))
    )
    areas = samples.areas[reachable]
    reached = float(areas[classes[reachable] != UNKNOWN].sum() / areas.sum()) if len(areas) else 1.0
    vertices, faces, confidence = completed.inferred_mesh()
    corners = vertices[faces[confidence >= completed.min_confidence]]
    area = triangle_areas(corners)
    right = distances(corners.mean(axis=1), truth.corners) <= CLOSE_M
    claimed, true = float(area.sum()), float(area[right].sum())
    return ClassShares(
        views=views,
        met=met,
        modelled=modelled,
        inferred=inferred,
        unknown=unknown,
        reached=reached,
        inferred_m2=claimed,
        right_m2=true,
    )
