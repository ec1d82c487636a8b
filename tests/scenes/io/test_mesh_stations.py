# SPDX-License-Identifier: MIT
"""A mesh as input: what is seen of it from places that are said."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from scenes.checks import InputError
from scenes.io.meshes.mesh_file import is_mesh
from scenes.io.point_files import read_part_file
from scenes.io.scan_request import ScanRequest, read_request, scan_mesh
from scenes.scan.range_image import MESH_SENSOR


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    """A box of 4 x 3 x 2.5 m seen from within, a hole in its wall x = 4."""
    box = trimesh.creation.box(bounds=[[0, 0, 0], [4, 3, 2.5]]).subdivide_to_size(0.25)
    middle = box.triangles_center
    hole = (middle[:, 0] > 3.99) & (np.abs(middle[:, 1:] - [1.5, 1.2]) < 0.4).all(axis=1)
    box.update_faces(~hole)
    path = tmp_path_factory.mktemp("mesh") / "room.ply"
    box.export(path)
    return path


def test_a_mesh_is_told_from_points_by_its_header(room, tmp_path):
    points = tmp_path / "points.ply"
    trimesh.PointCloud(np.zeros((5, 3))).export(points)
    assert is_mesh(room)
    assert not is_mesh(points)
    assert is_mesh(tmp_path / "absent.glb")
    assert not is_mesh(tmp_path / "absent.ply")


def test_words_in_a_comment_make_no_mesh_and_a_long_header_hides_none(tmp_path):
    """One answer for scans, parts and `unseen info`: that of the header's own lines."""
    cloud = tmp_path / "cloud.ply"
    head = "ply\nformat ascii 1.0\ncomment made of element face 5\nelement vertex 3\n"
    axes = "".join(f"property float {axis}\n" for axis in "xyz")
    cloud.write_text(f"{head}{axes}end_header\n0 0 0\n1 0 0\n0 1 0\n")
    assert not is_mesh(cloud)
    assert read_part_file(cloud).mesh is None
    mesh = tmp_path / "mesh.ply"
    long = "".join(f"comment {'x' * 200} {number}\n" for number in range(100))
    faces = "element face 1\nproperty list uchar int vertex_indices\n"
    mesh.write_text(
        f"ply\nformat ascii 1.0\n{long}element vertex 3\n{axes}{faces}end_header\n"
        "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
    )
    assert is_mesh(mesh)
    assert read_part_file(mesh).mesh is not None


def test_it_is_seen_from_each_place(room):
    one, other = scan_mesh(room, [(1, 1, 1), (3, 2, 1.5)])
    assert (one.sensor, one.name, other.name) == (MESH_SENSOR, "room 1", "room 2")
    assert one.origin == pytest.approx([1, 1, 1])
    assert other.origin == pytest.approx([3, 2, 1.5])
    points = one.points()[one.valid]
    assert points.min(axis=0) == pytest.approx([0, 0, 0], abs=1e-5)
    assert points.max(axis=0) == pytest.approx([4, 3, 2.5], abs=1e-5)
    assert 0.9 < one.valid.mean() < 1  # a hole brings nothing back
    assert any("no measured beam vetoes" in text for text in one.warnings)


def test_scans_of_a_mesh_lie_in_its_own_axes(room, tmp_path):
    turned = trimesh.load(room)
    turned.apply_transform(trimesh.transformations.rotation_matrix(-np.pi / 2, [1, 0, 0]))
    turned.export(tmp_path / "turned.glb")
    place = (1.0, 1.0, -1.0)  # of (1, 1, 1)
    request = ScanRequest((str(tmp_path / "turned.glb"),), origins=(place,), up="y")
    (scan,) = read_request(request).scans
    assert scan.origin == pytest.approx(place)
    points = scan.points()[scan.valid]
    assert points.max(axis=0)[:2] == pytest.approx([4, 2.5], abs=1e-5)
    assert points[:, 2].min() == pytest.approx(-3, abs=1e-5)


@pytest.mark.parametrize(
    ("origins", "told"),
    [
        ([(400, 300, 200)], r"from 400, 300, 200 only \d+ of 1620000 rays meet the mesh; give places inside"),
        ([(np.nan, 0, 0)], "place 1"),
    ],
)
def test_places_that_see_nothing_are_refused(room, origins, told):
    with pytest.raises(InputError, match=told):
        scan_mesh(room, origins)


def test_one_mesh_alone(room):
    with pytest.raises(InputError, match="give one mesh alone"):
        read_request(ScanRequest((str(room), str(room)), origins=((1, 1, 1), (2, 1, 1))))


@pytest.mark.parametrize(("n_rooms", "said"), [(1, ""), (3, "33% of its area is seen"), (5, "20% of its")])
def test_a_mesh_that_is_hardly_seen_says_so(tmp_path: Path, n_rooms: int, said: str) -> None:
    rooms = []
    for k in range(n_rooms):
        one = trimesh.creation.box((4.0, 3.0, 2.5))
        one.invert()
        one.apply_translation([6.0 * k, 0.0, 0.0])
        rooms.append(one)
    trimesh.util.concatenate(rooms).export(tmp_path / "flat.ply")
    (scan,) = scan_mesh(tmp_path / "flat.ply", [(0.3, 0.2, 0.1)])
    told = [text for text in scan.warnings if "of its area is seen" in text]
    assert (len(told), said in "".join(told)) == (bool(said), True)
