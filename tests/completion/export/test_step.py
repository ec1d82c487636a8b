# SPDX-License-Identifier: MIT
"""STEP of exact parts: read back it has their volume, faces and axes; what does not close says why."""

import re

import numpy as np
import pytest

from completion.export.step.faces import area_of, is_valid, volume_of
from completion.export.step.kernel import kernel
from completion.export.step.pipeline import step_of
from completion.export.step.regions import FittedRegion, part_regions
from completion.parts.step_export import outcome_lines
from scenes.checks import InputError
from scenes.surfaces.catalogue import EllipticCylinder, Plane, Sphere
from tests.helpers.step_examples import (
    ball_ended,
    bead,
    box,
    drilled,
    frustum,
    needs_kernel,
    read_back,
    regions,
    rod,
)  # fmt: skip

needs_kernel()

SOLIDS = {
    "box": (box((0.03, 0.02, 0.01)), 0.03 * 0.02 * 0.01),
    "drilled": (drilled((0.03, 0.02, 0.01), 0.006), 0.01 * (0.03 * 0.02 - np.pi * 0.006**2)),
    "rod": (rod(0.01, 0.03), np.pi * 0.01**2 * 0.03),
    "frustum": (frustum(0.01, 0.005, 0.02), np.pi / 3 * 0.02 * (0.01**2 + 0.01 * 0.005 + 0.005**2)),
    "cone with its tip": (frustum(0.01, 0.0, 0.02), np.pi / 3 * 0.02 * 0.01**2),
    "bead": (
        bead(0.01, 0.004, 0.03),
        np.pi * 0.01**2 * 0.03 + np.pi**2 * 0.004**2 * 0.01 + 4 / 3 * np.pi * 0.004**3,
    ),
    "ball end": (ball_ended(0.01, 0.03), np.pi * 0.01**2 * 0.03 + 2 / 3 * np.pi * 0.01**3),
}  # fmt: skip


def surfaces_of(shape):
    """Kind, place and axis of the surface of each face."""
    modules, found = kernel(), []
    walk = modules.TopExp.TopExp_Explorer(shape, modules.TopAbs.TopAbs_ShapeEnum.TopAbs_FACE)
    while walk.More():
        surface = modules.BRep.BRep_Tool.Surface_s(modules.TopoDS.TopoDS.Face(walk.Current()))
        axis = surface.Position().Axis() if hasattr(surface, "Position") else surface.Axis()
        kind = type(surface).__name__
        found.append((kind, np.array(axis.Location().Coord()), np.array(axis.Direction().Coord())))
        walk.Next()
    return found


@pytest.mark.parametrize("name", SOLIDS)
def test_a_closed_part_is_a_valid_solid_of_its_volume_when_read_back(name, tmp_path):
    faces, volume = SOLIDS[name]
    model = step_of(regions(faces), "part")
    assert model.is_solid, model.reason
    assert model.is_valid
    assert model.n_solids == 1
    assert model.volume_m3 == pytest.approx(volume, rel=1e-6)
    shape = read_back(model.data, tmp_path)
    assert is_valid(shape)
    assert volume_of(shape) == pytest.approx(1e9 * volume, rel=1e-6)
    assert len(surfaces_of(shape)) == len(faces)


def test_axes_stay_coaxial_and_planes_parallel_to_rounding(tmp_path):
    shape = read_back(step_of(regions(SOLIDS["bead"][0])).data, tmp_path)
    for _, place, axis in surfaces_of(shape):
        assert np.linalg.norm(np.cross(axis, (0, 0, 1))) < 1e-9
        if np.hypot(*place[:2]) > 0:
            assert np.hypot(*place[:2]) < 1e-9
    shape = read_back(step_of(regions(SOLIDS["box"][0])).data, tmp_path)
    for kind, place, axis in surfaces_of(shape):
        assert kind == "Geom_Plane"
        assert np.abs(axis).max() > 1 - 1e-12
        assert np.abs(np.abs(place @ axis) - np.array([15, 10, 5])).min() < 1e-9


def test_a_tilted_part_is_the_same_solid(tmp_path):
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    faces = []
    for surface, points in SOLIDS["drilled"][0]:
        if isinstance(surface, Plane):
            moved = Plane(surface.point @ turn.T + 0.1, surface.normal_direction @ turn.T)
        else:
            moved = type(surface)(surface.point @ turn.T + 0.1, surface.direction @ turn.T, surface.radius)
        faces.append((moved, points @ turn.T + 0.1))
    model = step_of(regions(faces))
    assert model.is_solid
    assert model.volume_m3 == pytest.approx(SOLIDS["drilled"][1], rel=1e-6)


def test_a_closed_surface_alone_is_a_solid():
    rng = np.random.default_rng(0)
    points = rng.normal(size=(2000, 3))
    points *= 0.01 / np.linalg.norm(points, axis=1, keepdims=True)
    model = step_of(regions([(Sphere((0, 0, 0), 0.01), points)]))
    assert model.is_solid
    assert model.volume_m3 == pytest.approx(4 / 3 * np.pi * 0.01**3, rel=1e-6)


def test_what_was_not_measured_is_not_closed_and_says_why(tmp_path):
    model = step_of(regions(box((0.03, 0.02, 0.01))[:-1]))
    assert not model.is_solid
    assert model.n_solids == 0
    record = model.record()
    assert record["solid"] is False
    assert record["volume_m3"] is None
    told, places = record["reason"].split(": ")
    assert told == "surfaces 1, 2, 3, 4 end where the measurement does, without a neighbour"
    assert re.match(r"1 at \(-15, -?10, 4\.\d+\) mm, 2 at ", places)
    assert record["open_faces"] == [1, 2, 3, 4]
    assert b"open end" in model.data
    assert b"MANIFOLD_SOLID_BREP" not in model.data
    shape = read_back(model.data, tmp_path)
    assert is_valid(shape)
    sides = 2 * (0.03 + 0.02) * 0.01 + 0.03 * 0.02
    assert 0.85 * sides < 1e-6 * area_of(shape) <= sides * (1 + 1e-9)


def test_a_tube_without_a_base_ends_in_a_circle():
    model = step_of(regions(rod(0.01, 0.03)[:2]))
    assert not model.is_solid
    assert model.record()["open_faces"] == [1]
    assert 1e-6 * area_of(model.shape) == pytest.approx(2 * np.pi * 0.01 * 0.03 + np.pi * 0.01**2, rel=0.03)


def test_a_frustum_without_its_top_does_not_get_a_tip():
    faces = frustum(0.01, 0.005, 0.02)
    low = next(one for one in faces if one[0].kind == "plane" and one[0].point[2] < 0)
    model = step_of(regions([faces[0], low]))
    assert not model.is_solid
    slant = np.hypot(0.02, 0.005)
    true = np.pi * (0.01 + 0.005) * slant + np.pi * 0.01**2
    assert 1e-6 * area_of(model.shape) == pytest.approx(true, rel=0.03)


def test_a_region_too_small_to_be_trimmed_is_left_out_and_told():
    faces = box((0.03, 0.02, 0.01))
    top, points = faces[-1]
    odd = np.hypot(points[:, 0] - 0.0155, points[:, 1] - 0.0005) < 0.0015
    speck = (Plane((0.0155, 0, 0.005), (0.3, 0.2, 1.0)), points[odd])
    model = step_of(regions([*faces[:-1], (top, points[~odd]), speck]))
    assert model.is_solid
    assert model.volume_m3 == pytest.approx(6e-6, rel=1e-6)
    (left,) = model.record()["without_face"]
    assert left["surface"] == 7
    assert "its neighbours were extended across it" in left["reason"]
    assert b"extended across surface 7" in model.data
    first, second = outcome_lines(model)
    assert first == "step       6 faces of 7 surfaces, 1 solid, 6 cm3"
    assert second.strip().startswith("surface 7 (plane) is too small to be trimmed")


def test_people_read_why_a_part_is_open():
    first, second = outcome_lines(step_of(regions(rod(0.01, 0.03)[:2])))
    assert first == "step       2 faces of 2 surfaces, open"
    assert second.strip().startswith("surface 1 ends where the measurement does, without a neighbour: 1 at (")


def test_the_same_part_gives_the_same_bytes_without_date_or_user():
    one, two = (step_of(regions(SOLIDS["bead"][0]), "part").data for _ in range(2))
    assert one == two
    header = one.decode()[: one.index(b"ENDSEC")]
    assert "FILE_NAME('part','',(''),(''),'unseen','unseen','')" in header.replace("\n", "")
    assert not re.search(r"20\d\d-\d\d-\d\d", one.decode())


def test_the_file_is_in_millimetres_and_names_its_faces():
    text = step_of(regions(SOLIDS["rod"][0]), "rod").data.decode()
    assert "SI_UNIT(.MILLI.,.METRE.)" in text
    assert "PRODUCT('rod'" in text
    assert re.search(r"ADVANCED_FACE\('surface 1 cylinder, 100 % measured, sd 10 um'", text)
    assert "MANIFOLD_SOLID_BREP" in text
    assert "PRESENTATION_LAYER_ASSIGNMENT('MEASURED'" in text.replace("\n", "")


def test_neighbours_on_one_surface_are_one_face():
    faces = box((0.03, 0.02, 0.01))
    top, points = faces[-1]
    left = points[:, 0] < 0.002
    model = step_of(regions([*faces[:-1], (top, points[left]), (top, points[~left])]))
    assert model.is_solid
    assert len(model.faces) == 6


def test_a_cavity_is_taken_from_its_solid():
    model = step_of(regions([*box((0.03, 0.03, 0.03)), *box((0.01, 0.01, 0.01))]))
    assert model.n_solids == 1
    assert model.volume_m3 == pytest.approx(0.03**3 - 0.01**3, rel=1e-6)


def test_noise_leaves_a_solid_and_its_gap_is_told():
    rng = np.random.default_rng(0)
    faces = [(s, p + rng.normal(0, 2e-5, p.shape)) for s, p in SOLIDS["ball end"][0]]
    cap = faces[-1][0]
    faces[-1] = (Sphere(cap.centre + 1e-5, cap.radius - 2e-5), faces[-1][1])
    model = step_of(regions(faces, noise=2e-5))
    assert model.is_solid, model.reason
    assert model.is_valid
    assert 1e-6 < model.gap_m < 5e-5


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"regions": []}, "no surface to export"),
        ({"points": np.zeros((4, 2))}, r"points \(n, 3\)"),
        ({"points": np.full((4, 3), np.nan)}, "4 of 4 points on surfaces are not finite"),
        ({"region": [0, 0, 0, 1]}, "of region 1, but there are 1"),
        ({"spacing_m": 0.0}, "positive number of metres"),
        ({"spacing_m": np.nan}, "positive number of metres"),
        ({"regions": [FittedRegion(1, EllipticCylinder((0, 0, 0), (0, 0, 1), (2.0, 1.0)))]}, "has not"),
    ],
)
def test_unusable_input_is_refused_in_one_line(change, message):
    given = {
        "regions": [FittedRegion(1, Plane((0, 0, 0), (0, 0, 1)))],
        "points": np.zeros((4, 3)), "region": [0, 0, 0, 0], "spacing_m": 1e-3, **change,
    }  # fmt: skip
    with pytest.raises(InputError, match=message) as told:
        part_regions(given["regions"], given["points"], given["region"], spacing_m=given["spacing_m"])
    assert "\n" not in str(told.value)


def test_a_plane_alone_cannot_be_trimmed():
    with pytest.raises(InputError, match=r"no surface could be trimmed.*no fold with a neighbour bounds it"):
        step_of(regions(box((0.03, 0.02, 0.01))[:1]))


def test_a_shape_with_faults_is_no_solid_and_says_so(monkeypatch):
    monkeypatch.setattr("completion.export.step.sewing.is_valid", lambda _shape: False)
    model = step_of(regions(SOLIDS["rod"][0]))
    assert not model.is_solid
    assert model.reason == "the geometry kernel finds faults in the shape"


def test_what_the_kernel_raises_is_a_reason(monkeypatch):
    def fails(*_given):
        raise kernel().Standard.Standard_ConstructionError("no such curve")

    monkeypatch.setattr("completion.export.step.faces.trimmed_face", fails)
    with pytest.raises(InputError, match=r"no surface could be trimmed.*the kernel could not trim it"):
        step_of(regions(SOLIDS["rod"][0]))
    monkeypatch.undo()
    monkeypatch.setattr("completion.export.step.pipeline.sewn", fails)
    with pytest.raises(InputError, match="could not sew the part: no such curve"):
        step_of(regions(SOLIDS["rod"][0]))
