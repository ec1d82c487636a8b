# SPDX-License-Identifier: MIT
"""Embree ray by ray, through embreex: there wherever the package installs.

What embreex does with what it should not be given, and why all comes through here: a NaN ray visits every
face; arrays that are too short are read out of bounds; `dists` is overwritten; a mesh added after the first
ray is ignored; the first ray builds the tree, holding the interpreter, and must come before any thread.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from scenes.checks import BoolArray, FloatArray
from scenes.rays.local_mesh import LocalMesh

_LARGEST = float(np.finfo(np.float32).max)  # what exceeds it is not finite in Embree


class SingleScene:
    """A mesh in Embree, for single rays; any thread may cast."""

    name = "embreex"

    def __init__(self, mesh: LocalMesh) -> None:
        self._centre = mesh.centre
        self._scene = EmbreeScene(robust=True)
        if len(mesh.faces):
            self._mesh = TriangleMesh(self._scene, mesh.vertices.astype(np.float32), mesh.faces)
        self._scene.run(np.zeros((1, 3), np.float32), np.array([[0, 0, -1]], np.float32))

    def first_faces(
        self,
        origins: FloatArray,
        directions: FloatArray,
        _columns: int,
        _coherent: bool | None,
        face: NDArray[np.int32],
    ) -> int:
        """Write the first face (n,) that each ray (n, 3) hits; as `PacketScene.first_faces`."""
        rays = usable_rays(origins - self._centre, directions)
        face[:] = -1
        if len(rays.which):
            face[rays.which] = self._scene.run(rays.origins, rays.directions)
        return len(rays.which)

    def any_hits(
        self, origins: FloatArray, targets: FloatArray, _coherent: bool | None, blocked: BoolArray
    ) -> None:
        """Write whether a face lies between origins and targets (n, 3); as `PacketScene.any_hits`."""
        with np.errstate(all="ignore"):
            local, way = origins - self._centre, targets - origins
        blocked[:] = ~(_finite(local) & _finite(way))
        rays = usable_rays(local, way)
        if len(rays.which):
            hit = self._scene.run(rays.origins, rays.directions, rays.reach, query="OCCLUDED")
            blocked[rays.which] = hit >= 0


class UsableRays(NamedTuple):
    """Rays that Embree may see.

    Attributes
    ----------
    which : (k,) int64
        Which of the given rays these are.
    origins, directions : (k, 3) float32
        Relative to the mesh's centre; unit vectors.
    reach : (k,) float32
        The length of the way, metres.
    """

    which: NDArray[np.int64]
    origins: NDArray[np.float32]
    directions: NDArray[np.float32]
    reach: NDArray[np.float32]


@np.errstate(all="ignore")  # what is not finite is left out
def usable_rays(local: FloatArray, way: FloatArray) -> UsableRays:
    """Return the rays from `local` (n, 3) or (1, 3) along `way` (n, 3) that are finite, with a direction."""
    length = np.sqrt(way[:, 0] * way[:, 0] + way[:, 1] * way[:, 1] + way[:, 2] * way[:, 2])
    which = np.flatnonzero(_finite(local) & _finite(way) & (length > 0))
    starts = np.broadcast_to(local, way.shape)[which].astype(np.float32)
    unit = way[which] * (1 / length[which])[:, None]
    return UsableRays(which, starts, unit.astype(np.float32), length[which].astype(np.float32))


def _finite(vectors: FloatArray) -> BoolArray:
    """Tell which rows hold numbers that float32 can hold."""
    return np.asarray((np.abs(vectors) <= _LARGEST).all(axis=1), np.bool_)
