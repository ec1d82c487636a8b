# SPDX-License-Identifier: MIT
"""Point-to-plane registration of two scans, as a user would run it on the scans of a plan."""

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from scenes.pose import Pose
from scenes.scan.range_image import RangeImage

_USED = 3000  # of the moved points
_NEAR = 12  # points through which a plane is fitted
_REACHES_M = (*(0.25,) * 5, *(0.15,) * 5, *(0.1,) * 5, *(0.06,) * 5)  # of pairs, iteration by iteration
_FLAT = 0.05  # largest ratio of the two smallest variances in a flat neighbourhood


def points_of(scan: RangeImage) -> np.ndarray:
    """Return the measured points (n, 3), world coordinates."""
    return scan.points()[scan.valid]


def normals_of(points: np.ndarray) -> np.ndarray:
    """Return the normals (n, 3) of planes through the neighbourhoods of points; NaN where they are bent."""
    near = points[cKDTree(points).query(points, k=_NEAR)[1]]
    near -= near.mean(axis=1, keepdims=True)
    values, vectors = np.linalg.eigh(np.einsum("nki,nkj->nij", near, near))
    normals = vectors[:, :, 0].copy()
    normals[values[:, 0] > _FLAT * values[:, 1]] = np.nan
    return normals


def register(moved: np.ndarray, fixed: np.ndarray) -> Pose:
    """Return the motion that takes the points `moved` (n, 3) on to the surface of `fixed` (m, 3)."""
    some = np.random.default_rng(0).permutation(len(moved))[:_USED]
    tree, normals, own, moved = cKDTree(fixed), normals_of(fixed), normals_of(moved)[some], moved[some]
    centre = moved.mean(axis=0)
    rotation, shift = np.eye(3), np.zeros(3)
    for reach in _REACHES_M:
        now = (moved - centre) @ rotation.T
        distance, nearest = tree.query(now + centre + shift)
        normal = normals[nearest]
        alike = np.abs(((own @ rotation.T) * normal).sum(axis=1)) > 0.95  # False where a normal is not known
        pairs = (distance < reach) & alike
        arm, n = now[pairs], normal[pairs]
        gap = ((fixed[nearest[pairs]] - arm - centre - shift) * n).sum(axis=1)
        rows = np.hstack([np.cross(arm, n), n])
        turn, step = np.split(np.linalg.solve(rows.T @ rows, rows.T @ gap), 2)
        rotation, shift = Rotation.from_rotvec(turn).as_matrix() @ rotation, shift + step
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, centre + shift - rotation @ centre
    return Pose(matrix)


def displaced(scan: RangeImage, rng: np.random.Generator, turn_deg: float, shift_m: float) -> Pose:
    """Return a motion about the scan's own station: a random turn and a random shift."""
    turn, shift = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
    rotation = Rotation.from_rotvec(np.radians(turn_deg) * turn).as_matrix()
    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    matrix[:3, 3] = scan.origin - rotation @ scan.origin + shift_m * shift
    return Pose(matrix)
