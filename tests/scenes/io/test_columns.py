# SPDX-License-Identifier: MIT
"""Text of points by others: which columns are colours, and in which unit the coordinates are."""

import struct

import numpy as np
import pytest

from scenes import InputError, load_scene
from scenes.io.columns import unit_of_comment, unit_of_names
from scenes.io.point_files import read_points
from scenes.scan.colour import scaled_bytes

POINTS = np.random.default_rng(0).random((300, 3)) * [5, 4, 2.7]
COLOUR = [200, 100, 50]


def written(tmp_path, name, header, line, encoding="utf-8"):
    """A file with a line a point."""
    path = tmp_path / name
    path.write_text("".join([header, *(f"{line(k, *p)}\n" for k, p in enumerate(POINTS))]), encoding)
    return path


def plain(_, x, y, z):
    return f"{x:.4f} {y:.4f} {z:.4f}"


def mixed(point, more):
    return ",".join(f"{value:.4f}" for value in point) + f",{more}"


COLOURED = {
    "named, quoted": (
        "a.csv",
        '"X","Y","Z","R","G","B"\n',
        lambda _, x, y, z: f'"{x:.3f}","{y:.3f}","{z:.3f}","200","100","50"',
    ),
    "a scalar field after them": (
        "a.txt",
        f"//X Y Z R G B Scalar_field\n{len(POINTS)}\n",
        lambda *p: plain(*p) + " 200 100 50 1.0",
    ),
    "nameless, and normals": ("a.xyz", "", lambda *p: plain(*p) + " 200 100 50 0 0 1"),
    "normals first": ("a.xyz", "", lambda *p: plain(*p) + " 0.6 0.8 0 200 100 50"),
    "nameless, a negative intensity after": ("a.txt", "", lambda *p: plain(*p) + f" 200 100 50 {-p[0] - 1}"),
    "counted points, an intensity before": (
        "a.pts",
        f"{len(POINTS)}\n",
        lambda *p: plain(*p) + f" {p[0] % 255} 200 100 50",
    ),
    "of 0 to 1": ("a.csv", "x,y,z,red,green,blue\n", lambda _, *p: mixed(p, ".7843,.3922,.1961")),
    "of 16 bits": ("a.csv", "red,green,blue,z,y,x\n", lambda _, x, y, z: f"51400,25700,12850,{z},{y},{x}"),
}  # fmt: skip


@pytest.mark.parametrize("case", COLOURED)
def test_colours_are_read(tmp_path, case):
    cloud = read_points(written(tmp_path, *COLOURED[case]))
    assert (cloud.colour == COLOUR).all()
    assert np.abs(cloud.points - POINTS).max() < 1e-3


def test_columns_that_may_be_colours_are_told(tmp_path):
    cloud = read_points(
        written(tmp_path, "a.txt", "", lambda *p: plain(*p) + f" {p[0] % 255} {p[0] % 99} 100 50")
    )
    assert cloud.colour is None
    assert any("may be colours" in warning for warning in cloud.warnings)


def test_points_without_a_colour_take_the_nearest(tmp_path):
    path = written(
        tmp_path,
        "a.csv",
        "x,y,z,red,green,blue\n",
        lambda k, *p: ",".join(map(str, p)) + (",,," if k % 10 == 0 else ",200,100,50"),
    )
    cloud = read_points(path)
    assert (cloud.colour == COLOUR).all()
    assert any("30 of 300 points have no valid colour" in warning for warning in cloud.warnings)


@pytest.mark.parametrize(
    ("header", "metres"),
    [
        ("X [mm],Y [mm],Z [mm],I\n", 0.001),
        ("x(ft),y(ft),z(ft),t(s)\n", 0.3048),
        ("# units: us survey feet\nx,y,z,i\n", 1200 / 3937),
        ("# File units = inches\n", 0.0254),
    ],
)
def test_units_in_headers_are_applied(tmp_path, header, metres):
    path = written(tmp_path, "a.csv", header, lambda _, *p: mixed(np.array(p) / metres, "0"))
    cloud = read_points(path)
    assert np.abs(cloud.points - POINTS).max() < 1e-3
    assert any("states its unit" in warning for warning in cloud.warnings)


def test_units_that_are_none():
    assert unit_of_names("x [m], y [m], z [mm]") is None
    assert unit_of_names("x (left), y (up), z") is None
    assert unit_of_comment("# 40 units, united, unit of measure") is None


@pytest.mark.parametrize(
    "line",
    [
        lambda _, x, y, z: f'"{x + 4e5:,.3f}","{y + 5e6:,.3f}","{z + 100:,.3f}"',
        lambda _, x, y, z: f'"{x + 4e5:,.3f}";"{y + 5e6:,.3f}";"{z + 100:,.3f}"',
        lambda k, x, y, z: f"P{k};{x + 4e5:.3f};{y + 5e6:.3f};{z + 100:.3f};W".replace(".", ","),
        lambda k, x, y, z: f"P{k}\t{x + 4e5:.3f}\t{y + 5e6:.3f}\t{z + 100:.3f}\tW".replace(".", ","),
    ],
)
def test_thousands_and_decimal_commas(tmp_path, line):
    header = "punkt;rechtswert;hochwert;höhe;code\n" if line(0, 0, 0, 0).startswith("P") else "x;y;z\n"
    cloud = read_points(written(tmp_path, "a.csv", header, line, "latin-1"))
    assert np.abs(cloud.points - POINTS - [4e5, 5e6, 100]).max() < 1e-3


@pytest.mark.parametrize("header", ["lon,lat,alt\n", "Latitude;Longitude;Height\n", "# lat lon h\n"])
def test_degrees_are_refused(tmp_path, header):
    with pytest.raises(InputError, match="degrees of longitude and latitude"):
        read_points(written(tmp_path, "a.csv", header, plain))


def test_colours_of_other_ranges_are_refused():
    with pytest.raises(InputError, match=r"-1\.\.200"):
        scaled_bytes(np.array([-1.0, 200.0]))


def mesh_text(suffix, unit):
    """A triangle of 3 by 4 units, and a comment on them."""
    return {
        ".obj": f"# SketchUp\n# File units = {unit}\nv 0 0 0\nv 3 0 0\nv 0 4 0\nf 1 2 3\n",
        ".stl": f"solid part, units = {unit}\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 3 0 0\n"
        "vertex 0 4 0\nendloop\nendfacet\nendsolid\n",
        ".ply": f"ply\nformat ascii 1.0\ncomment Units: {unit}\nelement vertex 3\nproperty float x\n"
        "property float y\nproperty float z\nelement face 1\nproperty list uchar int vertex_indices\n"
        "end_header\n0 0 0\n3 0 0\n0 4 0\n3 0 1 2\n",
    }[suffix]


@pytest.mark.parametrize("suffix", [".obj", ".stl", ".ply"])
@pytest.mark.parametrize(("unit", "metres"), [("inches", 0.0254), ("mm", 0.001), ("Feet", 0.3048)])
def test_units_in_comments_of_meshes_are_applied(tmp_path, suffix, unit, metres):
    path = tmp_path / f"a{suffix}"
    path.write_text(mesh_text(suffix, unit))
    scene = load_scene(path, units="cm")
    assert np.ptp(scene.mesh.vertices, axis=0) == pytest.approx([3 * metres, 4 * metres, 0])
    assert any("states its unit" in warning for warning in scene.warnings)


def test_zeros_at_the_end_of_an_stl_are_no_damage(tmp_path):
    path = tmp_path / "a.stl"
    corners = struct.pack("<12fH", 0, 0, 1, 0, 0, 0, 3, 0, 0, 0, 4, 0, 0)
    path.write_bytes(b"x".ljust(80) + struct.pack("<I", 1) + corners + b"\0" * 7)
    assert len(load_scene(path).mesh.faces) == 1
    path.write_bytes(path.read_bytes() + b"abc")
    with pytest.raises(InputError, match="damaged STL"):
        load_scene(path)


def test_strips_of_triangles_are_named(tmp_path):
    path = tmp_path / "a.ply"
    path.write_text(mesh_text(".ply", "m").replace("element face", "element tristrips"))
    with pytest.raises(InputError, match="strips of triangles"):
        load_scene(path)
