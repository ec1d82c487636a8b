# SPDX-License-Identifier: MIT
"""Topics of a check: which there are, who they are, and where they are seen from."""

import zipfile
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

from nbv.inspection.bcf_topics import write_bcf
from scenes.mesh.design import Element, MapConversion
from tests.nbv.inspection.checks import example_check


def topics_of(path, check, **kwargs):
    """Markup and view of each topic, in order."""
    write_bcf(path, check, **kwargs)
    with zipfile.ZipFile(path) as archive:
        names = [name.rsplit("/", 1)[0] for name in archive.namelist() if name.endswith("markup.bcf")]
        return [
            [
                ElementTree.fromstring(archive.read(f"{name}/{file}"))
                for file in ("markup.bcf", "viewpoint.bcfv")
            ]
            for name in names
        ]


def vector(view, name):
    return np.array([float(view.findtext(f".//Camera{name}/{axis}")) for axis in "XYZ"])


def guids(topics):
    return [markup.find("Topic").get("Guid") for markup, _ in topics]


def test_what_deviates_is_missing_or_is_extra_is_a_topic(tmp_path):
    topics = topics_of(tmp_path / "a.bcf", example_check())
    titles = [markup.findtext(".//Title") for markup, _ in topics]
    assert titles == [
        "IfcWall wall south deviates", "IfcDoor door is missing",
        "extra-1 is in no element of the design, near floor",
    ]  # fmt: skip  # extra-2 is told of the door
    described = [markup.findtext(".//Description") for markup, _ in topics]
    assert "IfcWall wall south deviates: 19.9 mm behind its place (18.6 to 21.2 mm). Tol" in described[0]
    assert "Offset -19.9 mm (95 %: -21.2 to -18.6 mm)" in described[0]
    assert "(see extra-2)" in described[1]
    assert "It hides wall east." in described[2]
    assert [markup.findtext(".//Priority") for markup, _ in topics] == ["Normal", "High", "Normal"]
    assert [one.text for one in topics[0][0].findall(".//Label")] == ["Ground", "IfcWall", "offset"]
    chosen = [view.find(".//Selection/Component").get("IfcGuid") for _, view in topics]
    assert chosen == [f"{k:022d}" for k in (1, 4, 0)]


def test_cameras_are_at_a_station_before_the_measured_side(tmp_path):
    check = example_check()
    stations = [pose.translation for pose in check.alignment.poses]
    for _, view in topics_of(tmp_path / "a.bcf", check):
        place, sight, up = (vector(view, name) for name in ("ViewPoint", "Direction", "UpVector"))
        assert min(np.linalg.norm(place - one) for one in stations) < 1e-5
        assert [np.linalg.norm(sight), np.linalg.norm(up), sight @ up] == pytest.approx([1, 1, 0], abs=1e-5)
        assert up[2] > 0
    _, wall = topics_of(tmp_path / "a.bcf", check)[0]
    towards = np.array([2.0, -0.1, 1.25]) - vector(wall, "ViewPoint")
    assert vector(wall, "Direction") == pytest.approx(towards / np.linalg.norm(towards), abs=1e-5)
    behind = replace(check.elements[1], directions_measured=((0.0, -1.0, 0.0),))
    _, wall = topics_of(tmp_path / "a.bcf", replace(check, elements=(behind,), extra=()))[0]
    assert vector(wall, "ViewPoint")[1] < -0.2  # no station is there: as far off as the view asks for


def test_topics_are_known_by_global_id_and_verdict(tmp_path):
    check = example_check()
    one, two = (topics_of(tmp_path / name, check, version=v) for name, v in (("a", "2.1"), ("b", "3.0")))
    assert guids(one) == guids(two)
    other = replace(check.elements[1], verdict="missing", sentence="")
    again = topics_of(tmp_path / "c", replace(check, elements=(check.elements[4], other)))
    assert guids(again)[0] == guids(one)[1]
    assert guids(again)[1] != guids(one)[0]
    twins = tuple(
        replace(check.elements[k], verdict="missing", element=Element("w", "IfcWall", "0" * 22))
        for k in (1, 2)
    )
    assert len(set(guids(topics_of(tmp_path / "d", replace(check, elements=twins, extra=()))))) == 2


def test_files_are_the_same_and_pictures_are_in_them(tmp_path):
    check = example_check()
    for name in "ab":
        write_bcf(tmp_path / name, check, snapshots={1: b"wall", "extra-1": b"crate"})
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
    with zipfile.ZipFile(tmp_path / "a") as archive:
        pictures = [archive.read(name) for name in archive.namelist() if name.endswith("snapshot.png")]
    assert pictures == [b"wall", b"crate"]


def test_cameras_are_in_the_frame_of_the_file(tmp_path):
    conversion = MapConversion("EPSG:25832", (500000.125, 5600000.25, 100.5), 60.0, (0.9996, 0.9996, 1.0))
    check = example_check()
    poses = tuple(
        type(pose).from_parts(pose.rotation, conversion.apply(pose.translation[None])[0])
        for pose in check.alignment.poses
    )
    mesh = check.design.mesh.at(conversion.apply(check.design.mesh.vertices))
    placed = replace(
        check,
        design=replace(check.design, mesh=mesh),
        alignment=replace(check.alignment, poses=poses),
        elements=check.elements[4:5],
        extra=(),
    )
    ((_, own),) = topics_of(tmp_path / "a", replace(check, elements=check.elements[4:5], extra=()))
    ((_, view),) = topics_of(tmp_path / "b", placed, conversion=conversion)
    assert vector(view, "ViewPoint") == pytest.approx(vector(own, "ViewPoint"), abs=1e-5)
    assert np.allclose(conversion.undo(conversion.apply(mesh.vertices)), mesh.vertices, rtol=0, atol=1e-6)
