# SPDX-License-Identifier: MIT
"""Ray casting: the one file that knows Embree, behind checked input and float64 ranges."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from scenes.checks import (
    BoolArray,
    FloatArray,
    InputError,
    check_faces,
    check_points,
    check_vectors,
    finite_rows,
)

_CHUNK = 1 << 16  # rays a task; fixed, so that no result can depend on the number of threads


@dataclass(frozen=True, slots=True, eq=False)
class Hits:
    """First hits of n rays.

    Attributes
    ----------
    ranges : (n,) float
        Distance along the ray in metres, from the hit triangle's plane in float64; inf for a miss.
    face : (n,) int32
        Index of the face, -1 for a miss.
    barycentric : (n, 3) float
        Weights of the face's corners, zero for a miss.
    incidence_cosine : (n,) float
        |cosine| between ray and face normal, zero for a miss.
    n_not_finite : int
        Rays that were not finite (in float32, as Embree works) or had no direction; they count as misses.
    """

    ranges: FloatArray
    face: NDArray[np.int32]
    barycentric: FloatArray
    incidence_cosine: FloatArray
    n_not_finite: int

    @property
    def hit(self) -> BoolArray:
        """Which rays hit, shape (n,)."""
        return self.face >= 0


class RayCaster:
    """A mesh prepared for ray casting; build once, use from many threads.

    Embree works in float32, so the mesh is moved to its own centre first, and ranges are recomputed in
    float64 from the plane of the face that was hit, within the face's extent along the ray.

    Parameters
    ----------
    vertices : (n, 3) float
        Metres.
    faces : (m, 3) int
        Vertex indices.
    n_threads : int, optional
        Threads that cast; all cores when not given. Results do not depend on it.

    Raises
    ------
    InputError
        Vertices not finite, faces out of range, wrong shapes, n_threads < 1.

    Examples
    --------
    >>> square = RayCaster([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    >>> hits = square.first_hit([[0.7, 0.2, 2.0], [5.0, 5.0, 2.0]], [[0, 0, -1], [0, 0, -1]])
    >>> hits.ranges.tolist(), hits.face.tolist()
    ([2.0, inf], [0, -1])
    """

    def __init__(self, vertices: object, faces: object, n_threads: int | None = None) -> None:
        points = check_points("vertices", vertices)
        indices = check_faces(faces, len(points))
        if n_threads is not None and n_threads < 1:
            raise InputError(f"n_threads must be at least 1, got {n_threads}")
        self._n_threads = n_threads or os.cpu_count() or 1
        used, compact = np.unique(indices, return_inverse=True)
        points = points[used]  # a stray vertex must not move the centre
        self._centre = (points.min(axis=0) + points.max(axis=0)) / 2 if len(points) else np.zeros(3)
        indices = np.ascontiguousarray(compact.reshape(-1, 3), dtype=np.int32)
        corners = points[indices] - self._centre
        self._corner = np.ascontiguousarray(corners[:, 0])
        self._edges = np.ascontiguousarray(corners[:, 1:] - corners[:, :1])
        self._normals = np.cross(self._edges[:, 0], self._edges[:, 1])
        self._scene = None
        if len(indices):
            self._scene = EmbreeScene(robust=True)
            local = np.ascontiguousarray(points - self._centre, dtype=np.float32)
            self._mesh = TriangleMesh(self._scene, local, indices)
            down = np.array([[0, 0, -1]], np.float32)  # the first ray commits the scene, before any thread
            self._scene.run(np.zeros((1, 3), np.float32), down)

    @property
    def n_faces(self) -> int:
        """How many faces can be hit."""
        return len(self._corner)

    def first_hit(self, origins: object, directions: object) -> Hits:
        """Cast rays and return their first hits.

        Parameters
        ----------
        origins, directions : (n, 3) float
            World coordinates in metres; directions need not have unit length. One origin of shape (1, 3)
            serves all directions. Rays that are not finite, or without direction, are misses and counted.

        Raises
        ------
        InputError
            Wrong shapes.
        """
        start, along, usable = self._checked(origins, directions)
        n_rays = len(along)
        ranges, face = np.full(n_rays, np.inf), np.full(n_rays, -1, np.int32)
        weights, cosine = np.zeros((n_rays, 3)), np.zeros(n_rays)

        def cast(rays: NDArray[np.intp]) -> None:
            hit_face = self._run(start[rays], along[rays], None)
            hit = hit_face >= 0
            rays, hit_face = rays[hit], hit_face[hit]
            ranges[rays], weights[rays], cosine[rays] = self._meet(start[rays], along[rays], hit_face)
            face[rays] = hit_face

        self._in_chunks(np.flatnonzero(usable), cast)
        return Hits(ranges, face, weights, cosine, int(n_rays - usable.sum()))

    def blocked(self, origins: object, targets: object) -> BoolArray:
        """Tell for n segments whether the mesh is hit before the target is reached.

        Parameters
        ----------
        origins, targets : (n, 3) float
            Metres. A target on the mesh itself must be lifted off it by the caller. A segment that is not
            finite counts as blocked; one without length as free.
        """
        end = check_vectors("targets", targets)
        begin = check_vectors("origins", origins)
        if len(begin) == 1 and len(end) != 1:
            begin = np.broadcast_to(begin, end.shape)
        if begin.shape != end.shape:
            raise InputError(
                f"{len(begin)} origins for {len(end)} targets; give as many of both, or one origin"
            )
        finite = _finite_in_float32(begin, end)
        way = np.subtract(end, begin, out=np.zeros_like(end), where=finite[:, None])
        length = np.linalg.norm(way, axis=1)
        start, along, usable = self._checked(begin, way)
        result = np.zeros(len(end), dtype=np.bool_)
        result[~finite] = True

        def cast(rays: NDArray[np.intp]) -> None:
            result[rays] = self._run(start[rays], along[rays], length[rays].astype(np.float32)) >= 0

        self._in_chunks(np.flatnonzero(usable), cast)
        return result

    def _checked(self, origins: object, directions: object) -> tuple[FloatArray, FloatArray, BoolArray]:
        start, along = check_vectors("origins", origins), check_vectors("directions", directions)
        if len(start) == 1 and len(along) != 1:
            start = np.broadcast_to(start, along.shape)
        if start.shape != along.shape:
            raise InputError(
                f"{len(start)} origins for {len(along)} directions; give as many of both, or one origin"
            )
        start = start - self._centre
        usable = _finite_in_float32(start, along)
        length = np.linalg.norm(np.where(usable[:, None], along, 0.0), axis=1)
        usable = np.logical_and(usable, length > 0)
        unit = np.divide(along, length[:, None], out=np.zeros_like(along), where=usable[:, None])
        return start, unit, usable

    def _run(
        self, start: FloatArray, along: FloatArray, reach: NDArray[np.float32] | None
    ) -> NDArray[np.int32]:
        """First face hit by each ray; with `reach`, 0 where anything nearer is hit; -1 for none."""
        if self._scene is None or not len(start):
            return np.full(len(start), -1, np.int32)
        origins = np.ascontiguousarray(start, dtype=np.float32)
        directions = np.ascontiguousarray(along, dtype=np.float32)
        if reach is None:
            faces: NDArray[np.int32] = self._scene.run(origins, directions)
            return faces
        blocked: NDArray[np.int32] = self._scene.run(origins, directions, reach, query="OCCLUDED")
        return blocked

    def _meet(
        self, start: FloatArray, along: FloatArray, face: NDArray[np.int32]
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Range, corner weights and |cosine| where rays meet the planes of their faces, in float64."""
        first, second = self._edges[face, 0], self._edges[face, 1]
        normal = self._normals[face]
        to_corner = self._corner[face] - start
        slope = np.einsum("ij,ij->i", along, normal)
        height = np.einsum("ij,ij->i", to_corner, normal)
        with np.errstate(over="ignore"):
            ranges = np.divide(height, slope, out=np.zeros_like(height), where=slope != 0)
        # A ray that grazes its face meets the face's plane anywhere: keep it between the face's corners.
        corners = np.stack([to_corner, to_corner + first, to_corner + second])
        depths = np.maximum(np.einsum("cij,ij->ci", corners, along), 0.0)
        ranges = np.clip(ranges, depths.min(axis=0), depths.max(axis=0))
        offset = along * ranges[:, None] - to_corner
        area2 = np.einsum("ij,ij->i", normal, normal)
        safe = np.where(area2 > 0, area2, 1.0)
        v = np.einsum("ij,ij->i", np.cross(offset, second), normal) / safe
        w = np.einsum("ij,ij->i", np.cross(first, offset), normal) / safe
        weights = np.clip(np.stack([1 - v - w, v, w], axis=1), 0.0, 1.0)
        weights /= weights.sum(axis=1, keepdims=True)
        return ranges, weights, np.minimum(np.abs(slope) / np.sqrt(safe), 1.0)

    def _in_chunks(self, rays: NDArray[np.intp], cast: Callable[[NDArray[np.intp]], None]) -> None:
        chunks = [rays[start : start + _CHUNK] for start in range(0, len(rays), _CHUNK)]
        if self._n_threads == 1 or len(chunks) < 2:
            for chunk in chunks:
                cast(chunk)
            return
        with ThreadPoolExecutor(self._n_threads) as pool:
            list(pool.map(cast, chunks))


def _finite_in_float32(*vectors: FloatArray) -> BoolArray:
    """Tell for which rows all (n, 3) `vectors` hold numbers that float32 can hold."""
    with np.errstate(over="ignore"):
        return finite_rows(np.hstack(vectors).astype(np.float32))
