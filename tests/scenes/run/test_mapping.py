# SPDX-License-Identifier: MIT
"""Large arrays are in a file without a name: what they hold, what memory holds of them, and a full disk."""

from __future__ import annotations

import errno
import io
import os
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from scenes.checks import InputError
from scenes.run import mapping
from scenes.run.atomic import Stage
from scenes.run.mapping import LARGE, allocate, fill_from, is_mapped, mapped_in, release

ON_LINUX = pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")


@pytest.mark.parametrize("fill", [0, 7, np.nan, np.inf])
@pytest.mark.parametrize("shape", [(3, 4), (1, LARGE), (1, LARGE + 1), (1025, 513, 3)])
def test_an_array_is_full_of_what_was_asked_for(shape, fill):
    found = allocate(shape, np.float32, fill)
    np.testing.assert_array_equal(found, np.full(shape, fill, np.float32))
    assert (found.flags.writeable, found.flags.c_contiguous) == (True, True)
    assert is_mapped(found) == (shape[0] * shape[1] > LARGE)


def test_views_are_mapped_and_copies_are_not():
    held = allocate((1000, 1000), np.uint8)
    assert all(map(is_mapped, (held[3:], held.reshape(-1), held.T)))
    assert not any(map(is_mapped, (held.copy(), None, np.zeros(3), 1.0)))


@ON_LINUX
def test_what_is_released_leaves_memory_and_comes_back():
    held = allocate((2000, 1000), np.float64)
    held[:] = np.arange(1000)
    before = _shared_bytes()
    release(held[5:], None, np.zeros(3))
    assert _shared_bytes() < before - 0.9 * held.nbytes
    np.testing.assert_array_equal(held[1999], np.arange(1000))


def _shared_bytes() -> int:
    return int(Path("/proc/self/statm").read_text().split()[2]) * os.sysconf("SC_PAGE_SIZE")


def test_threads_share_an_array_while_others_release_it():
    held = allocate((1000, 1000), np.int64)

    def write(row: int) -> None:
        held[row] = row
        release(held)

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(write, range(1000)))
    np.testing.assert_array_equal(held[:, 0], np.arange(1000))
    np.testing.assert_array_equal(held[:, -1], np.arange(1000))


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_forked_process_sees_the_same_array():
    held = allocate((1000, 1000), np.uint8)
    child = os.fork()
    if not child:
        held[0, 0] = 5
        os._exit(0)
    os.waitpid(child, 0)
    assert held[0, 0] == 5


def test_a_stream_that_ends_before_is_told_by_the_number_of_bytes():
    small, large = np.zeros(3, np.int16), allocate((1000, 1000), np.int16)
    assert fill_from(small, io.BytesIO(b"\1\0\2\0")) == 4
    assert small.tolist() == [1, 2, 0]
    data = np.arange(10**6).astype(np.int16).tobytes()
    assert fill_from(large, io.BytesIO(data)) == len(data)
    assert large.tobytes() == data
    assert fill_from(np.zeros((0, 3)), io.BytesIO(b"more")) == 0


def test_arrays_of_a_run_are_where_its_output_is_staged(tmp_path, monkeypatch):
    asked = []
    made = mapping.tempfile.TemporaryFile
    monkeypatch.setattr(
        mapping.tempfile, "TemporaryFile", lambda **about: asked.append(about["dir"]) or made(**about)
    )
    with Stage(tmp_path) as stage:
        held = allocate((1000, 1000), np.uint8)
        assert list(stage.folder.iterdir()) == []
        stage.commit()
        allocate((1000, 1000), np.uint8)  # the stage is gone
    with mapped_in(tmp_path):
        allocate((1000, 1000), np.uint8)
    assert asked == [stage.folder, Path(mapping.tempfile.gettempdir()), tmp_path]
    held[:] = 1  # stays when its folder has gone
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_is_told_before_a_number_is_written(tmp_path, monkeypatch):
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "posix_fallocate", full, raising=False)
    text = (
        rf"{tmp_path}: no room for 8 MB of a scan's pixels: No space left.*; free some, or write the output"
    )
    with mapped_in(tmp_path), pytest.raises(InputError, match=text):
        allocate((1000, 1000), np.float64)


def test_room_is_taken_by_zeros_where_the_system_cannot_reserve_it(monkeypatch):
    monkeypatch.delattr(os, "posix_fallocate", raising=False)
    assert not allocate((1000, 1100, 3), np.uint8).any()


def test_a_system_that_takes_back_by_itself_is_left_alone(monkeypatch):
    monkeypatch.delattr(mapping.mmap, "MADV_DONTNEED", raising=False)
    held = allocate((1000, 1000), np.uint8, 3)
    release(held)
    assert held.all()


@ON_LINUX
def test_nothing_is_left_of_a_run_that_was_killed(tmp_path):
    code = (
        "import os, signal, sys, numpy as np\nfrom pathlib import Path\n"
        "from scenes.run.mapping import allocate, mapped_in\n"
        "with mapped_in(Path(sys.argv[1])):\n"
        "    allocate((1000, 1000), np.float64, 1)\n    os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    run = subprocess.run([sys.executable, "-c", code, str(tmp_path)], check=False)
    assert run.returncode == -signal.SIGKILL
    assert list(tmp_path.iterdir()) == []
