# SPDX-License-Identifier: MIT
"""Remote completion: workers come to the bytes of one process, whoever of them dies."""

import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import pytest
from typer.testing import CliRunner

from completion.options import CompletionOptions
from completion.pipeline import complete, complete_first
from nbv.cli import app
from nbv.run.workers import DaskWorkers, WorkerShare, cluster
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor, View
from nbv.scans import remote_completion
from nbv.scans.remote_completion import Claims, CompletionTask
from scenes.checks import InputError
from scenes.io.scan_files import write_scan
from scenes.io.scan_request import ScanRequest, read_request
from scenes.pose import Pose
from scenes.run.journal import NO_JOURNAL, FileJournal
from scenes.world.builtin import builtin_scene

LOOKS = (((5.0, 1.5, 1.4), (2.0, 2.0, 0.6)), ((1.0, 4.4, 1.5), (3.0, 2.0, 0.6)))
PLAIN = CompletionOptions(texture=False)


@pytest.fixture(scope="module")
def scans(tmp_path_factory):
    """Two scans of a room, as files."""
    folder, room = tmp_path_factory.mktemp("scans"), builtin_scene("two_occluders")
    for number, (eye, target) in enumerate(LOOKS):
        view = View(Pose.looking_at(eye, target), PinholeSensor(fov_deg=70, width=64, height=48))
        write_scan(scan_scene(room, view, noise="gaussian-2mm", rng=0), folder / f"{number}.npz")
    return [str(folder / f"{number}.npz") for number in range(len(LOOKS))]


def contents(folder):
    """Digests of all files, but the manifest, which holds times."""
    files = (file for file in folder.rglob("*") if file.is_file() and file.name != "manifest.json")
    return {file.name: sha256(file.read_bytes()).hexdigest() for file in files}


def completed(scans, out, *options):
    return CliRunner().invoke(app, ["complete", *scans, "-q", "-o", str(out), *options])


@pytest.fixture(scope="module")
def alone(scans, tmp_path_factory):
    """What one process writes."""
    out = tmp_path_factory.mktemp("alone")
    assert completed(scans, out).exit_code == 0
    return contents(out)


def task_of(scans, folder, **how):
    return CompletionTask(
        scans=ScanRequest(tuple(scans)),
        sizes=(),
        options=PLAIN,
        seed=0,
        journal=str(folder),
        key="key",
        **how,
    )


def test_what_a_worker_does_is_all_that_a_completion_takes(scans, tmp_path, monkeypatch):
    journal = FileJournal(tmp_path, "key")
    first = journal.part("first")
    with Claims.allow(tmp_path):
        assert task_of(scans, tmp_path, scratch=str(tmp_path)).work(WorkerShare(1, 1)) == ""
    done = {file.relative_to(tmp_path) for file in tmp_path.rglob("*.npz")}
    given = read_request(ScanRequest(tuple(scans))).scans
    monkeypatch.setattr(FileJournal, "step", known_alone(FileJournal.step))
    found = complete(given, PLAIN, rng=0, journal=journal)
    assert complete_first(found, PLAIN, journal=first).patches
    assert {file.relative_to(tmp_path) for file in tmp_path.rglob("*.npz")} == done
    monkeypatch.undo()
    assert found.hypothesised_m2 == complete(given, PLAIN, rng=0).hypothesised_m2


def known_alone(step):
    """A journal's step that must be known."""
    return lambda journal, name, _work: step(journal, name, lambda: pytest.fail(f"{name} is not known"))


def test_a_worker_that_sees_other_files_or_none_says_so(scans, tmp_path):
    FileJournal(tmp_path, "key").part("first")
    with Claims.allow(tmp_path):
        task = task_of(scans, tmp_path)
        with pytest.raises(InputError, match=r"0\.npz: a worker does not see this file as it is here"):
            replace(task, sizes=((scans[0], 3),)).work(WorkerShare(0, 1))
        with pytest.raises(InputError, match="a worker does not find the run's journal"):
            replace(task, journal=str(tmp_path / "elsewhere")).work(WorkerShare(0, 1))


def test_a_worker_without_memory_says_so(scans, tmp_path, monkeypatch):
    def full(*_, **__):
        raise MemoryError

    FileJournal(tmp_path, "key").part("first")
    monkeypatch.setattr(remote_completion, "complete", full)
    with Claims.allow(tmp_path):
        assert "not enough memory" in task_of(scans, tmp_path).work(WorkerShare(0, 1))


def test_an_address_where_nobody_answers_is_one_line(scans, tmp_path, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("nbv.run.workers._WAIT_S", 0.5)
    result = completed(scans, tmp_path, "--scheduler", "tcp://127.0.0.1:9")
    assert result.exit_code == 1
    assert len(result.stderr.splitlines()) == 1
    assert "no scheduler answers there" in result.stderr


@pytest.mark.long
def test_workers_share_the_work(scans, tmp_path):
    """Workers as threads of this process, each with a journal of its own."""
    journal = FileJournal(tmp_path, "key")
    journal.part("first")
    with Claims.allow(tmp_path), ThreadPoolExecutor(2) as pool:
        assert list(pool.map(task_of(scans, tmp_path).work, [WorkerShare(0, 1), WorkerShare(1, 1)])) == [
            "",
            "",
        ]
    given = read_request(ScanRequest(tuple(scans))).scans
    found, wanted = (complete(given, PLAIN, rng=0, journal=one) for one in (journal, NO_JOURNAL))
    assert found.hypothesised.vertices.tobytes() == wanted.hypothesised.vertices.tobytes()
    assert found.hypothesised.faces.tobytes() == wanted.hypothesised.faces.tobytes()


@pytest.mark.long
@pytest.mark.parametrize("n_workers", [1, 2])
def test_workers_come_to_the_bytes_of_one_process(n_workers, scans, alone, tmp_path, monkeypatch):
    pytest.importorskip("distributed")
    folder = Path(scans[0]).parent
    monkeypatch.chdir(folder)
    result = completed([Path(scan).name for scan in scans], tmp_path, "--scheduler", f"local:{n_workers}")
    assert result.exit_code == 0, result.stderr
    assert contents(tmp_path) == alone
    assert not list(tmp_path.glob(".journal"))


class Assassin:
    """A cluster of which the first worker is killed once so many steps are done."""

    def __init__(self, n_steps):
        self.n_steps, self.pids = n_steps, set()

    @contextmanager
    def cluster(self, scheduler, n_threads):
        with cluster(scheduler, n_threads) as workers:
            together = workers.together

            def watched(work, *, known, lost):
                def known_and_killed():
                    n_known = known()
                    if n_known >= self.n_steps and not self.pids:
                        self.pids.add(next(iter(workers.client.run(os.getpid).values())))
                        os.kill(*self.pids, signal.SIGKILL)
                    return n_known

                together(work, known=known_and_killed, lost=lost)

            workers.together = watched
            yield workers


@pytest.mark.long
@pytest.mark.parametrize(("n_workers", "n_steps"), [(1, 4), (2, 0), (2, 12), (2, 25)])
def test_a_worker_that_is_killed_is_missed_by_nobody(n_workers, n_steps, scans, alone, tmp_path, monkeypatch):
    pytest.importorskip("distributed")
    assassin = Assassin(n_steps)
    monkeypatch.setattr(remote_completion, "cluster", assassin.cluster)
    monkeypatch.setattr("nbv.run.workers._TELL_S", 0.02)
    result = completed(scans, tmp_path, "--scheduler", f"local:{n_workers}")
    assert result.exit_code == 0, result.stderr
    assert assassin.pids
    assert contents(tmp_path) == alone


@pytest.mark.long
@pytest.mark.parametrize("again", [(), ("--scheduler", "local:2")])
def test_a_command_that_is_killed_goes_on(again, scans, alone, tmp_path):
    pytest.importorskip("distributed")
    words = ["complete", *scans, "-q", "-o", str(tmp_path), "--scheduler", "local:2"]
    process = subprocess.Popen([sys.executable, "-m", "nbv.cli", *words])
    while process.poll() is None and len(list(tmp_path.glob(".journal/*.npz"))) < 4:
        time.sleep(0.01)
    process.kill()
    assert process.wait() == -signal.SIGKILL
    assert not list(tmp_path.glob("[!.]*"))
    result = completed(scans, tmp_path, *again)
    assert result.exit_code == 0, result.stderr
    assert contents(tmp_path) == alone


def test_steps_that_kill_every_worker_are_given_up(scans, tmp_path, monkeypatch):
    """What a scheduler tells whose workers die, come again, and get nothing done."""
    lost = []

    class Task:
        status = "pending"

    class Client:
        calls = 0

        def nthreads(self):
            self.calls += 1
            return {f"tcp://a:{self.calls}": 3}

        def submit(self, *given, **how):
            share = given[2]
            assert share.n_threads == 3
            assert how["workers"] == [f"tcp://a:{self.calls}"]
            return Task()

        def cancel(self, tasks, *, force):
            assert force
            self.cancelled = len(tasks)

    monkeypatch.setattr("nbv.run.workers._TELL_S", 0.0)
    client = Client()
    with pytest.raises(InputError, match=r"11 workers died.* run the same command again"):
        DaskWorkers(client, "tcp://a", None).together(lambda _: "", known=lambda: 2, lost=lost.append)
    assert lost == list(range(11))
    assert client.cancelled == 0
