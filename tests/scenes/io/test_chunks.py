# SPDX-License-Identifier: MIT
"""Formats read some points at a time: how many changes nothing, and errors name the row of the file."""

from pathlib import Path

import numpy as np
import pytest

from scenes.checks import InputError
from scenes.io.clouds import las, ptx
from scenes.io.point_files import read_points
from scenes.io.scan_files import read_scan, write_scan
from tests.helpers.scan_examples import PROJECTIONS, assert_same_scan, example_scan

ROUNDING_M = 1e-13  # a product of one row may be rounded otherwise


@pytest.mark.parametrize("size", [2, 31, 64])
@pytest.mark.parametrize("suffix", ["ptx", "las", "laz"])
def test_the_size_of_chunks_changes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str, size: int
) -> None:
    if suffix != "ptx":
        pytest.importorskip("laspy")
    path = tmp_path / f"a.{suffix}"
    write_scan(example_scan(PROJECTIONS["panorama"], off_rays_m=2e-4), path)
    scan, cloud = read_scan(path), read_points(path)
    for module in (ptx, las):
        monkeypatch.setattr(module, "_CHUNK", size)
    assert_same_scan(read_scan(path), scan, ROUNDING_M)
    np.testing.assert_allclose(read_points(path).points, cloud.points, rtol=0, atol=ROUNDING_M)
    np.testing.assert_array_equal(read_points(path).colour, cloud.colour)


def test_errors_of_a_later_chunk_name_its_own_row(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_scan(example_scan(PROJECTIONS["pinhole"]), tmp_path / "a.ptx")
    lines = (tmp_path / "a.ptx").read_text().splitlines()
    monkeypatch.setattr(ptx, "_CHUNK", 50)
    for change, message in (
        (lambda line: line.replace(line.split()[0], "x"), "at row 123"),
        (lambda line: " ".join(line.split()[:4]), "point 124 has 4 numbers, 7 are needed"),
        (lambda _: "", "truncated: [0-9]+ points announced, [0-9]+ present"),
    ):
        wrong = [change(line) if k == 133 else line for k, line in enumerate(lines)]
        (tmp_path / "b.ptx").write_text("\n".join(wrong) + "\n")
        with pytest.raises(InputError, match=message):
            read_scan(tmp_path / "b.ptx")
    fewer = [" ".join(line.split()[:4]) if k >= 110 else line for k, line in enumerate(lines)]
    (tmp_path / "c.ptx").write_text("\n".join(fewer) + "\n")
    with pytest.raises(InputError, match="point 101 has 4 numbers, 7 are needed"):
        read_scan(tmp_path / "c.ptx")
