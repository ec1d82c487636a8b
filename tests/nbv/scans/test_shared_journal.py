# SPDX-License-Identifier: MIT
"""Shared journal: each step is done by one of several, whoever dies."""

import threading
from collections import Counter

import pytest

from nbv.scans import remote_completion
from nbv.scans.remote_completion import Claims, SharedJournal, let_go, stage_of
from scenes.checks import InputError
from scenes.run.journal import NO_JOURNAL, FileJournal


@pytest.fixture
def folder(tmp_path):
    journal = FileJournal(tmp_path / "journal", "key")
    journal.part("first")
    with Claims.allow(journal.folder):
        yield journal.folder


def test_each_of_many_steps_is_done_once_and_all_come_to_the_same(folder):
    done, ends = Counter(), {}

    def run(number):
        claims = Claims(folder, number)
        journal = SharedJournal(folder, "key", claims)
        with claims.keep_alive():

            def work(name):
                done[name] += 1
                return name

            for part in (journal, journal.part("first")):
                names = [f"{part.folder.name}-{k:04d}" for k in range(20)]
                for k in part.turn(20):
                    part.offer(names[k], lambda name=names[k]: work(name))
                ends[number, part.folder.name] = [
                    part.step(name, lambda: pytest.fail("done")) for name in names
                ]
            ends[number, "one"] = journal.step("one", lambda: work("one"))

    threads = [threading.Thread(target=run, args=(number,)) for number in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(ends) == 9
    assert set(done.values()) == {1}
    assert len(done) == 41
    assert ends[2, "one"] == "one"
    assert all(ends[number, "first"] == [f"first-{k:04d}" for k in range(20)] for number in range(3))


def test_orders_differ_and_leave_nothing_out(folder):
    turns = [SharedJournal(folder, "key", Claims(folder, number)).turn(10) for number in range(3)]
    assert [turn[0] for turn in turns] == [0, 6, 2]
    assert all(sorted(turn) == list(range(10)) for turn in turns)
    assert list(FileJournal(folder, "key").turn(10)) == list(NO_JOURNAL.turn(10)) == []


def test_a_claim_is_respected_let_go_and_taken_over_from_the_silent(folder, monkeypatch):
    one, other = Claims(folder, 1), Claims(folder, 2)
    with one.keep_alive():
        assert one.take("a")
        assert not other.take("a")
        SharedJournal(folder, "key", other).offer("a", lambda: pytest.fail("claimed"))
        one.release("a")
        assert other.take("a")
        assert one.take("b")
        let_go(folder, 2)
        assert one.take("a")
    with Claims(folder, 1).keep_alive():  # the same one, back from the dead
        assert other.take("b")
    assert Claims(folder, 3).take("c")  # and never beats
    assert not other.take("c")
    monkeypatch.setattr(remote_completion, "_SILENT_S", -1.0)
    assert other.take("c")


def test_a_step_that_fails_is_free_again(folder):
    journal = SharedJournal(folder, "key", Claims(folder, 1))
    with pytest.raises(ZeroDivisionError):
        journal.offer("a", lambda: 1 / 0)
    assert SharedJournal(folder, "key", Claims(folder, 2)).step("a", lambda: 3) == 3


def test_a_run_that_was_called_off_takes_no_more_steps(tmp_path):
    journal = FileJournal(tmp_path / "journal", "key")
    with Claims.allow(journal.folder):
        shared = SharedJournal(journal.folder, "key", Claims(journal.folder, 1))
    with pytest.raises(InputError, match="called off"):
        shared.step("a", lambda: 1)


def test_a_worker_that_sees_another_folder_says_so(folder, tmp_path):
    for place, key in ((tmp_path / "elsewhere", "key"), (folder, "another")):
        with pytest.raises(InputError, match="under the same path, on a disk"):
            SharedJournal(place, key, Claims(folder, 1))


def test_what_a_worker_of_an_earlier_run_comes_to_is_not_kept(folder):
    shared = SharedJournal(folder, "key", Claims(folder, 1))

    def work():
        FileJournal(folder, "another")
        return 1

    with pytest.raises(InputError, match="another run"):
        shared.step("a", work)
    assert FileJournal(folder, "another").step("a", lambda: 2) == 2


def test_how_far_the_workers_are(folder):
    assert stage_of(folder) is None
    claims = Claims(folder, 1)
    claims.tell("extend", 7)
    SharedJournal(folder, "key", claims).offer("extend-0003", lambda: 1)
    assert stage_of(folder) == ("extend", 1, 7)
