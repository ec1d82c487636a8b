# SPDX-License-Identifier: MIT
"""Ray casting: checked input, Embree behind it, ranges in float64."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Literal, NoReturn

import numpy as np
from numpy.typing import NDArray

from scenes.checks import (
    ArrayValue,
    BoolArray,
    FloatArray,
    InputError,
    check_faces,
    check_points,
    check_vectors,
)
from scenes.rays.local_mesh import LocalMesh, local_mesh
from scenes.run.memory import in_blocks

if TYPE_CHECKING:
    from scenes.rays.embree_packets import PacketScene
    from scenes.rays.embree_single import SingleScene

Backend = Literal["packets", "embreex"]

_CHUNK = 1 << 15  # rays a task; fixed, so that no result can depend on the number of threads
_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, eq=False)
class Hits(ArrayValue):
    """First hits of n rays, or of the pixels of an image, whose shape then stands for (n,).

    Attributes
    ----------
    ranges : (n,) float
        Distance along the ray in metres, from the hit triangle's plane in float64; inf for a miss.
    face : (n,) int32
        Index of the face, -1 for a miss.
    barycentric : (n, 3) float
        Weights of the face's corners, zero for a miss.
    incidence_cosine : (n,) float
        `|cosine|` between ray and face normal, zero for a miss.
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

    def flat(self) -> Hits:
        """The same hits, those of an image row after row in a list."""
        return Hits(
            self.ranges.reshape(-1),
            self.face.reshape(-1),
            self.barycentric.reshape(-1, 3),
            self.incidence_cosine.reshape(-1),
            self.n_not_finite,
        )


class RayCaster:
    """A mesh prepared for ray casting; build once, use from many threads.

    Embree works in float32, so the mesh is moved to its own centre first, and ranges are recomputed in
    float64 from the plane of the face that was hit, within the face's extent along the ray. Rays go to
    Embree in packets of 16 where its library loads and numba compiles, and one by one through embreex
    elsewhere (the log says so); the hits are the same but for rays through an edge that two faces share,
    where float32 may name either.

    A ray caster cannot be pickled: in another process build it anew, from arrays that may be memory-mapped.

    Parameters
    ----------
    vertices : (n, 3) float
        Metres. Copied.
    faces : (m, 3) int
        Vertex indices. Copied.
    n_threads : int, optional
        Threads that cast; all cores when not given. Results do not depend on it.
    backend : {"packets", "embreex"}, optional
        How rays reach Embree; the fastest that loads when not given.

    Raises
    ------
    InputError
        Vertices not finite, faces out of range, wrong shapes, n_threads < 1, an unknown backend or one that
        does not load here.
    EmbreeError
        Embree cannot build its tree, for want of memory for example.

    Examples
    --------
    >>> square = RayCaster([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    >>> hits = square.first_hit([[0.7, 0.2, 2.0], [5.0, 5.0, 2.0]], [[0, 0, -1], [0, 0, -1]])
    >>> hits.ranges.tolist(), hits.face.tolist()
    ([2.0, inf], [0, -1])
    """

    def __init__(
        self, vertices: object, faces: object, n_threads: int | None = None, *, backend: Backend | None = None
    ) -> None:
        points = check_points("vertices", vertices)
        indices = check_faces(faces, len(points))
        self._n_threads = _checked_threads(n_threads)
        self._mesh = local_mesh(points, indices)
        self._embree = _embree(self._mesh, backend)

    @property
    def n_faces(self) -> int:
        """How many faces can be hit."""
        return len(self._mesh.faces)

    @property
    def backend(self) -> str:
        """How rays reach Embree: "packets" or "embreex"."""
        return self._embree.name

    def on_threads(self, n_threads: int | None) -> RayCaster:
        """Return the same tree, cast by so many threads; all cores for None.

        Raises
        ------
        InputError
            n_threads < 1.
        """
        other = object.__new__(RayCaster)
        other._n_threads = _checked_threads(n_threads)
        other._mesh, other._embree = self._mesh, self._embree
        return other

    def __reduce__(self) -> NoReturn:
        raise TypeError("a RayCaster cannot be pickled or copied; build one in each process, from its mesh")

    def first_hit(self, origins: object, directions: object, *, coherent: bool | None = None) -> Hits:
        """Cast rays and return their first hits.

        Parameters
        ----------
        origins, directions : (n, 3) or (rows, columns, 3) float
            World coordinates in metres; directions need not have unit length. One origin of shape (1, 3)
            serves all directions. Rays that are not finite, or without direction, are misses and counted.
            Directions of an image's pixels are best given in its shape: neighbours are then cast together,
            in tiles of 4 x 4, and the hits have the image's shape.
        coherent : bool, optional
            Whether consecutive rays, or an image's neighbours, go nearly the same way; rays that do are
            faster so, and others slower. Found out of the rays, sixteen at a time, when not given, which is
            best; the hits are the same but for rays through an edge that two faces share.

        Raises
        ------
        InputError
            Wrong shapes.
        """
        from scenes.rays.ray_kernels import meet  # numba: imported when first needed

        start, along, shape = _check_rays(origins, directions)
        n, columns = len(along), shape[1] if len(shape) == 2 else 0
        ranges, face = np.empty(n), np.empty(n, np.int32)
        weights, cosine = np.empty((n, 3)), np.empty(n)

        def cast(rays: slice) -> int:
            begin, ways = start if len(start) == 1 else start[rays], along[rays]
            n_usable = self._embree.first_faces(begin, ways, columns, coherent, face[rays])
            meet(self._mesh, begin, ways, face[rays], (ranges[rays], weights[rays], cosine[rays]))
            return len(ways) - n_usable

        band = max(_CHUNK // columns // 4, 1) * 4 * columns if columns else _CHUNK
        n_not_finite = self._in_chunks(n, band, cast)
        return Hits(
            ranges.reshape(shape),
            face.reshape(shape),
            weights.reshape(*shape, 3),
            cosine.reshape(shape),
            n_not_finite,
        )

    def are_blocked(self, origins: object, targets: object, *, coherent: bool | None = None) -> BoolArray:
        """Tell for n segments whether the mesh is hit before the target is reached.

        Parameters
        ----------
        origins, targets : (n, 3) float
            Metres; one of shape (1, 3) serves all of the other. A target on the mesh itself must be lifted
            off it by the caller. A segment that is not finite counts as blocked; one without length as free.
        coherent : bool, optional
            Whether consecutive segments lie close together, as those from one point to points in
            `scenes.mesh.blocks.morton_order` do; as for `first_hit`.

        Raises
        ------
        InputError
            Wrong shapes.
        """
        begin, end = _contiguous("origins", origins), _contiguous("targets", targets)
        n = len(end) if len(begin) == 1 else len(begin)
        if len(begin) not in (1, n) or len(end) not in (1, n):
            raise InputError(
                f"{len(begin)} origins for {len(end)} targets; "
                "give as many of both, or one origin, or one target"
            )
        result = np.empty(n, np.bool_)

        def cast(rays: slice) -> int:
            starts, ends = (points if len(points) == 1 else points[rays] for points in (begin, end))
            self._embree.any_hits(starts, ends, coherent, result[rays])
            return 0

        self._in_chunks(n, _CHUNK, cast)
        return result

    blocked = are_blocked  # earlier name

    def _in_chunks(self, n: int, step: int, cast: Callable[[slice], int]) -> int:
        """Cast n rays, `step` at a time, and return the sum of what `cast` returns."""
        counts: list[int] = []
        in_blocks(n, lambda part: counts.append(cast(part)), self._n_threads, step)
        return sum(counts)


def _checked_threads(n_threads: int | None) -> int:
    if n_threads is not None and n_threads < 1:
        raise InputError(f"n_threads must be at least 1, got {n_threads}")
    return n_threads or os.cpu_count() or 1


def _embree(mesh: LocalMesh, backend: Backend | None) -> PacketScene | SingleScene:
    if backend not in (None, "packets", "embreex"):
        raise InputError(f"expected backend 'packets' or 'embreex', got {backend!r}")
    from numba import config  # here and below: imported when first needed, numba and Embree load slowly

    if backend != "embreex":
        try:
            if config.DISABLE_JIT:
                raise ImportError("numba's compiler is switched off")
            from scenes.rays.embree_packets import PacketScene

            return PacketScene(mesh)
        except (ImportError, OSError) as error:
            if backend == "packets":
                raise InputError(f"backend 'packets' does not load here: {error}") from error
            _warn_once(f"no packets of rays ({error}): casting one by one through embreex")
    from scenes.rays.embree_single import SingleScene

    return SingleScene(mesh)


@cache
def _warn_once(message: str) -> None:
    _log.warning(message)


def _check_rays(origins: object, directions: object) -> tuple[FloatArray, FloatArray, tuple[int, ...]]:
    """Return origins (n, 3) or (1, 3), directions (n, 3), and the shape that the hits shall have."""
    start, along = np.asarray(origins, np.float64), np.asarray(directions, np.float64)
    shape = along.shape[:-1]
    if along.ndim == 3:
        if start.shape not in ((1, 3), along.shape):
            raise InputError(
                f"origins of shape {start.shape} for directions of shape {along.shape}; "
                "give one origin of shape (1, 3), or one for each pixel"
            )
        start, along = start.reshape(-1, start.shape[-1]), along.reshape(-1, along.shape[-1])
    start, along = _contiguous("origins", start), _contiguous("directions", along)
    if len(start) not in (1, len(along)):
        raise InputError(
            f"{len(start)} origins for {len(along)} directions; give as many of both, or one origin"
        )
    return start, along, shape


def _contiguous(name: str, vectors: object) -> FloatArray:
    return np.ascontiguousarray(check_vectors(name, vectors))
