# SPDX-License-Identifier: MIT
"""Crashers whose counts, sizes and layouts lie."""

from __future__ import annotations

from functools import cache

from tests.robustness.crashers.crasher import Crasher, patched, replaced
from tests.robustness.fuzzing import seeds_of_scans
from tests.robustness.fuzzing.case import Case

_EXTENDED_LENGTH = 20


@cache
def _laz() -> Case:
    return seeds_of_scans.scan_files(".laz")[0]


def _points_at(case: Case) -> int:
    return int.from_bytes(case.files[case.entry][96:100], "little")


def _laszip_at(case: Case) -> int:
    """Where LASzip's record begins, behind its head."""
    return case.files[case.entry].index(b"laszip encoded") - 2 + 54


def laz_layer_of_4_gb() -> Case:
    """The size of a layer of the first chunk is 2^32 - 1; behind the table's place and the first point."""
    case = _laz()
    length = int.from_bytes(case.files[case.entry][105:107], "little")
    return patched(case, _points_at(case) + 8 + length + 4, b"\xff" * 4)


def laz_without_items() -> Case:
    """Points are packed as no items."""
    return patched(_laz(), _laszip_at(_laz()) + 32, b"\0\0")


def laz_items_of_another_length() -> Case:
    """The first item has more bytes than a point."""
    return patched(_laz(), _laszip_at(_laz()) + 36, (200).to_bytes(2, "little"))


def laz_without_a_point() -> Case:
    """The first item is a colour of a point's length, so that there are fewer layers than lazrs reads."""
    return patched(_laz(), _laszip_at(_laz()) + 34, (11).to_bytes(2, "little"))


def laz_without_chunks() -> Case:
    """Points are packed in one piece."""
    return patched(_laz(), _laszip_at(_laz()), b"\1")


def laz_without_its_record() -> Case:
    """Nothing says how points are packed."""
    return replaced(_laz(), b"laszip encoded", b"laszip decoded")


def laz_of_few_points() -> Case:
    """The header announces more points than the chunks hold."""
    return patched(_laz(), 247, (60_000).to_bytes(8, "little"))


def laz_of_another_chunk() -> Case:
    """The table of chunks is none: its count of bytes cannot be unpacked."""
    case = _laz()
    data = case.files[case.entry]
    start = _points_at(case)
    where = int.from_bytes(data[start : start + 8], "little")
    return patched(case, where + 8, b"\xff" * (len(data) - where - 8))


def las_with_a_long_record() -> Case:
    """An extended record of 2^62 bytes behind the points."""
    case = seeds_of_scans.scan_files(".las")[0]
    data = case.files[case.entry]
    record = bytearray(60)
    record[_EXTENDED_LENGTH : _EXTENDED_LENGTH + 8] = (1 << 62).to_bytes(8, "little")
    head = data[:235] + len(data).to_bytes(8, "little") + (1).to_bytes(4, "little") + data[247:]
    return case.changed(case.entry, head + bytes(record))


_PCD = (
    b"VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 2\nHEIGHT 2\n"
    b"VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 4\nDATA ascii\n"
)


def _pcd(old: bytes, new: bytes) -> Case:
    return replaced(Case({"s.pcd": _PCD + b"1 2 3\n" * 4}, "s.pcd"), old, new)


def pcd_with_colour() -> Case:
    """An organised cloud with zeros, a VIEWPOINT and colours, of which a scan holds less than a cloud."""
    case = seeds_of_scans.pcd_files("ascii")[0]
    lines = case.files[case.entry].split(b"\n")
    lines[30] = b"0 0 0 0"
    return case.changed(case.entry, b"\n".join(lines))


def _text(text: str, name: str = "p.txt") -> Case:
    return Case({name: text.encode()}, name)


def obj_with_a_long_name() -> Case:
    """A material of 5000 characters that is not defined."""
    text = "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl " + "a" * 5000 + "\nf 1 2 3\n"
    return Case({"m.obj": text.encode(), "m.mtl": b"newmtl b\n"}, "m.obj")


STRUCTURES = (
    Crasher("points text", "a warning of 9000 characters", lambda: _text("a" * 3000 + " b c\n1 2 3\n"), ""),
    Crasher("mesh obj", "a warning of 5000 characters", obj_with_a_long_name, ""),
    Crasher(
        "scan laz", "lazrs asked for 4 GB and ended the process (SIGABRT)", laz_layer_of_4_gb, "layers of"
    ),
    Crasher("scan laz", "lazrs panicked, which is no Exception", laz_without_items, "packed as 0 items"),
    Crasher("scan laz", "lazrs panicked", laz_items_of_another_length, "its packed items .* have 2"),
    Crasher("scan laz", "lazrs asked for GB of layers", laz_without_a_point, "its packed items .* have"),
    Crasher("scan laz", "lazrs knows chunks alone", laz_without_chunks, "packed in way 1"),
    Crasher("scan laz", "lazrs panicked", laz_without_its_record, "no record that says how its points"),
    Crasher(
        "scan laz", "points of nothing", laz_of_few_points, "60,000 points announced|is it damaged|ratio"
    ),
    Crasher("points laz", "lazrs panicked", laz_of_another_chunk, "damaged|truncated|cannot be read"),
    Crasher("scan las", "MemoryError", las_with_a_long_record, "extended record 1 ends at byte"),
    Crasher(
        "scan pcd ascii",
        "pypcd4 made a list of 10^8 names",
        lambda: _pcd(b"COUNT 1", b"COUNT 99999999"),
        "values; expected",
    ),
    Crasher(
        "points pcd",
        "MemoryError",
        lambda: _pcd(b"POINTS 4", b"POINTS 999999999"),
        "999999999 points in",
    ),
    Crasher("points pcd", "IndexError: colours of another length than points", pcd_with_colour, ""),
    Crasher(
        "points text",
        "a regular expression in quadratic time: hours",
        lambda: _text("a" + "[" * 200_000),
        "no point in",
    ),
    Crasher(
        "points text",
        "named normals vanished when a line had none",
        lambda: _text("x y z nx ny nz\n" + "1 2 3 0 0 1\n" * 3 + "1 2 3\n"),
        "line 5 has 3 columns, 6 are needed",
    ),
)
