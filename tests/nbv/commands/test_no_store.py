# SPDX-License-Identifier: MIT
"""Commands where numba finds no folder to store compiled code in, as of another user in a container."""

import subprocess
import sys
from pathlib import Path

import pytest

from scenes.io.scan_files import write_scan
from tests.helpers.scan_examples import PROJECTIONS, example_scan

NOWHERE = (
    "import numba.core.caching as c; c.CacheImpl._locator_classes = []; from nbv.cli import main; main()"
)
LINE = "no folder for compiled code can be written: each run compiles anew, which takes a minute; set NUMBA_"


@pytest.mark.parametrize("suffix", [".e57", ".pcd"])
def test_scans_are_described_all_the_same_and_one_line_says_why_it_takes_long(
    tmp_path: Path, suffix: str
) -> None:
    file = tmp_path / f"a{suffix}"
    write_scan(example_scan(PROJECTIONS["pinhole"], off_rays_m=0.01), file)
    command = [sys.executable, "-c", NOWHERE, "info", str(file)]
    ran = subprocess.run(command, capture_output=True, text=True, check=True)
    (line,) = [text for text in ran.stderr.splitlines() if "compile" in text]
    assert line.startswith(LINE)
    assert "cannot be read" not in ran.stdout + ran.stderr


@pytest.mark.long
def test_a_scan_is_taken_all_the_same(tmp_path: Path) -> None:
    at = ["--at", "1,1,1.6", "--look", "4,3,1", "-o", str(tmp_path / "s.npz")]
    command = [sys.executable, "-c", NOWHERE, "scan", "builtin:two_occluders", *at]
    ran = subprocess.run(command, capture_output=True, text=True, check=True)
    assert ran.stderr.count(LINE) == 1
    assert (tmp_path / "s.npz").exists()
