# SPDX-License-Identifier: MIT
"""Embree ray by ray, through embreex: there wherever the package installs.

What embreex does with what it should not be given, and why all comes through here: a NaN ray visits every
face; arrays that are too short are read out of bounds; `dists` is overwritten; a mesh added after the first
ray is ignored; the first ray builds the tree, holding the interpreter, and must come before any thread.
"""

from __future__ import annotations

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from scenes.checks import BoolArray, FloatArray
from scenes.rays.local_mesh import LocalMesh
from scenes.rays.ray_kernels import pack_rays, pack_segments


class SingleScene:
    """A mesh in Embree, for single rays; any thread may cast.

    Parameters
    ----------
    mesh : LocalMesh
        The triangles.
    """

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
        _coherent: bool,
        face: NDArray[np.int32],
    ) -> int:
        """Write the first face (n,) that each ray (n, 3) hits; as `PacketScene.first_faces`."""
        rays = pack_rays(origins, directions, self._centre)
        if len(rays.origins) < len(face):
            face[:] = -1
        if len(rays.origins):
            face[rays.which] = self._scene.run(rays.origins, rays.directions)
        return len(rays.origins)

    def any_hits(self, origins: FloatArray, targets: FloatArray, _coherent: bool, blocked: BoolArray) -> None:
        """Write whether a face lies between origins and targets (n, 3); as `PacketScene.any_hits`."""
        rays = pack_segments(origins, targets, self._centre, blocked)
        if len(rays.origins):
            hit = self._scene.run(rays.origins, rays.directions, rays.reach, query="OCCLUDED")
            blocked[rays.which] = hit >= 0
