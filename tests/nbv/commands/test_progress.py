# SPDX-License-Identifier: MIT
"""Progress: a total of all stages that never falls, and lines where there is no terminal."""

import io
import json
import os
import re
import subprocess
import sys
import time

import pytest
from typer.testing import CliRunner

from nbv.cli import COMMANDS, app
from nbv.commands.progress import STAGES, Standing, shown_progress
from nbv.run.manifest import Stopwatch
from tests.helpers.data_paths import ROOT

ROOM = "builtin:two_occluders"


def test_the_total_counts_all_stages_and_never_falls():
    standing = Standing(("load", "pairs", "save", "report"))
    totals = []
    for entered in (("load",), ("pairs", 1, 4), ("pairs", 3, 4), ("inner", 1, 2), ("save",), ("pairs", 1, 4)):
        standing.enter(*entered)
        totals.append(standing.stages_done)
    assert totals == [0, 1.25, 1.75, 1.75, 2, 2]
    assert standing.describe() == "pairs, 1 of 4; stage 3 of 4"
    assert Standing(()).describe() == "start"


def test_stages_are_those_of_commands_and_named_once():
    assert set(STAGES) <= set(COMMANDS)
    assert [name for name, stages in STAGES.items() if len(set(stages)) < len(stages)] == []


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("progress")
    (folder / "small.toml").write_text('kind = "pinhole"\nfov_deg = 70.0\nwidth = 72\nheight = 72\n')
    words = ("--sensor", folder / "small.toml", "--at", "1,1,1.6", "--look", "3,3,1", "-o", folder / "a.npz")
    assert CliRunner().invoke(app, ["scan", ROOM, "-q", *map(str, words)]).exit_code == 0
    return folder


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ("complete", ("a.npz", "--texture", "off")),
        ("register", ("a.npz", "a.npz")),
        ("coverage", ("--scans", "a.npz")),
    ],
)
def test_the_stages_of_a_run_are_known_and_in_order(command, words, folder, monkeypatch):
    monkeypatch.chdir(folder)
    result = CliRunner().invoke(app, [command, *words, "-q", "-o", command])
    assert result.exit_code == 0, result.output
    stages = list(json.loads((folder / command / "manifest.json").read_text())["times"]["stages_s"])
    assert stages == sorted(stages, key=STAGES[command].index)


def test_without_a_terminal_a_line_tells_the_stage_from_time_to_time(monkeypatch):
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    watch = Stopwatch()
    with shown_progress("complete", watch, hidden=False, seconds=0.01) as tell:
        tell("segment", 2, 9)
        wait_for("segment, 2 of 9", sys.stderr)
        watch.enter("report")
        wait_for("report", sys.stderr)
    lines = sys.stderr.getvalue().splitlines()
    n = len(STAGES["complete"])
    assert f"unseen complete: 0 min: segment, 2 of 9; stage 5 of {n}" in lines
    assert lines[-1] == f"unseen complete: 0 min: report; stage {n} of {n}"
    time.sleep(0.05)
    assert len(sys.stderr.getvalue().splitlines()) <= len(lines) + 1


def wait_for(text, stream):
    end = time.monotonic() + 20
    while text not in stream.getvalue():
        assert time.monotonic() < end, stream.getvalue()
        time.sleep(0.01)


def test_hidden_progress_writes_nothing(monkeypatch):
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    watch = Stopwatch()
    with shown_progress("complete", watch, hidden=True, seconds=0.01) as tell:
        tell("segment", 2, 9)
        time.sleep(0.05)
    assert sys.stderr.getvalue() == ""
    assert "segment" in watch.record()["stages_s"]


PROGRAM = """
import time
from nbv.commands.progress import shown_progress
from nbv.run.manifest import Stopwatch
watch = Stopwatch()
with shown_progress("register", watch, hidden=False) as tell:
    watch.enter("load")
    tell("pairs", 1, 2)
    time.sleep(0.3)
    watch.enter("report")
    time.sleep(0.3)
"""


def test_a_terminal_shows_a_bar_of_all_stages():
    pty = pytest.importorskip("pty")
    ours, theirs = pty.openpty()
    with subprocess.Popen(
        [sys.executable, "-c", PROGRAM],
        cwd=ROOT,
        stderr=theirs,
        env=os.environ | {"TERM": "xterm", "COLUMNS": "90"},
    ) as process:
        os.close(theirs)
        drawn = b""
        try:
            while piece := os.read(ours, 4096):
                drawn += piece
        except OSError:  # the other end is closed
            pass
        assert process.wait() == 0
    os.close(ours)
    text = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", drawn.decode())
    shares = [int(share) for share in re.findall(r"all stages.*?(\d+)/100", text)]
    n = len(STAGES["register"])
    assert int(100 * (STAGES["register"].index("pairs") + 0.5) / n) in shares
    assert shares[-1] == int(100 * (n - 1) / n)
    assert re.search(r"pairs .*1/2", text)
