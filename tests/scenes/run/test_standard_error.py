# SPDX-License-Identifier: MIT
"""What libraries print behind Python's back is dropped, and nothing else."""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import pytest

from scenes.io.clouds.las_header import libraries_muted
from tests.helpers.data_paths import ROOT


def test_what_a_library_prints_is_dropped_and_what_comes_after_is_not(capfd):
    def stumble() -> None:
        with libraries_muted():
            os.write(2, b"thread '<unnamed>' panicked\n")
            raise ZeroDivisionError

    sys.stderr.write("before\n")
    with pytest.raises(ZeroDivisionError):
        stumble()
    os.write(2, b"after\n")
    assert capfd.readouterr().err == "before\nafter\n"


def test_threads_leave_the_standard_error_as_it_was(capfd):
    def work(_number: int) -> None:
        with libraries_muted():
            os.write(2, b"noise\n")

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(work, range(200)))
    os.write(2, b"after\n")
    assert capfd.readouterr().err == "after\n"


def test_without_a_standard_error_there_is_nothing_to_mute():
    code = "import os; os.close(2)\nfrom scenes.io.clouds.las_header import libraries_muted\n"
    code += "with libraries_muted(): print('ran')\n"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout == "ran\n"
