# SPDX-License-Identifier: MIT
"""Inputs are opened once: what is counted, picked and read comes from the same opening."""

import os
import sys
from collections import Counter
from pathlib import Path

import pytest

from scenes.io.describe import describe
from scenes.io.point_files import read_points
from scenes.io.scan_files import open_scans, read_scan, read_scans, write_scan, write_scans
from tests.helpers.completion_examples import example

OPENED = Counter()
COUNTING = []


def _count(event, arguments):
    """Count what Python opens while the test asks for it; an audit hook cannot be taken away again."""
    if COUNTING and event == "open" and isinstance(arguments[0], str | os.PathLike):
        OPENED[Path(arguments[0]).name] += 1


sys.addaudithook(_count)


@pytest.fixture
def opened(monkeypatch):
    """How often each file is opened from here on; libraries in C++ count apart, under the library's name."""
    pye57 = pytest.importorskip("pye57")
    real = pye57.E57.__init__

    def count(self, path, *rest, **more):
        OPENED["pye57"] += 1
        real(self, path, *rest, **more)

    monkeypatch.setattr(pye57.E57, "__init__", count)
    OPENED.clear()
    COUNTING.append(True)
    yield OPENED
    COUNTING.clear()


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """One scan as NPZ and PTX; three in a file of E57 and one of PTX."""
    scan, made = example("two_occluders", pixels=40), tmp_path_factory.mktemp("scans")
    for name in ("one.npz", "one.ptx", "one.e57"):
        write_scan(scan, made / name)
    write_scans([scan] * 3, made / "three.e57")
    (made / "three.ptx").write_text(3 * (made / "one.ptx").read_text())
    return made


@pytest.mark.parametrize("name", ["one.npz", "one.ptx", "one.e57", "three.e57", "three.ptx"])
@pytest.mark.parametrize("read", [read_scans, read_points, describe])
def test_a_file_is_opened_once_however_many_scans_it_holds(folder, opened, name, read):
    read(folder / name)
    assert opened[name] == 1
    assert opened["pye57"] == name.endswith("e57")


@pytest.mark.parametrize("name", ["one.npz", "one.ptx", "one.e57", "three.e57#2", "three.ptx#2"])
def test_one_scan_takes_one_opening(folder, opened, name):
    read_scan(f"{folder / name}")
    assert opened[name.partition("#")[0]] == 1


def test_a_source_counts_and_reads_from_one_opening(folder, opened):
    source = open_scans(folder / "three.ptx")
    assert len(source.readers) == 3
    assert source.registered
    assert [scan.name for scan in source.read()] == ["three#1", "three#2", "three#3"]
    assert source.read(2)[0].ranges.tobytes() == source.readers[1]().ranges.tobytes()
    assert opened["three.ptx"] == 1
