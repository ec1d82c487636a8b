# SPDX-License-Identifier: MIT
"""Lists of surveyors: columns by their names, in any order; empty fields and words shift none of them."""

from pathlib import Path

import numpy as np
import pytest

from scenes.checks import InputError
from scenes.io.point_files import read_points
from tests.helpers.data_paths import data_path, requires_data

POINTS = np.column_stack([
    np.linspace(4_000.25, 4_007.5, 20), np.linspace(9_100.5, 9_080.125, 20), np.linspace(512, 514.5, 20),
])  # fmt: skip


def write_list(path: Path, header: str, row: str, separator: str = ",") -> Path:
    """A line a point; in `row` n is its number, x y z its easting, northing and elevation."""
    lines = [
        row.format(n=k + 1, x=x, y=y, z=z).replace("|", separator)
        for k, (x, y, z) in enumerate(POINTS.tolist())
    ]
    path.write_text("\n".join([header.replace("|", separator), *lines]) + "\n", encoding="utf-8")
    return path


@requires_data
def test_a_reported_list() -> None:
    cloud = read_points(data_path("reported/csv_pnezd/t1_northing_easting.csv"))
    table = np.loadtxt(
        data_path("reported/csv_pnezd/t1_northing_easting.csv"), delimiter=",", skiprows=1, usecols=(2, 1, 3)
    )
    np.testing.assert_array_equal(cloud.points, table)
    assert cloud.warnings == ()


@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize(
    ("header", "row"),
    [
        ("P|N|E|Z|D", "{n}|{y}|{x}|{z}|WALL"),
        ("Point|Northing (m)|Easting (m)|Elevation (m)|Code", "{n}|{y}|{x}|{z}|"),
        ("Point Number|Easting|Northing|Elev", "{n}|{x}|{y}|{z}"),
        ("Description|H|E_m|N_m", "corner of wall|{z}|{x}|{y}"),
        ("number|code|height|north|east", "{n}||{z}|{y}|{x}"),
        ("number|code|height|north|east", '{n}|"wall, north; 2nd"|{z}|{y}|{x}'),
        ("n|x|y|z", "{n}|{x}|{y}|{z}"),
        ("e|n|u", "{x}|{y}|{z}"),
        ("id|Hochwert|Rechtswert|Höhe", "{n}|{y}|{x}|{z}"),
    ],
)
def test_columns_are_taken_by_their_names(tmp_path: Path, header: str, row: str, separator: str) -> None:
    cloud = read_points(write_list(tmp_path / "a.csv", header, row, separator))
    np.testing.assert_allclose(cloud.points, POINTS)
    assert cloud.warnings == ()


def test_an_empty_coordinate_is_left_out_and_shifts_nothing(tmp_path: Path) -> None:
    path = write_list(tmp_path / "a.csv", "P|N|E|Z|D", "{n}|{y}|{x}|{z}|WALL")
    lines = path.read_text().splitlines()
    lines[4] = "4,,4001.0,512.0,WALL"
    lines[1] = ",1,2,3,WALL"
    path.write_text("\n".join(lines))
    cloud = read_points(path)
    np.testing.assert_allclose(cloud.points, np.vstack([[2, 1, 3], np.delete(POINTS, (0, 3), axis=0)]))
    assert "1 of 20 points are not finite" in cloud.warnings[0]


@pytest.mark.parametrize("header", ["", "point|a|b|c|d"])
def test_numbers_of_points_without_names_are_refused(tmp_path: Path, header: str) -> None:
    path = write_list(tmp_path / "a.csv", header, "{n}|{y}|{x}|{z}|WALL")
    with pytest.raises(InputError, match=r"counts from 1 to 20, so it numbers the points; name") as caught:
        read_points(path)
    assert str(path) in str(caught.value)
