# SPDX-License-Identifier: MIT
"""Other libraries: meshes and clouds that are taken by their attributes, and what values turn into."""

import sys
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

import completion
from nbv import CheckedDesign, PinholeSensor, plan_views
from scenes import InputError, LabelledMesh, PointCloud, Scene
from tests.helpers.completion_examples import completed, example
from tests.helpers.room_examples import ROOM, VIEW, covered_by_two
from tests.nbv.inspection.checks import example_check

BOX = trimesh.creation.box((2.0, 3.0, 1.0))
COUNTED = np.insert(BOX.faces, 0, 3, axis=1).ravel()  # as VTK has them


class Open3d(SimpleNamespace):
    """Open3D by the names that are used of it; its vectors refuse read-only arrays, as they do."""

    def __init__(self) -> None:
        cloud, mesh = type("PointCloud", (), {}), type("TriangleMesh", (), {"__init__": self.build})
        super().__init__(
            geometry=SimpleNamespace(PointCloud=cloud, TriangleMesh=mesh),
            utility=SimpleNamespace(Vector3dVector=self.vector, Vector3iVector=self.vector),
        )

    @staticmethod
    def build(mesh, vertices, triangles):
        mesh.vertices, mesh.triangles = vertices, triangles

    @staticmethod
    def vector(rows):
        assert rows.flags.writeable
        assert rows.flags.c_contiguous
        return rows


@pytest.fixture
def open3d(monkeypatch):
    monkeypatch.setitem(sys.modules, "open3d", Open3d())


@pytest.fixture
def pandas(monkeypatch):
    """Frames that are the rows or the text that they are made of."""
    fake = SimpleNamespace(DataFrame=lambda rows: rows, read_csv=lambda file: file.read().splitlines())
    monkeypatch.setitem(sys.modules, "pandas", fake)


@pytest.mark.parametrize(
    "mesh",
    [
        BOX,
        (BOX.vertices, BOX.faces),
        SimpleNamespace(vertices=BOX.vertices, triangles=BOX.faces, vertex_colors=()),  # of Open3D
        SimpleNamespace(points=BOX.vertices, faces=COUNTED),  # of pyvista
    ],
)
def test_meshes_of_others_are_scenes_and_parts(mesh) -> None:
    assert LabelledMesh.of(mesh).face_areas().sum() == pytest.approx(BOX.area)
    assert Scene.from_mesh(mesh, mode="object").mesh.faces.tolist() == BOX.faces.tolist()
    if not isinstance(mesh, tuple):
        assert len(completion.model_part(mesh, relations=None).fits) == 6
        plan = plan_views(
            mesh, PinholeSensor(fov_deg=60, width=24, height=24), method="greedy", views=1, rng=0
        )
        assert len(plan.views) == 1


@pytest.mark.parametrize("faces", [np.array([4, 0, 1, 2, 3]), np.array([4, 0, 1, 2, 3, 3, 0, 1])])
def test_other_faces_than_triangles_are_refused(faces) -> None:
    with pytest.raises(InputError, match="other faces than triangles; triangulate it"):
        LabelledMesh.of(SimpleNamespace(points=BOX.vertices, faces=faces))


def test_what_is_no_mesh_is_refused() -> None:
    with pytest.raises(InputError, match="must be of trimesh, Open3D or pyvista"):
        LabelledMesh.of(SimpleNamespace(points=BOX.vertices))


def test_clouds_of_others_are_points() -> None:
    points = np.random.default_rng(0).uniform(0, 1, (200, 3)) * [1, 1, 0]
    for cloud in (SimpleNamespace(points=points), trimesh.PointCloud(points), PointCloud(points)):
        assert completion.fit(cloud, "plane").n == 200


def test_meshes_turn_into_those_of_trimesh() -> None:
    turned = ROOM.to_trimesh()
    assert turned.vertices.tolist() == ROOM.mesh.vertices.tolist()
    assert turned.face_attributes["surface"].tolist() == ROOM.mesh.face_surface.tolist()
    look = 255 * ROOM.mesh.appearance.corner_colour.mean(axis=1)
    assert np.abs(turned.visual.face_colors[:, :3] - look).max() <= 0.5
    part = completion.model_part(BOX, relations=None)
    assert part.to_trimesh().area == pytest.approx(BOX.area)
    with pytest.raises(InputError, match="a part of points has no mesh"):
        completion.model_part(part.points, part.surface, relations=None).to_trimesh()


def test_a_completion_turns_into_what_is_measured_and_what_is_inferred() -> None:
    done = completed("chair_before_wall", pixels=120)
    names = done.to_trimesh().geometry
    assert {name.split()[0] for name in names} == {"observed", "hypothesised"}
    inferred = sum(mesh.area for name, mesh in names.items() if name.startswith("hypothesised"))
    panels = done.panels()
    rest = LabelledMesh(panels.vertices, panels.faces[~panels.is_measured & (panels.face_surface > 0)])
    assert inferred == pytest.approx(rest.face_areas().sum())


def test_scans_and_clouds_turn_into_those_of_open3d(open3d) -> None:
    scan = example("two_occluders", pixels=100)
    cloud = scan.to_open3d()
    assert cloud.points.tolist() == scan.points()[scan.valid].tolist()
    assert 0 <= cloud.colors.min() < cloud.colors.max() <= 1
    colours = np.full((4, 3), 255, np.uint8)
    assert PointCloud(np.eye(4, 3), colour=colours).to_open3d().colors.tolist() == np.ones((4, 3)).tolist()
    assert not hasattr(PointCloud(np.eye(4, 3)).to_open3d(), "normals")
    back = LabelledMesh.of(ROOM.mesh.to_open3d())
    assert back.faces.tolist() == ROOM.mesh.faces.tolist()


def test_results_turn_into_tables(pandas) -> None:
    coverage = covered_by_two()
    assert [row["name"] for row in coverage.to_pandas()] == [row.name for row in coverage.by_surface()]
    assert PointCloud(np.eye(4, 3), label=np.arange(4)).to_pandas().keys() == {"x", "y", "z", "label"}
    check = example_check()
    assert len(CheckedDesign(check).to_pandas()) == 1 + len(check.elements)
    plan = plan_views(ROOM, VIEW.sensor, method="greedy", views=2, rng=0)
    assert plan.to_pandas()[0].startswith("number,x_m,")
    assert len(plan.to_pandas()) == 3
    sheet = completed("chair_before_wall", pixels=120).decisions()
    assert sheet.to_pandas() == sheet.to_csv().splitlines()


@pytest.mark.parametrize("name", ["pandas", "open3d"])
def test_a_library_that_is_not_there_is_named_with_its_cure(monkeypatch, name) -> None:
    monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(InputError, match=rf'{name} is not installed.*pip install "unseen\[{name}\]"'):
        getattr(PointCloud(np.eye(3)), f"to_{name}")()
