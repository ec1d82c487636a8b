# SPDX-License-Identifier: MIT
"""Law of many stations: memory hardly grows with their number, time hardly more than with it."""

import subprocess
import sys

import pytest

from tests.helpers.data_paths import ROOT

_SLACK_MB = 64  # what may come together before memory is given back
_MB_A_SURFACE = 0.1
_MB_A_STATION = 4.0  # numbers of the pixels that are joined, while they are: 4 bytes a pixel


@pytest.mark.long
def test_memory_of_stations_is_flat_and_time_nearly_linear() -> None:
    said = subprocess.run(
        [sys.executable, "-m", "benchmarks.stations", "3,6,12", "1.0"],
        cwd=ROOT, capture_output=True, text=True, check=True,
    ).stdout  # fmt: skip
    rows = [line.split() for line in said.splitlines()[1:4]]
    least, most = float(rows[0][2]), float(rows[-1][2])
    more = _MB_A_STATION * (12 - 3) + _MB_A_SURFACE * (int(rows[-1][3]) - int(rows[0][3]))
    assert most <= least + _SLACK_MB + more, said
    assert float(said.split()[-1]) <= 1.3, said
