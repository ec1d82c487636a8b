# SPDX-License-Identifier: MIT
"""Peers: meshes that Open3D makes of the same pixels."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenes.checks import FloatArray

Mesh = tuple[FloatArray, NDArray[np.int64]]
_DEPTH = 8  # of the octree
_BALL_M = 0.01
_THIN = 0.05  # share of Poisson's surface that fewest points support, cut away


def quadrics(vertices: FloatArray, faces: NDArray[np.int64], most: int) -> Mesh:
    """Quadric decimation to so many triangles."""
    return _arrays(_mesh(vertices, faces).simplify_quadric_decimation(most))


def poisson(vertices: FloatArray, faces: NDArray[np.int64], most: int) -> Mesh:  # noqa: ARG001 -- as the others
    """Poisson reconstruction of depth 8; what few points support is cut away."""
    import open3d as o3d

    mesh, density = o3d.geometry.TriangleMesh.create_from_point_cloud_poisson(
        _cloud(vertices, faces), depth=_DEPTH, n_threads=1
    )
    support = np.asarray(density, dtype=np.float64)
    mesh.remove_vertices_by_mask((support < np.quantile(support, _THIN)).tolist())
    return _arrays(mesh)


def ball_pivoting(vertices: FloatArray, faces: NDArray[np.int64], most: int) -> Mesh:  # noqa: ARG001 -- as the others
    """Ball pivoting with balls of one and two centimetres."""
    import open3d as o3d

    radii = o3d.utility.DoubleVector([_BALL_M, 2 * _BALL_M])
    mesh = o3d.geometry.TriangleMesh.create_from_point_cloud_ball_pivoting(_cloud(vertices, faces), radii)
    return _arrays(mesh)


def as_it_is(vertices: FloatArray, faces: NDArray[np.int64], most: int) -> Mesh:  # noqa: ARG001 -- as the others
    """The pixels' mesh."""
    return vertices, faces


PEERS: Mapping[str, Callable[[FloatArray, NDArray[np.int64], int], Mesh]] = {
    "the pixels' mesh": as_it_is,
    "quadrics, as many": quadrics,
    "quadrics, ten times as many": lambda vertices, faces, most: quadrics(vertices, faces, 10 * most),
    "Poisson, depth 8": poisson,
    "ball pivoting, 1 cm": ball_pivoting,
}


def _mesh(vertices: FloatArray, faces: NDArray[np.int64]) -> Any:
    import open3d as o3d

    mesh = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(vertices), o3d.utility.Vector3iVector(faces.astype(np.int32))
    )
    mesh.compute_vertex_normals()
    return mesh


def _cloud(vertices: FloatArray, faces: NDArray[np.int64]) -> Any:
    import open3d as o3d

    mesh = _mesh(vertices, faces)
    cloud = o3d.geometry.PointCloud(mesh.vertices)
    cloud.normals = mesh.vertex_normals
    return cloud


def _arrays(mesh: Any) -> Mesh:
    return np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.triangles, dtype=np.int64)
