# SPDX-License-Identifier: MIT
"""Misfits: scans off by a shift, a turn or a unit are left out or refused, and the shift is named."""

from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from completion.asbuilt.misfits import agreeing, without_misfits
from completion.asbuilt.pipeline import CheckOptions, check_against_design
from scenes.checks import InputError
from scenes.mesh.design import Element, ElementMesh
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.pose import Pose
from scenes.rays.raycast import RayCaster
from scenes.scan.projection import SphericalProjection
from scenes.scan.range_image import RangeImage

SIDES = ["west", "east", "south", "north", "floor", "ceiling"]
EYES = ((1.2, 1.0, 1.5), (3.5, 2.8, 1.4), (2.0, 3.1, 1.2))
FAR = np.array([512300.0, 5403200.0, 410.0])


def room(size=(5.0, 4.0, 2.6), shift=(0.0, 0.0, 0.0)) -> LabelledMesh:
    """Six sides of a room, an element each, seen from within."""
    unit = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    quads = ((0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5))
    faces = [(q[0], q[k], q[k + 1]) for q in quads for k in (1, 2)]
    return LabelledMesh(unit * size + shift, np.array(faces), np.repeat(np.arange(6, dtype=np.int32), 2))


@cache
def surveyed(n=3):
    """Scans of the room at their places."""
    mesh, rng = room(), np.random.default_rng(3)
    caster, projection = (
        RayCaster(mesh.vertices, mesh.faces),
        SphericalProjection.regular(120, 60, 360, (-75, 75)),
    )
    scans = []
    for k, eye in enumerate(EYES[:n], start=1):
        pose = Pose.looking_at(eye, np.add(eye, (1, 0.3 * k, 0)))
        rays = pose.rotate(projection.directions().reshape(-1, 3))
        ranges = caster.first_hit(np.array(eye)[None], rays).ranges.reshape(projection.shape)
        ranges = ranges + 0.002 * rng.standard_normal(ranges.shape)
        scans.append(RangeImage(ranges, projection, pose, noise="gaussian-2mm", name=f"s{k}"))
    return tuple(scans)


def moved(scan, shift=(0, 0, 0), turn_deg=0.0):
    """The scan with a pose that is off."""
    turn = Rotation.from_euler("z", turn_deg, degrees=True).as_matrix()
    return scan.transform(Pose.from_parts(turn, np.array(shift, float)))


@pytest.mark.parametrize("origin", [np.zeros(3), FAR])
def test_scans_at_their_places_stay(origin):
    scans = [moved(scan, origin) for scan in surveyed()]
    kept, told = without_misfits(room(shift=origin), scans, "room")
    assert [scan.name for scan in kept] == ["s1", "s2", "s3"]
    assert told == ()


@pytest.mark.parametrize("shift", [(1, 0, 0), (0.3, 0, 0), (0, 0, -0.8), (0.3, 0.5, -0.2), (2.2, 1.1, 0.4)])
def test_a_shifted_scan_is_left_out_and_the_shift_that_mends_it_is_named(shift):
    kept, told = without_misfits(room(), [*surveyed()[:2], moved(surveyed()[2], shift)], "room")
    assert [scan.name for scan in kept] == ["s1", "s2"]
    assert told[0].startswith("s3 was left out, since it does not fit the design")
    named = told[0].split("moved by (")[1].split(")")[0]
    assert np.allclose([float(x) for x in named.split(",")], -np.array(shift), atol=0.05)


@pytest.mark.parametrize(("scans", "mesh", "cause"), [
    ("all", room(shift=(1.5, 0.6, 0)), r"100% if it is moved by \(1\.5\d?, 0\.\d+, -?0\.0\d\) m.*--register"),
    ("all", room(shift=(700, 0, 0)), r"it lies about \(702\.50.* m apart"),
    ("all", room((5000, 4000, 2600)), "100% with --design-units mm"),
    ("all", room(np.array((5, 4, 2.6)) / 0.3048), "100% with --design-units ft"),
    ("all", room((0.005, 0.004, 0.0026)), "it spans 0.00691 m, what they measured"),
    ("none", room(), "no beam of empty has a return"),
])  # fmt: skip
def test_scans_of_another_place_are_refused_with_the_cause_in_numbers(scans, mesh, cause):
    first = surveyed()[0]
    empty = RangeImage(np.full(first.shape, np.inf), first.projection, first.world_from_sensor, name="empty")
    with pytest.raises(InputError, match=cause) as refused:
        without_misfits(mesh, surveyed() if scans == "all" else [empty], "room")
    assert "\n" not in str(refused.value)


def test_a_wall_that_moved_is_no_shift_of_the_scans():
    corners = room().vertices.copy()
    corners[corners[:, 0] == 5.0, 0] = 5.6  # all scans say so of one element
    kept, told = without_misfits(room().at(corners), surveyed(), "room")
    assert len(kept) == 3
    assert told == ()


def test_what_is_not_built_is_no_misfit_of_scans():
    design = room((5.0, 4.0, 2.6))
    inner = room((0.1, 3.0, 2.0), (2.7, 0.5, 0.0))  # a body between the scanners that is not there
    both = LabelledMesh(
        np.vstack([design.vertices, inner.vertices]),
        np.vstack([design.faces, inner.faces[:, ::-1] + 8]),
        np.concatenate([design.face_surface, np.full(12, 6, np.int32)]),
    )
    kept, _ = without_misfits(both, surveyed(), "room")
    assert len(kept) == 3


def test_a_scan_that_looks_elsewhere_stays_and_is_told():
    away = moved(surveyed()[2], (4000, 0, 0))
    kept, told = without_misfits(room(), [*surveyed()[:2], away], "room")
    assert len(kept) == 3
    assert "s3 tells next to nothing" in told[0]


def test_a_scan_turned_by_a_degree_has_no_say_in_verdicts():
    design = ElementMesh(room(), tuple(Element(name) for name in SIDES), "room")
    scans = [*surveyed()[:2], moved(surveyed()[2], turn_deg=1.5)]
    found = check_against_design(design, scans, CheckOptions(tolerance_m=0.02))
    assert found.scans == ("s1", "s2")
    assert "s3 was left out" in " ".join(found.warnings)
    assert not {one.verdict for one in found.elements} & {"missing", "deviates"}


def test_the_share_of_beams_on_a_design():
    assert agreeing(room(), surveyed()) > 0.99
    assert agreeing(room(shift=(0, 0, 0.5)), surveyed()) < 0.8


def test_a_tolerance_of_no_element_is_refused():
    design = ElementMesh(room(), tuple(Element(name) for name in SIDES), "room")
    with pytest.raises(InputError, match=r"no element of room is like 'dor\*'"):
        check_against_design(design, surveyed(), CheckOptions(tolerances={"dor*": 0.005}))
