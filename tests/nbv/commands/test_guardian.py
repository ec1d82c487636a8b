# SPDX-License-Identifier: MIT
"""Guardian: exits, signals and standard streams are the command's own; a fault becomes one line."""

import os
import signal
import subprocess
import sys
import textwrap
import time

import pytest

from nbv.commands.process.guardian import epitaph
from tests.helpers.data_paths import ROOT

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="forks on Linux alone")


def start(code, *arguments, **more):
    """Start a Python that guards a command given as lines of code."""
    body = textwrap.indent(textwrap.dedent(code).strip(), "    ")
    head = "import os, signal, sys, time\nfrom nbv.commands.process.guardian import guarded\ndef command():\n"
    script = f"{head}{body}\nguarded(command)\n"
    streams = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.Popen([sys.executable, "-c", script, *arguments], env=environment, **streams, **more)


def ended(process, said=""):
    """Return exit code, standard output and standard error."""
    out, error = process.communicate(said, timeout=30)
    return process.returncode, out, error


@pytest.mark.parametrize("code", [0, 1, 2, 130])
def test_it_exits_as_the_command_does(code):
    assert ended(start(f"sys.exit({code})")) == (code, "", "")


def test_streams_are_the_commands_own():
    code = 'print(input(), flush=True); print("told", file=sys.stderr)'
    assert ended(start(code), "read\n") == (0, "read\n", "told\n")


def test_what_native_code_says_comes_at_the_end_unless_the_command_failed():
    code = 'os.write(2, b"native\\n"); print("own", file=sys.stderr); sys.exit(int(sys.argv[1]))'
    assert ended(start(code, "0")) == (0, "", "own\nnative\n")
    assert ended(start(code, "1")) == (1, "", "own\n")


@pytest.mark.parametrize("name", ["SIGSEGV", "SIGABRT", "SIGBUS", "SIGILL", "SIGFPE", "SIGKILL"])
def test_a_fault_is_one_line_and_exit_code_1(name):
    code = f'os.write(2, b"LLVM ERROR: out of memory\\n"); os.kill(os.getpid(), signal.{name})'
    exit_code, out, error = ended(start(code, "plan"))
    assert (exit_code, out) == (1, "")
    why = "the system ran out of memory, most likely" if name == "SIGKILL" else "a fault in a native library"
    assert error.startswith(f"unseen plan: ended by {name}: {why}")
    assert error.endswith("(LLVM ERROR: out of memory); files written before are whole\n")
    assert error.count("\n") == 1


def test_under_a_limit_a_fault_is_taken_for_want_of_memory():
    assert "not enough memory within the limit" in epitaph("SIGABRT", ["unseen", "plan"], b"", True)
    error = ended(start("os.abort()", "scan", "--max-memory=1GB"))[2]
    assert error == (
        "unseen scan: ended by SIGABRT: not enough memory within the limit of this process, most likely; "
        "files written before are whole\n"
    )


SLEEPS = """
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(7))
    print(os.getpid(), flush=True)
    time.sleep(30)
"""


def test_a_signal_that_a_process_sends_is_passed_on():
    process = start(SLEEPS)
    process.stdout.readline()
    process.send_signal(signal.SIGTERM)
    assert ended(process)[0] == 7


def test_a_signal_without_a_handler_ends_both_by_it():
    process = start('signal.signal(signal.SIGHUP, signal.SIG_DFL); print("here", flush=True); time.sleep(30)')
    process.stdout.readline()
    process.send_signal(signal.SIGHUP)
    assert ended(process)[0] == -signal.SIGHUP


def test_a_signal_to_the_whole_group_reaches_the_command_once():
    process = start(
        """
        times = []
        signal.signal(signal.SIGTERM, lambda *_: times.append(time.monotonic()))
        print("here", flush=True)
        while not times:
            time.sleep(0.01)
        sys.exit(0)
        """,
        start_new_session=True,
    )
    process.stdout.readline()
    os.killpg(process.pid, signal.SIGTERM)
    assert ended(process)[0] == 0


def test_when_the_guardian_is_killed_the_command_dies_with_it():
    process = start(SLEEPS)
    child = int(process.stdout.readline())
    process.kill()
    process.wait()
    until = time.monotonic() + 5
    while _runs(child) and time.monotonic() < until:
        time.sleep(0.01)
    assert not _runs(child)
    process.communicate()


def _runs(pid):
    """Whether a process is there and no zombie."""
    try:
        with open(f"/proc/{pid}/stat") as file:
            return file.read().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False
