# SPDX-License-Identifier: MIT
"""What is spilled is what was given; memory is given back and nothing is lost."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pytest

from scenes.run import mapping
from scenes.run.mapping import NoSpill, Spill, is_mapped, trim

LARGE = np.arange(50_000, dtype=np.float64)


class Pair(NamedTuple):
    first: object
    second: object


@dataclass(frozen=True, slots=True)
class Held:
    array: object
    name: str


def test_values_are_equal_and_their_large_arrays_on_disk():
    kept = Spill().keep([Pair(LARGE, 1), Held(LARGE.reshape(100, 500), "a"), (np.arange(3), None)])
    assert isinstance(kept[0], Pair)
    assert isinstance(kept[1], Held)
    for array, expected in ((kept[0].first, LARGE), (kept[1].array, LARGE.reshape(100, 500))):
        assert is_mapped(array)
        np.testing.assert_array_equal(array, expected)
    assert (kept[0].second, kept[1].name, kept[2][1]) == (1, "a", None)
    assert not is_mapped(kept[2][0])


def test_what_holds_nothing_large_stays_itself():
    small = Held(np.arange(10), "a")
    assert Spill().keep(small) is small
    assert NoSpill().keep(LARGE) is LARGE


def test_arrays_smaller_than_a_page_are_on_disk_side_by_side():
    arrays = [np.full(n, n, dtype=np.int32) for n in range(200, 260)]
    kept = Spill().keep(arrays)
    first, *_, last = (one.__array_interface__["data"][0] for one in kept)
    assert all(map(is_mapped, kept))
    assert 0 < last - first < 2 * sum(one.nbytes for one in arrays)
    for array, expected in zip(kept, arrays, strict=True):
        np.testing.assert_array_equal(array, expected)


def test_arrays_of_objects_stay_in_memory():
    names = np.array(["wall", None] * 500, dtype=object)
    assert Spill().keep(names) is names


def test_an_array_on_disk_stays_where_it_is():
    spill = Spill()
    once = spill.keep(Held(LARGE, "a"))
    assert spill.keep(once) is once


@pytest.mark.parametrize("writeable", [True, False])
def test_arrays_are_as_writeable_as_they_were(writeable):
    array = LARGE.copy()
    array.setflags(write=writeable)
    assert Spill().keep(array).flags.writeable == writeable


def test_many_arrays_do_not_run_into_one_another():
    spill, rng = Spill(), np.random.default_rng(0)
    arrays = [rng.random(int(n)) for n in rng.integers(2_000, 1_000_000, 60)]
    kept = [spill.keep(array) for array in arrays]
    for array, expected in zip(kept, arrays, strict=True):
        np.testing.assert_array_equal(array, expected)


@pytest.mark.parametrize("kind", [np.int8, np.float32, np.bool_])
def test_types_and_orders_are_kept(kind):
    array = np.asfortranarray(np.arange(90_000).reshape(300, 300).astype(kind))
    kept = Spill().keep(array)
    assert kept.dtype == kind
    np.testing.assert_array_equal(kept, array)


def test_numbers_are_there_after_memory_was_given_back(monkeypatch):
    monkeypatch.setattr(mapping, "_PAUSE_S", 0.0)
    monkeypatch.setattr(mapping, "_RESIDENT", -(10**12))
    kept = Spill().keep(LARGE)
    trim()
    np.testing.assert_array_equal(kept, LARGE)
