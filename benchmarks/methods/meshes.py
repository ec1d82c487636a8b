# SPDX-License-Identifier: MIT
"""Meshes that Open3D makes of scans, and of the mesh of their pixels."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenes.checks import FloatArray
from scenes.scan.range_image import RangeImage

Mesh = tuple[FloatArray, NDArray[np.int64]]
_DEPTH = 8  # of the octree
_BALL_M = 0.01
_THIN = 0.05  # share of Poisson's surface that fewest points support, cut away


def quadrics(vertices: FloatArray, faces: NDArray[np.int64], most: int) -> Mesh:
    """Quadric decimation to so many triangles."""
    return _arrays(_mesh(vertices, faces).simplify_quadric_decimation(most))


def poisson(cloud: Any) -> Mesh:
    """Poisson reconstruction of depth 8; what few points support is cut away."""
    import open3d as o3d

    mesh, density = o3d.geometry.TriangleMesh.create_from_point_cloud_poisson(
        cloud, depth=_DEPTH, n_threads=1
    )
    support = np.asarray(density, dtype=np.float64)
    mesh.remove_vertices_by_mask((support < np.quantile(support, _THIN)).tolist())
    return _arrays(mesh)


def ball_pivoting(cloud: Any) -> Mesh:
    """Ball pivoting with balls of one and two centimetres."""
    import open3d as o3d

    radii = o3d.utility.DoubleVector([_BALL_M, 2 * _BALL_M])
    return _arrays(o3d.geometry.TriangleMesh.create_from_point_cloud_ball_pivoting(cloud, radii))


def poisson_of_scans(scans: Sequence[RangeImage]) -> Mesh:
    """Poisson reconstruction of the points of scans."""
    return poisson(_scanned(scans))


def ball_pivoting_of_scans(scans: Sequence[RangeImage]) -> Mesh:
    """Ball pivoting over the points of scans."""
    return ball_pivoting(_scanned(scans))


def _scanned(scans: Sequence[RangeImage]) -> Any:
    """The points of scans, one a voxel of a centimetre, with normals towards the sensors."""
    import open3d as o3d

    whole = o3d.geometry.PointCloud()
    for scan in scans:
        cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(scan.points()[scan.valid]))
        cloud = cloud.voxel_down_sample(_BALL_M)
        cloud.estimate_normals(o3d.geometry.KDTreeSearchParamHybrid(radius=5 * _BALL_M, max_nn=30))
        cloud.orient_normals_towards_camera_location(scan.origin)
        whole += cloud
    return whole


PEERS: Mapping[str, Callable[[FloatArray, NDArray[np.int64], int], Mesh]] = {
    "the pixels' mesh": lambda vertices, faces, _most: (vertices, faces),
    "quadrics, as many": quadrics,
    "quadrics, ten times as many": lambda vertices, faces, most: quadrics(vertices, faces, 10 * most),
    "Poisson, depth 8": lambda vertices, faces, _most: poisson(_cloud(vertices, faces)),
    "ball pivoting, 1 cm": lambda vertices, faces, _most: ball_pivoting(_cloud(vertices, faces)),
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
