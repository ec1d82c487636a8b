# SPDX-License-Identifier: MIT
"""Points: every text layout gives the same points, every format reads, and what cannot be read says why."""

import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenes.checks import InputError
from scenes.io.checks.limits import limits
from scenes.io.clouds.ptx import PtxFile
from scenes.io.formats.format import point_suffixes
from scenes.io.meshes.ply_writer import write_mesh_ply
from scenes.io.point_files import PointCloud, read_part_file, read_points
from scenes.io.scan_files import read_scan, write_scan, write_scans
from scenes.pose import Pose
from tests.helpers.data_paths import data_path, requires_data
from tests.helpers.scan_examples import POSE, PROJECTIONS, example_scan

LASER = next(one for one in PROJECTIONS.values() if one.kind == "spherical")
POINTS = np.array([[1.5, -2.0, 3e-3], [0.0, 12.25, -7.0], [4.0, 5.0, 6.5]])
ROWS = ["1.5 -2.0 3e-3", "0 12.25 -7", "4 5 6.5"]
NORMALS = np.array([[0, 0, 1.0], [0.6, 0.8, 0], [-1, 0, 0]])


def read_text(folder: Path, text: "str | bytes", name: str = "cloud.txt", **options: str) -> PointCloud:
    file = folder / name
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_points(file, **options)  # type: ignore[arg-type]


def joined(separator: str, *, end: str = "\n", before: str = "", decimal: str = ".") -> str:
    return before + end.join(row.replace(" ", separator).replace(".", decimal) for row in ROWS) + end


LAYOUTS = {
    "blanks": joined("   "),
    "tabs": joined("\t"),
    "commas": joined(","),
    "commas and blanks": joined(", "),
    "semicolons": joined(";"),
    "trailing commas": joined(",", end=",\n"),
    "windows": joined(" ", end="\r\n"),
    "old mac": joined(" ", end="\r"),
    "no last line end": joined(" ").rstrip(),
    "blank lines": joined(" ", end="\n\n", before="\n\n"),
    "indented": "  " + joined(" ", end="\n  "),
    "comments": "# a cloud\n// of a tool\n% and more\n! too\n" + joined(" ", end=" # why not\n"),
    "title": joined(" ", before="scan of the pump\n"),
    "names": joined(",", before="X,Y,Z\n"),
    "names with units": joined(";", before="X [m];Y [m];Z [m]\n"),
    "names in a comment": joined(" ", before="//X Y Z\n"),
    "quoted": '"x","y","z"\n' + "".join('"' + row.replace(" ", '","') + '"\n' for row in ROWS),
    "count": joined(" ", before="3\n"),
    "count, windows": joined("\t", before="3\r\n", end="\r\n"),
    "decimal commas": joined(";", decimal=","),
    "decimal commas and blanks": joined("  ", decimal=","),
    "byte order mark": "\ufeff" + joined(","),
    "intensity": "".join(f"{row} 0.25\n" for row in ROWS),
    "colours": "".join(f"{row} 10 200 30\n" for row in ROWS),
    "ragged beyond z": "1.5 -2 .003 7 7 7\n0 12.25 -7\n4 5 6.5 1\n",
    "columns by name": "id,z,x,y\n" + "1,.003,1.5,-2\n2,-7,0,12.25\n3,6.5,4,5\n",
    "a text column": "label,x,y,z\nwall,1.5,-2,3e-3\nfloor,0,12.25,-7\nwall,4,5,6.5\n",
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_layout_gives_the_same_points(tmp_path: Path, layout: str) -> None:
    cloud = read_text(tmp_path, LAYOUTS[layout])
    np.testing.assert_array_equal(cloud.points, POINTS)
    assert cloud.normals is None
    assert cloud.warnings == ()
    assert cloud.name == "cloud.txt"


def test_an_empty_field_between_tabs_is_none_and_moves_no_column(tmp_path: Path) -> None:
    text = "x\ty\tz\tintensity\n1\t2\t3\t4\n5\t\t7\t9\n\t6\t7\t8\n4\t5\t6\t\n"
    cloud = read_text(tmp_path, text)
    np.testing.assert_array_equal(cloud.points, [[1, 2, 3], [4, 5, 6]])
    assert "2 of 4 points are not finite" in cloud.warnings[0]
    with pytest.raises(InputError, match="no finite point"):
        read_text(tmp_path, "5\t\t7\t9\n")


@pytest.mark.parametrize(
    "text", ["1.25\t\t2\t3\n-1\t2\t\t3\n5\t6\t7\n", "\t1.25\t2\t3\n\t-1\t2\t3\n\t5\t6\t7\n"]
)
def test_tabs_that_align_or_indent_columns_are_no_fields(tmp_path: Path, text: str) -> None:
    np.testing.assert_array_equal(read_text(tmp_path, text).points, [[1.25, 2, 3], [-1, 2, 3], [5, 6, 7]])


def test_utf_16_of_windows_tools_is_read(tmp_path: Path) -> None:
    np.testing.assert_array_equal(read_text(tmp_path, joined(",").encode("utf-16")).points, POINTS)


@given(
    st.lists(st.tuples(*[st.floats(-1e9, 1e9)] * 3), min_size=1, max_size=20),
    st.sampled_from([" ", "\t", ",", ";", ", ", " ; "]),
    st.sampled_from(["\n", "\r\n"]),
    st.sampled_from(["", "x{0}y{0}z{1}", "# made up{1}", "count"]),
)
@settings(max_examples=60, deadline=None)
def test_numbers_survive_to_the_last_bit(
    tmp_path_factory: pytest.TempPathFactory,
    points: "list[tuple[float, float, float]]",
    separator: str,
    end: str,
    before: str,
) -> None:
    first = f"{len(points)}{end}" if before == "count" else before.format(separator, end)
    text = first + "".join(separator.join(map(repr, row)) + end for row in points)
    np.testing.assert_array_equal(read_text(tmp_path_factory.mktemp("t"), text).points, np.array(points))


@pytest.mark.parametrize("names", ["", "x y z nx ny nz\n", "//X Y Z Normal_X Normal_Y Normal_Z\n"])
def test_normals_by_name_or_because_they_have_length_one(tmp_path: Path, names: str) -> None:
    rows = "".join(" ".join(map(str, row)) + "\n" for row in np.hstack([POINTS, NORMALS]))
    cloud = read_text(tmp_path, names + rows)
    np.testing.assert_array_equal(cloud.points, POINTS)
    assert cloud.normals is not None
    np.testing.assert_array_equal(cloud.normals, NORMALS)


def test_units_scale_lengths_and_not_normals(tmp_path: Path) -> None:
    rows = "".join(" ".join(map(str, row)) + "\n" for row in np.hstack([POINTS, NORMALS]))
    cloud = read_text(tmp_path, rows, units="mm")
    np.testing.assert_allclose(cloud.points, POINTS / 1000, rtol=1e-15)
    assert cloud.normals is not None
    np.testing.assert_array_equal(cloud.normals, NORMALS)


@pytest.mark.parametrize("row", ["nan nan nan", "1 2 nan", "inf 0 0"])
def test_rows_that_are_not_finite_are_left_out_and_counted(tmp_path: Path, row: str) -> None:
    cloud = read_text(tmp_path, f"{ROWS[0]}\n{row}\n{ROWS[1]}\n{ROWS[2]}\n")
    np.testing.assert_array_equal(cloud.points, POINTS)
    assert cloud.warnings == ("1 of 4 points are not finite or lie beyond 1e12 m and were left out",)


def test_an_empty_field_is_a_missing_number_not_a_shift(tmp_path: Path) -> None:
    cloud = read_text(tmp_path, "1,,3\n,5,6\n1.5,-2,3e-3\n", "c.csv")
    np.testing.assert_array_equal(cloud.points, POINTS[:1])
    assert "2 of 3 points" in cloud.warnings[0]


def test_unknown_names_take_the_first_three_columns_and_say_so(tmp_path: Path) -> None:
    cloud = read_text(tmp_path, joined(",", before="left,middle,right\n"))
    np.testing.assert_array_equal(cloud.points, POINTS)
    assert "no columns x, y, z among left, middle, right" in cloud.warnings[0]


REFUSED = {
    "a word": ("1 2 3\n4 oops 6\n", r"cloud\.txt: line 2: 'oops' is no number; correct the line, or mark"),
    "two columns": ("# top\n1 2 3\n\n4 5\n", r"cloud\.txt: line 4 has 2 columns, 3 are needed: '4 5'"),
    "plane of two": ("1 2\n3 4\n", r"line 1 has 2 columns, 3 are needed"),
    "fewer than announced": ("5\n1 2 3\n4 5 6\n", "announces 5 points, 2 follow: is it truncated"),
    "more than announced": ("1\n1 2 3\n4 5 6\n", "announces 1 points, 2 follow"),
    "count alone": ("7\n", "announces 7 points, and none follows"),
    "prose": ("there is\nnothing here\n", "no point in its first 3 lines"),
    "only comments": ("# x y z\n", "no point in its first 2 lines"),
    "nothing finite": ("nan nan nan\n", "holds no finite point"),
    "binary": (b"\x00\x01\x02\x00\x00", "is binary, not text; is its suffix right"),
    "named column missing": ("a,b,x,y,z\n1,2,3\n", "line 2 has 3 columns, its header names 5"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_unusable_text_names_file_line_and_cause(tmp_path: Path, case: str) -> None:
    text, message = REFUSED[case]
    with pytest.raises(InputError, match=message):
        read_text(tmp_path, text)


def test_files_that_are_not_there_empty_or_unknown(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.xyz: no such file or folder"):
        read_points(tmp_path / "none.xyz")
    with pytest.raises(InputError, match="is empty"):
        read_text(tmp_path, "")
    with pytest.raises(InputError, match=r"cannot read points from \.stl; known: \.npz"):
        read_text(tmp_path, "solid", "part.stl")
    with pytest.raises(InputError, match="unknown units 'yd'; known: mm, cm, m, in, ft, us-ft"):
        read_text(tmp_path, "1 2 3\n", units="yd")
    with pytest.raises(InputError, match="holds one cloud, so there is no #2"):
        read_points(f"{tmp_path / 'cloud.txt'}#2")


def test_too_large_text_is_refused(tmp_path: Path) -> None:
    for text, name in (("1 2 3\n", "cloud.xyz"), ("ply ...\n", "cloud.ply")):
        with limits(file_bytes=4), pytest.raises(InputError, match="exceed the limit file_bytes=4"):
            read_text(tmp_path, text, name)


PLY = "ply\nformat {0} 1.0\ncomment made by hand\nelement vertex 3\n{1}end_header\n"
AXES = "".join(f"property {{0}} {axis}\n" for axis in "xyz")


@pytest.mark.parametrize("kind", ["float", "double"])
@pytest.mark.parametrize("encoding", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_ply_of_every_encoding(tmp_path: Path, encoding: str, kind: str) -> None:
    header = PLY.format(encoding, AXES.format(kind) + "property uchar red\n").encode()
    if encoding == "ascii":
        body = "".join(f"{row} 7\n" for row in ROWS).encode()
    else:
        order = "<" if "little" in encoding else ">"
        table = np.zeros(
            3, [(axis, order + ("f4" if kind == "float" else "f8")) for axis in "xyz"] + [("r", "u1")]
        )
        for k, axis in enumerate("xyz"):
            table[axis] = POINTS[:, k]
        body = table.tobytes()
    (tmp_path / "cloud.ply").write_bytes(header + body)
    cloud = read_points(tmp_path / "cloud.ply")
    np.testing.assert_allclose(cloud.points, POINTS, rtol=6e-8 if kind == "float" else 0)


def test_ply_meshes_give_vertices_and_normals(tmp_path: Path) -> None:
    names = dict(zip(("nx", "ny", "nz"), NORMALS.T, strict=True))
    write_mesh_ply(tmp_path / "mesh.ply", POINTS, np.array([[0, 1, 2]]), names)
    cloud = read_points(tmp_path / "mesh.ply")
    np.testing.assert_array_equal(cloud.points, POINTS)
    assert cloud.normals is not None
    np.testing.assert_array_equal(cloud.normals, NORMALS)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"plywood", "not a PLY file: no header"),
        (
            PLY.format("ascii", "property float x\n").encode(),
            r"have the properties \['x'\]; x, y, z are needed",
        ),
        (
            PLY.format("ascii", AXES.format("float")).encode() + b"1 2 3\n",
            "edited: 3 rows announced .3 of vertices., 1 present",
        ),
        (
            PLY.format("binary_little_endian", AXES.format("float")).encode(),
            "truncated: 3 vertices take 36 bytes",
        ),
        (PLY.format("morse", AXES.format("float")).encode(), "unknown format 'morse'"),
        (PLY.format("ascii", "property list uchar int x\n").encode(), "x, y, z are needed"),
        (
            PLY.format("binary_little_endian", AXES.format("float"))
            .replace("element vertex", "element camera 1\nproperty float f\nelement vertex")
            .encode(),
            "its vertices are not its first element; save it with vertices first",
        ),
        (
            PLY.format("ascii", AXES.format("float")).replace("vertex 3", "vertex 0").encode(),
            "no finite point",
        ),
    ],
)
def test_damaged_ply_says_why(tmp_path: Path, data: bytes, message: str) -> None:
    (tmp_path / "cloud.ply").write_bytes(data)
    with pytest.raises(InputError, match=message):
        read_points(tmp_path / "cloud.ply")


def test_npz_of_points(tmp_path: Path) -> None:
    np.savez(tmp_path / "c.npz", points=POINTS, normals=NORMALS)
    cloud = read_points(tmp_path / "c.npz")
    np.testing.assert_array_equal(cloud.points, POINTS)
    assert cloud.normals is not None
    assert not cloud.points.flags.writeable
    with pytest.raises(InputError, match="there is no #2"):
        read_points(f"{tmp_path / 'c.npz'}#2")
    np.savez(tmp_path / "bad.npz", points=POINTS[:, :2])
    with pytest.raises(InputError, match=r"bad\.npz: expected points with shape \(n, 3\)"):
        read_points(tmp_path / "bad.npz")
    np.savez(tmp_path / "other.npz", vertices=POINTS)
    with pytest.raises(InputError, match="holds vertices, which is no scan"):
        read_points(tmp_path / "other.npz")


@pytest.mark.parametrize("kind", PROJECTIONS)
@pytest.mark.parametrize("suffix", [".npz", ".ply", ".e57", ".pcd", ".ptx"])
def test_scans_give_all_valid_points_in_the_world(tmp_path: Path, suffix: str, kind: str) -> None:
    scan = example_scan(PROJECTIONS[kind], colour=False)
    write_scan(scan, tmp_path / f"scan{suffix}")
    cloud = read_points(tmp_path / f"scan{suffix}")
    expected = scan.points()[scan.valid]
    assert len(cloud.points) == len(expected)
    order, wanted = np.lexsort(cloud.points.round(5).T), np.lexsort(expected.round(5).T)
    tolerance = 2e-6 if suffix == ".pcd" else 1e-8
    assert np.abs(np.sort(cloud.points[order], axis=0) - np.sort(expected[wanted], axis=0)).max() < tolerance
    np.testing.assert_allclose(cloud.origins, np.tile(scan.world_from_sensor.translation, (len(expected), 1)))
    np.testing.assert_allclose(cloud.rays(), cloud.points - scan.world_from_sensor.translation)


def test_one_scan_of_several(tmp_path: Path) -> None:
    pytest.importorskip("pye57")
    scans = [example_scan(LASER, colour=False), example_scan(LASER)]
    write_scans([scans[0], scans[1].transform(POSE)], tmp_path / "two.e57")
    both, second = read_points(tmp_path / "two.e57"), read_points(f"{tmp_path / 'two.e57'}#2")
    expected = read_scan(f"{tmp_path / 'two.e57'}#2")
    assert second.name == "two.e57#2"
    assert len(second.points) == int(expected.valid.sum())
    assert len(both.points) == len(second.points) + int(scans[0].valid.sum())
    assert both.origins is not None
    assert len(np.unique(both.origins.round(9), axis=0)) == 2
    np.testing.assert_allclose(both.origins[-1], expected.world_from_sensor.translation)
    with pytest.raises(InputError, match="there is no #3: there are 2 scans, counted from 1"):
        read_points(f"{tmp_path / 'two.e57'}#3")


def write_unorganised_pcd(path: Path, viewpoint: str, fields: str = "x y z") -> None:
    n = len(fields.split())
    table = np.hstack([POINTS, NORMALS])[:, :n]
    path.write_text(
        f"VERSION 0.7\nFIELDS {fields}\nSIZE {'4 ' * n}\nTYPE {'F ' * n}\nCOUNT {'1 ' * n}\n"
        f"WIDTH 3\nHEIGHT 1\nVIEWPOINT {viewpoint}\nPOINTS 3\nDATA ascii\n"
        + "".join(" ".join(map(str, row)) + "\n" for row in table)
    )


def test_unorganised_pcd_is_moved_by_its_viewpoint(tmp_path: Path) -> None:
    pytest.importorskip("pypcd4")
    write_unorganised_pcd(tmp_path / "c.pcd", "0 0 0 1 0 0 0", "x y z normal_x normal_y normal_z")
    cloud = read_points(tmp_path / "c.pcd")
    np.testing.assert_allclose(cloud.points, POINTS, rtol=1e-6)
    assert cloud.normals is not None
    np.testing.assert_allclose(cloud.normals, NORMALS, atol=1e-6)
    assert cloud.warnings == ()
    assert cloud.origins is None  # the default viewpoint
    with pytest.raises(InputError, match=r"c\.pcd does not tell where the scanner stood; give --origin"):
        cloud.rays()
    np.testing.assert_allclose(cloud.rays([0, 0, 1.0]), cloud.points - [0, 0, 1])
    write_unorganised_pcd(tmp_path / "c.pcd", "1 2 3 0 0 0 1", "x y z normal_x normal_y normal_z")
    moved = read_points(tmp_path / "c.pcd")
    turned = Pose.from_parts(np.diag([-1.0, -1.0, 1.0]), np.array([1.0, 2.0, 3.0]))
    np.testing.assert_allclose(moved.points, turned.apply(POINTS), atol=1e-5)
    assert moved.normals is not None
    np.testing.assert_allclose(moved.normals, NORMALS * [-1, -1, 1], atol=1e-6)
    assert "by VIEWPOINT" in moved.warnings[0]
    np.testing.assert_allclose(moved.origins, np.tile([1.0, 2.0, 3.0], (3, 1)))
    write_unorganised_pcd(tmp_path / "c.pcd", "0 0 0 1 0 0 0", "a y z")
    with pytest.raises(InputError, match="has the fields a, y, z; x, y, z are needed"):
        read_points(tmp_path / "c.pcd")


@pytest.mark.parametrize("suffix", [".las", ".laz"])
def test_las_gives_scaled_points_without_the_withheld(tmp_path: Path, suffix: str) -> None:
    laspy = pytest.importorskip("laspy")
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = np.full(3, 1e-4), POINTS[0]
    las = laspy.LasData(header)
    las.xyz = POINTS
    las.write(tmp_path / f"c{suffix}")
    cloud = read_points(tmp_path / f"c{suffix}")
    np.testing.assert_allclose(cloud.points, POINTS, atol=1e-4)
    assert cloud.warnings == ()
    las.withheld = [0, 1, 0]
    las.write(tmp_path / f"c{suffix}")
    cloud = read_points(tmp_path / f"c{suffix}")
    np.testing.assert_allclose(cloud.points, POINTS[[0, 2]], atol=1e-4)
    assert cloud.warnings == ("1 points are marked withheld and were left out",)


def test_las_without_its_extra_names_the_cure(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "c.las").write_bytes(b"LASF")
    monkeypatch.setitem(sys.modules, "laspy", None)
    with pytest.raises(InputError, match=r'laspy is not installed; the cure: pip install "unseen\[las\]"'):
        read_points(tmp_path / "c.las")


def test_las_that_announces_too_much_is_refused(tmp_path: Path) -> None:
    laspy = pytest.importorskip("laspy")
    las = laspy.create(point_format=0, file_version="1.2")
    las.xyz = POINTS
    las.write(tmp_path / "c.las")
    with limits(points=2), pytest.raises(InputError, match="its points: 3 exceed the limit points=2"):
        read_points(tmp_path / "c.las")


@pytest.mark.parametrize("suffix", point_suffixes())
def test_damaged_files_are_one_input_error_that_names_them(tmp_path: Path, suffix: str) -> None:
    (tmp_path / f"broken{suffix}").write_bytes(bytes(range(256)) * 3)
    with pytest.raises(InputError, match=rf"broken\{suffix}"):
        read_points(tmp_path / f"broken{suffix}")


@requires_data
def test_real_files() -> None:
    assert len(read_points(data_path("fitting/nist_l2/Cylinder/cyl29.ds"), "mm").points) == 110
    assert len(read_points(data_path("range/e57/pumpA.e57")).points) == 155201
    assert len(read_points(data_path("range/pyransac3d/caixa.ply")).points) == 46370
    assert len(read_points(data_path("range/ptx/no-color.ptx")).points) > 0


def test_a_scan_that_is_not_there_is_named(tmp_path: Path) -> None:
    write_scan(example_scan(LASER, colour=False), tmp_path / "one.ptx")
    with pytest.raises(InputError, match="there is no scan 3: there are 1"):
        PtxFile(tmp_path / "one.ptx").points(2)


def test_a_part_seen_from_one_place_is_told_to_be_one_sided(tmp_path: Path) -> None:
    pytest.importorskip("pye57")
    scans = [example_scan(LASER, colour=False), example_scan(LASER, colour=False).transform(POSE)]
    write_scan(scans[0], tmp_path / "one.ptx")
    (told,) = read_part_file(tmp_path / "one.ptx").warnings
    assert "measured from one place, " in told
    assert "unseen complete" in told
    write_scans(scans, tmp_path / "two.e57")
    assert not any("one place" in text for text in read_part_file(tmp_path / "two.e57").warnings)
