# SPDX-License-Identifier: MIT
"""A small part: a plate with holes, one of them beside its place; designs in other units; sheets."""

from dataclasses import replace

import numpy as np
import pytest

from completion.asbuilt.findings import DesignCheck
from completion.asbuilt.pipeline import CheckOptions, check_against_design
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor, View
from scenes.checks import InputError
from scenes.mesh.design import Element, ElementMesh
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.pose import Pose
from scenes.scan.range_image import RangeImage
from scenes.world.scene import Scene

HOLES = np.array([[-0.06, 0.0], [0.0, 0.005], [0.065, -0.01]])
NOISE_M, TOLERANCE_M = 2e-5, 1e-4
SENSOR = PinholeSensor(fov_deg=26.0, width=300, height=200, min_range_m=0.05, max_range_m=5.0)


def plate(holes: np.ndarray) -> LabelledMesh:
    """A plate of 0.195 x 0.065 x 0.01 m with holes of 12 mm radius at places (3, 2), closed."""
    turn = np.arange(33) * np.pi / 16
    ring = np.column_stack([np.cos(turn), np.sin(turn)])
    square = 0.0325 * ring / np.abs(ring).max(axis=1, keepdims=True)
    inner = holes[:, None] + 0.012 * ring
    outer = np.array([[-0.065, 0.0], [0.0, 0.0], [0.065, 0.0]])[:, None] + square
    a, b, c, d = inner[:, :-1], outer[:, :-1], outer[:, 1:], inner[:, 1:]
    flat = np.concatenate([np.stack([a, b, c], axis=2), np.stack([a, c, d], axis=2)]).reshape(-1, 3, 2)
    top = np.concatenate([flat, np.full((len(flat), 3, 1), 0.01)], axis=2)
    sides = np.concatenate([top[:, [k, (k + 1) % 3]] for k in range(3)])
    known = {tuple(np.round(side[::-1], 7).ravel()) for side in sides}
    rims = np.array([side for side in sides if tuple(np.round(side, 7).ravel()) not in known])
    low = rims * [1.0, 1.0, 0.0]
    walls = [
        np.stack([low[:, 0], low[:, 1], rims[:, 1]], axis=1),
        np.stack([low[:, 0], rims[:, 1], rims[:, 0]], axis=1),
    ]
    every = np.concatenate([top, top[:, ::-1] * [1.0, 1.0, 0.0], *walls])
    faces = np.arange(3 * len(every), dtype=np.int32).reshape(-1, 3)
    return LabelledMesh(every.reshape(-1, 3), faces, np.zeros(len(faces), np.int32))


def scans_of(mesh: LabelledMesh, noise_m: float = NOISE_M) -> list[RangeImage]:
    rng, scene = np.random.default_rng(3), Scene(mesh, (None,), ("plate",), "plate")
    scans = []
    for k, way in enumerate([(0.5, 0.6, 0.8), (-0.6, 0.5, 0.8), (0.1, -0.7, 0.7), (0.3, 0.4, -0.9)]):
        pose = Pose.looking_at(0.5 * np.array(way) / np.linalg.norm(way), np.zeros(3))
        scan = scan_scene(scene, View(pose, SENSOR), noise="none", truth=False)
        noisy = scan.ranges + noise_m * rng.normal(size=scan.shape)
        scans.append(replace(scan, ranges=noisy, sigma_m=noise_m, name=f"side {k}"))
    return scans


def design_of(mesh: LabelledMesh) -> ElementMesh:
    return ElementMesh(mesh, (Element("plate"),), "plate")


@pytest.fixture(scope="module")
def checked() -> DesignCheck:
    """The plate whose middle hole was drilled 0.3 mm aside."""
    drilled = HOLES + [[0.0, 0.0], [3e-4, 0.0], [0.0, 0.0]]
    return check_against_design(
        design_of(plate(HOLES)),
        scans_of(plate(drilled)),
        CheckOptions(tolerance_m=TOLERANCE_M, registration=(1e-5, 1e-3)),
    )


def test_faces_of_a_part_are_its_elements(checked):
    names = [one.element.name for one in checked.elements]
    assert [name for name in names if name.startswith("hole")] == [
        f"hole {k}, radius 12.00 mm" for k in (1, 2, 3)
    ]
    assert sum(name.startswith("face") for name in names) == 6


def test_a_hole_beside_its_place_is_found_and_nothing_else(checked):
    (off,) = [one for one in checked.elements if one.verdict not in ("within", "undecided", "not seen")]
    assert (off.verdict, off.kind) == ("deviates", "offset")
    (face,) = off.faces
    assert np.abs(face.centre[:2] - HOLES[1]).max() < 1e-4
    along = np.array(off.offset.along)
    assert off.offset.low <= along @ [3e-4, 0.0, 0.0] <= off.offset.high
    assert off.offset.high - off.offset.low < TOLERANCE_M
    assert "beyond 0.100 mm" in off.sentence


def test_intervals_of_what_is_in_place_hold_zero(checked):
    held = [
        one.offset.low <= 0 <= one.offset.high
        for one in checked.elements
        if one.element.name != "hole 2, radius 12.00 mm" and one.offset is not None
    ]
    assert len(held) >= 7
    assert all(held)


def test_a_design_in_another_unit_is_refused():
    mesh = plate(HOLES)
    with pytest.raises(InputError, match="100% with --design-units cm; give that"):
        check_against_design(design_of(mesh.at(100 * mesh.vertices)), scans_of(mesh))


def test_beams_too_noisy_for_a_part_are_told():
    mesh = plate(HOLES)
    check = check_against_design(design_of(mesh), scans_of(mesh, 3e-3))
    assert any("of the beams were left out: their noise is beyond" in one for one in check.warnings)
    assert {one.verdict for one in check.elements} == {"undecided"}
    assert all(one.sentence.startswith("too noisy: sigma 3.0 mm at 0.") for one in check.elements)
    assert all(one.share.measured == 0 for one in check.elements)
