# SPDX-License-Identifier: MIT
"""Applied features: equal holes behind what hides them, pipes that end at their elbow, files checked."""

import json
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.cases.plates import SIZE, mesh
from completion import CompletionOptions, complete
from completion.extension.patch import Provenance
from completion.features.engine.options import FeatureOptions
from completion.features.engine.template import Features, FeatureSide, FeatureStatus, TemplateFit
from completion.features.stated import read_features
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor
from scenes import InputError, Pose
from scenes.world.scene import Scene
from tests.pipes import tube

MM = 1e-3
CAMERA = PinholeSensor(fov_deg=40.0, width=320, height=320, min_range_m=0.05)
RADIUS, PITCH = 8.0, 30.0  # mm


def box(low, high):
    """Corners (8, 3) and triangles (12, 3) of a box."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * np.subtract(high, low)
    faces = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
             [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]  # fmt: skip
    return corners + low, np.array(faces)


def together(*meshes):
    first = np.cumsum([0, *(len(corners) for corners, _ in meshes)])
    faces = [faces + start for (_, faces), start in zip(meshes, first, strict=False)]
    return np.concatenate([corners for corners, _ in meshes]), np.concatenate(faces)


def found_fit(kind, geometry, sides=()):
    return TemplateFit(
        kind=kind, status=FeatureStatus.FOUND, names=(), x=np.zeros(0), covariance=np.zeros((0, 0)),
        sides=sides, evidence=50.0, faces=(), assignment=np.zeros(0, np.int64), geometry=geometry,
    )  # fmt: skip


def stated(tmp_path, *fits):
    """Options with features that were written to a file and read again."""
    path = tmp_path / "features.json"
    path.write_text(json.dumps(Features(tuple(fits), 0).record()))
    return CompletionOptions(texture=False, features=FeatureOptions(stated=tuple(read_features(path))))


@pytest.fixture(scope="module")
def plate():
    """A plate with a row of three holes, half of the middle one behind a block; and the row."""
    middle = np.array(SIZE) / 2
    flat = middle + np.array([[-PITCH, 0], [0, 0], [PITCH, 0]])
    block = box((middle[0], middle[1] - 14, 25), (middle[0] + 14, middle[1] + 14, 30))
    corners, faces = together(mesh(flat, RADIUS), block)
    scene = Scene.from_mesh((corners * MM, faces), mode="object")
    eye = Pose.looking_at(np.array([*middle, 320.0]) * MM, np.array([*middle, 0.0]) * MM, up=(0, 1, 0))
    scan = scan_scene(scene, eye, CAMERA, noise="gaussian-0.1mm", rng=0)
    centres = np.column_stack([flat, np.zeros(3)]) * MM
    sides = tuple(FeatureSide(f"hole {k}", 20, 0, 36, 1e-4) for k in (1, 2, 3))
    return scan, found_fit("hole-row", {"centres": centres, "radius": RADIUS * MM, "axis": (0, 0, 1)}, sides)


def inferred_near(done, centre, reach):
    """Places (n, 3), world, of what was inferred within a reach of a centre."""
    places = [
        done.world_from_reference.apply(patch.grid.centres()[patch.hypothesised.ravel()])
        for patch in done.patches
    ]
    every = np.concatenate(places)
    return every[np.linalg.norm(every - centre, axis=1) < reach]


def test_a_half_hidden_hole_is_as_round_as_the_others_of_its_row(plate, tmp_path):
    scan, row = plate
    centre = row.geometry["centres"][1]
    without = complete(scan, CompletionOptions(texture=False, features=None), rng=0)
    whole = complete(scan, stated(tmp_path, row), rng=0)
    assert len(inferred_near(without, centre, 0.8 * RADIUS * MM)) > 0
    outlines = np.concatenate([mesh.vertices for mesh in whole.inferred])
    away = np.linalg.norm(whole.world_from_reference.apply(outlines) - centre, axis=1)
    assert away.min() == pytest.approx(RADIUS * MM, rel=0.01)
    assert len(inferred_near(whole, centre, 1.4 * RADIUS * MM)) > 50
    openings = [opening for surface in whole.surfaces for opening in surface.openings if opening.feature]
    assert [opening.area_m2 for opening in openings] == pytest.approx(
        [np.pi * (RADIUS * MM) ** 2] * 3, rel=0.01
    )


def test_holes_that_nobody_saw_change_nothing(plate, tmp_path):
    scan, row = plate
    unseen = replace(row, sides=tuple(FeatureSide(side.name, 0, 0, 36, np.inf) for side in row.sides))
    without = complete(scan, CompletionOptions(texture=False, features=None), rng=0)
    same = complete(scan, stated(tmp_path, unseen), rng=0)
    assert same.hypothesised_m2 == without.hypothesised_m2


@pytest.fixture(scope="module")
def pipe():
    """A pipe that turns by a right angle, a post before the end of its first leg; and the elbow."""
    radius, bend = 0.05, 0.15
    turn = np.linspace(0, np.pi / 2, 25)
    arc = np.column_stack([bend * np.sin(turn), np.zeros(25), bend * (1 - np.cos(turn))])
    path = np.concatenate([[[-0.8, 0, 0]], arc, [[bend, 0, bend + 0.7]]])
    corners, faces = together(tube(path, radius), box((-0.25, -0.5, -0.3), (0.02, -0.45, 0.3)))
    scene = Scene.from_mesh((corners, faces), mode="object")
    eye = Pose.looking_at((-0.1, -1.6, 0.5), (-0.1, 0, 0.2))
    scan = scan_scene(scene, eye, replace(CAMERA, fov_deg=60.0), noise="gaussian-1mm", rng=0)
    ends = np.array([[0.0, 0, 0], [bend, 0, bend]])
    geometry = {"joint": ends, "axis": (0, -1, 0), "centres": [[0, 0, bend]], "radii": [bend, radius]}
    return scan, found_fit("elbow", geometry)


def test_pipes_go_on_to_their_elbow_and_end_there(pipe, tmp_path):
    scan, elbow = pipe
    done = complete(scan, stated(tmp_path, elbow), rng=0)
    along = [
        patch
        for patch in done.patches
        if patch.grid.surface.kind == "cylinder"
        and abs(done.world_from_reference.rotate(patch.grid.surface.direction[None])[0, 0]) > 0.99
    ]
    ended = [patch for patch in along if patch.verdict.joints]
    assert ended
    for patch in ended:
        places = done.world_from_reference.apply(patch.grid.centres()[patch.hypothesised.ravel()])
        cell = float(patch.grid.cell.max())
        assert places[:, 0].max() < cell
        assert places[:, 0].max() > -0.05
        beyond = patch.provenance == Provenance.FEATURE
        assert beyond.any()


def test_features_of_other_scans_are_refused(plate, pipe, tmp_path):
    with pytest.raises(InputError, match="joins no surfaces"):
        complete(plate[0], stated(tmp_path, pipe[1]))
    far = replace(plate[1], geometry={**plate[1].geometry, "centres": plate[1].geometry["centres"] + 1.0})
    with pytest.raises(InputError, match="pattern of holes 1 of the features lies in no plane"):
        complete(plate[0], stated(tmp_path, far))


@pytest.mark.parametrize(
    ("kind", "name", "value", "message"),
    [
        ("hole-row", "centres", [[0, 0]], "centres"),
        ("hole-row", "radius", 0.0, "radius above 0"),
        ("hole-row", "sides", {}, "a side for each of its 3 holes"),
        ("hole-row", "radius", float("nan"), "it holds NaN"),
        ("hole-row", "centres", "middle", "expected coordinates"),
        ("hole-row", "centres", [[1e300, 0, 0]], "stay within"),
        ("hole-row", "axis", [0, 0, 0], "axis has length"),
        ("hole-row", "axis", {}, "expected coordinates"),
        ("elbow", "joint", [[0, 0, 0]], "joint must be two places"),
        ("elbow", "joint", [[1, 0, 0], [1, 0, 0]], "joint must be two places"),
        ("elbow", "radii", [1.0], "radii must be"),
        ("elbow", "centres", None, "centres"),
        ("elbow", "centres", [], "centres"),
        ("elbow", "centres", [[0, 0, 0]], "off its joint"),
    ],
)
def test_files_that_lack_something_are_refused(plate, pipe, tmp_path, kind, name, value, message):
    record = Features((plate[1] if kind == "hole-row" else pipe[1],), 0).record()
    record["features"][0][name] = value
    path = tmp_path / "features.json"
    path.write_text(json.dumps(record))
    with pytest.raises(InputError, match=message):
        read_features(path)
