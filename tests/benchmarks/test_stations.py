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
    """Of two runs the lower peaks: by up to 20 MB they hang on when memory is given back."""
    runs = [
        subprocess.run(
            [sys.executable, "-m", "benchmarks.stations", "2,4,16", "1.0"],
            cwd=ROOT, capture_output=True, text=True, check=True,
        ).stdout
        for _ in range(2)
    ]  # fmt: skip
    said = "".join(runs)
    rows = zip(*(one.splitlines()[1:4] for one in runs), strict=True)
    (in_memory, _), (least, some), (most, all_of_them) = (
        (min(float(line.split()[2]) for line in row), int(row[0].split()[3])) for row in rows
    )
    assert most <= in_memory + _MB_A_REGION * all_of_them, said
    assert most <= least + _PHASE_MB + _MB_A_REGION * (all_of_them - some), said
    assert float(said.split()[-1]) <= _LARGEST_EXPONENT, said
