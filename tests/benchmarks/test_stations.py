# SPDX-License-Identifier: MIT
"""Law of many stations: memory hardly grows with their number, time hardly more than with it."""

import subprocess
import sys

import pytest

from tests.helpers.data_paths import ROOT

_MB_A_REGION = 0.025
_PHASE_MB = 64  # what may come together before memory is given back, wherever that happens in a run
_LARGEST_EXPONENT = 1.2  # 1.15 and what other work on the machine adds
_COMMAND = ("benchmarks", "run", "--fresh", "stations", "--numbers", "2,4,16", "--megapixels", "1.0")


@pytest.mark.long
def test_memory_of_stations_is_flat_and_time_nearly_linear() -> None:
    """Of two runs the lower peaks: by up to 20 MB they hang on when memory is given back."""
    runs = [
        subprocess.run(
            [sys.executable, "-m", *_COMMAND], cwd=ROOT, capture_output=True, text=True, check=True
        ).stdout
        for _ in range(2)
    ]
    printed = "".join(runs)
    rows = zip(*(run.splitlines()[2:5] for run in runs), strict=True)
    cells = [[[cell.strip() for cell in line.split("|")[1:-1]] for line in pair] for pair in rows]
    assert [pair[0][0] for pair in cells] == ["2", "4", "16"], printed
    (in_memory, _), (least, some), (most, all_of_them) = (
        (min(float(line[2]) for line in pair), int(pair[0][3])) for pair in cells
    )
    assert most <= in_memory + _MB_A_REGION * all_of_them, printed
    assert most <= least + _PHASE_MB + _MB_A_REGION * (all_of_them - some), printed
    assert float(printed.split()[-1]) <= _LARGEST_EXPONENT, printed
