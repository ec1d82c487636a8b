# SPDX-License-Identifier: MIT
"""Law of many stations: memory hardly grows with their number, time hardly more than with it."""

import subprocess
import sys

import pytest

from tests.helpers.data_paths import ROOT

_MB_A_REGION = 0.025
_PHASE_MB = 64  # what may come together before memory is given back, wherever that happens in a run
_LARGEST_EXPONENT = 1.2  # 1.15 and what other work on the machine adds


@pytest.mark.long
def test_memory_of_stations_is_flat_and_time_nearly_linear() -> None:
    said = subprocess.run(
        [sys.executable, "-m", "benchmarks.stations", "2,4,16", "1.0"],
        cwd=ROOT, capture_output=True, text=True, check=True,
    ).stdout  # fmt: skip
    (in_memory, _), (least, some), (most, all_of_them) = (
        (float(line.split()[2]), int(line.split()[3])) for line in said.splitlines()[1:4]
    )
    assert most <= in_memory + _MB_A_REGION * all_of_them, said
    assert most <= least + _PHASE_MB + _MB_A_REGION * (all_of_them - some), said
    assert float(said.split()[-1]) <= _LARGEST_EXPONENT, said
