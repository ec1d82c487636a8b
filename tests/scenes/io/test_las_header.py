# SPDX-License-Identifier: MIT
"""LAS and LAZ headers that lie: refused before a decoder allocates what they announce."""

import struct
from pathlib import Path

import numpy as np
import pytest

from scenes.checks import InputError
from scenes.io.point_files import read_points
from scenes.io.scan_files import read_scan, write_scan
from tests.helpers.scan_examples import PROJECTIONS, example_scan


def patched(tmp_path: Path, suffix: str, at: int, form: str, *values: int) -> Path:
    """A written file with other numbers at a byte of it."""
    write_scan(example_scan(PROJECTIONS["pinhole"]), tmp_path / f"a{suffix}")
    data = bytearray((tmp_path / f"a{suffix}").read_bytes())
    struct.pack_into(form, data, at, *values)
    (tmp_path / f"b{suffix}").write_bytes(data)
    return tmp_path / f"b{suffix}"


def start_of_points(file: Path) -> int:
    return int(struct.unpack_from("<I", file.read_bytes(), 96)[0])


@pytest.mark.parametrize("suffix", [".las", ".laz"])
@pytest.mark.parametrize(
    ("at", "form", "value", "message"),
    [
        (0, "<I", 0, "not a LAS file"),
        (96, "<I", 2**31, "damaged: 2 records before points at byte 2147483648"),
        (100, "<I", 2**30, "damaged: 1073741824 records before points"),
        (243, "<I", 2**30, "damaged: 1073741824 records from byte"),
        (247, "<Q", 2**40, ".*1,099,511,627,776"),
    ],
)
def test_counts_that_lie_are_refused(
    tmp_path: Path, suffix: str, at: int, form: str, value: int, message: str
) -> None:
    file = patched(tmp_path, suffix, at, form, value)
    text = message.replace("damaged: 2 records", r"damaged: \d records")
    for read in (read_scan, read_points):
        with pytest.raises(InputError, match=rf"b\{suffix}: {text}"):
            read(file)


def test_tables_of_chunks_that_lie_are_refused(tmp_path: Path) -> None:
    write_scan(example_scan(PROJECTIONS["pinhole"]), tmp_path / "a.laz")
    points = start_of_points(tmp_path / "a.laz")
    with pytest.raises(InputError, match=r"its table of chunks is at byte 1099511627776 of"):
        read_points(patched(tmp_path, ".laz", points, "<q", 2**40))
    (table,) = struct.unpack_from("<q", (tmp_path / "a.laz").read_bytes(), points)
    with pytest.raises(InputError, match=r"damaged: 1000000000 chunks announced in \d+ bytes"):
        read_points(patched(tmp_path, ".laz", table + 4, "<I", 1_000_000_000))
    (tmp_path / "c.laz").write_bytes((tmp_path / "a.laz").read_bytes()[:points])
    with pytest.raises(InputError, match=r"c\.laz: truncated: there are no packed points"):
        read_points(tmp_path / "c.laz")
    data = bytearray((tmp_path / "a.laz").read_bytes())
    struct.pack_into("<q", data, points, -1)  # as written to a pipe: the place stands at the end
    (tmp_path / "d.laz").write_bytes(bytes(data) + struct.pack("<q", table))
    whole = read_points(tmp_path / "a.laz")
    np.testing.assert_array_equal(read_points(tmp_path / "d.laz").points, whole.points)
