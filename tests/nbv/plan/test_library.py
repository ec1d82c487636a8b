# SPDX-License-Identifier: MIT
"""The library from its documentation alone: meshes in memory, and arguments of the wrong kind."""

import importlib

import numpy as np
import pytest
import trimesh

from completion import complete
from nbv import PinholeSensor, plan_views
from scenes import LabelledMesh, Scene
from scenes.checks import InputError

SENSOR = PinholeSensor(fov_deg=60, width=40, height=40)
QUICK = {"method": "greedy", "views": 2, "rng": 0}


@pytest.fixture(scope="module")
def thing():
    return trimesh.creation.box((0.4, 0.3, 0.2))


@pytest.mark.parametrize("kind", ["trimesh", "arrays", "labelled"])
def test_a_scene_is_made_of_a_mesh_in_memory(thing, kind):
    given = {
        "trimesh": thing,
        "arrays": (thing.vertices, thing.faces),
        "labelled": LabelledMesh(thing.vertices, thing.faces, np.arange(12) // 6),
    }[kind]
    scene = Scene.from_mesh(given, name="crate")
    assert (scene.mode, len(scene.mesh.faces)) == ("object", 12)
    assert scene.surface_names == (("crate 0", "crate 1") if kind == "labelled" else ("crate",))
    assert repr(scene).startswith("Scene('crate', object, 12 faces")
    assert Scene.from_mesh(given, mode="room").mode == "room"


def test_a_plan_takes_a_path_or_a_mesh(thing, tmp_path):
    thing.export(tmp_path / "crate.ply")
    plans = [plan_views(given, SENSOR, **QUICK) for given in (thing, tmp_path / "crate.ply")]
    assert [len(plan.views) for plan in plans] == [2, 2]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"scene": 3}, r"a mesh must be of trimesh, Open3D or pyvista, a LabelledMesh or .*, got int"),
        ({"candidates": np.zeros((3, 3))}, r"candidates must be Candidates, got an array of shape \(3, 3\)"),
        ({"samples": np.zeros((3, 3))}, r"samples must be SurfaceSamples, got an array of shape \(3, 3\)"),
        ({"rng": 1.5}, "rng must be a whole number from 0, a numpy Generator or None, got 1.5"),
        ({"rng": -1}, "rng must be a whole number from 0"),
    ],
)
def test_arguments_of_the_wrong_kind_are_refused_with_the_cure(thing, change, message):
    asked = {"scene": Scene.from_mesh(thing), **QUICK, **change}
    with pytest.raises(InputError, match=message):
        plan_views(asked.pop("scene"), SENSOR, **asked)


def test_points_are_no_scan():
    with pytest.raises(
        InputError, match=r"a scan must be RangeImage, got an array of shape \(3,\); read_scan"
    ):
        complete(np.zeros((4, 3)))


@pytest.mark.parametrize("package", ["scenes", "texture", "completion", "nbv"])
def test_packages_tell_their_version(package):
    assert importlib.import_module(package).__version__.count(".") == 2
