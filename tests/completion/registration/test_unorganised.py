# SPDX-License-Identifier: MIT
"""Registration of clouds without a grid or poses, against point-to-plane ICP from the known right start."""

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from completion.registration.pipeline import register_scans
from scenes.io.scan_request import ScanRequest, read_request
from tests.helpers.data_paths import data_path, requires_data

START = np.array([1.79387, 0.720047, 0.0]), np.array([0.0, 0.0, 0.6931])
"""Of PCL's tutorial on the normal distributions transform for these two clouds: metres, rotation vector."""


def normals_of(points):
    """Normals (n, 3) by the nearest dozen, and which of them are of flat places (n,)."""
    near = points[cKDTree(points).query(points, k=12)[1]]
    near = near - near.mean(axis=1, keepdims=True)
    values, vectors = np.linalg.eigh(np.einsum("nki,nkj->nij", near, near))
    return vectors[:, :, 0], values[:, 0] < 0.01 * values.sum(axis=1)


def icp(first, second):
    """Rotation and shift that bring `second` (n, 3) to `first` (m, 3) from `START` (Chen & Medioni 1991)."""
    shift, turn = START[0], Rotation.from_rotvec(START[1])
    normals, is_flat = normals_of(first)
    first, normals = first[is_flat], normals[is_flat]
    tree = cKDTree(first)
    for gate in np.repeat([1.0, 0.5, 0.3, 0.2, 0.1, 0.05], 15):
        moved = turn.apply(second) + shift
        away, nearest = tree.query(moved, distance_upper_bound=gate)
        met = np.isfinite(away)
        at, normal = moved[met], normals[nearest[met]]
        error = ((at - first[nearest[met]]) * normal).sum(axis=1)
        weight = 1 / (1 + (error / 0.03) ** 2)
        slope = np.hstack([np.cross(at, normal), normal])
        step = np.linalg.solve((slope * weight[:, None]).T @ slope, -(slope * weight[:, None]).T @ error)
        small = Rotation.from_rotvec(step[:3])
        turn, shift = small * turn, small.apply(shift) + step[3:]
    return turn, shift


@requires_data
@pytest.mark.long
def test_two_clouds_of_a_room_are_placed_as_icp_from_the_right_start_places_them():
    paths = tuple(str(data_path(f"range/pcl_room/room_scan{k}.pcd")) for k in (1, 2))
    scans = read_request(ScanRequest(paths, origins=((0, 0, 0), (0, 0, 0))), posed=False).scans
    found = register_scans(scans).world_poses(scans)
    assert None not in found
    # the files' own axes: the scans' frames are those that their images were given
    moved = [pose @ scan.world_from_sensor.inverse() for pose, scan in zip(found, scans, strict=True)]
    first_from_second = moved[0].inverse() @ moved[1]
    turn, shift = icp(*(scan.points()[scan.valid] for scan in scans))
    assert np.linalg.norm(first_from_second.translation - shift) < 0.03
    off = turn.inv() * Rotation.from_matrix(first_from_second.rotation)
    assert np.degrees(off.magnitude()) < 0.5
