# SPDX-License-Identifier: MIT
"""Text of points by others: which columns are colours, and in which unit the coordinates are."""

import numpy as np
import pytest

from scenes import InputError
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
