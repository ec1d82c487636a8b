# SPDX-License-Identifier: MIT
"""Guardian: a small process that waits for the command, and says in one line what killed it.

Where memory is limited, native libraries may end a process at once: OpenBLAS, LLVM and the C++ runtime abort
when an allocation fails, and the kernel kills what the machine has no memory for. No `except` sees that;
another process does. It is forked before anything large is imported, so that it costs a few milliseconds.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
from collections.abc import Callable, Sequence

from nbv.commands.process.starvation import is_limited

_SET_DEATH_SIGNAL = 1  # PR_SET_PDEATHSIG of prctl(2)
_GRACE_S = 0.2  # in which a child that got a signal itself ends, so that it need not be passed on
_FAULTS = ("SIGSEGV", "SIGABRT", "SIGBUS", "SIGILL", "SIGFPE", "SIGTRAP", "SIGSYS", "SIGKILL")
_LAST_WORDS = 120  # characters


def guarded(command: Callable[[], None]) -> None:
    """Run `command` in a child process and exit as it exits; on other systems than Linux run it here.

    Signals sent to this process alone are passed on, and when it is killed the child dies with it. What
    native libraries write to standard error appears at the end; after a failure only the command's own line
    does. A child that dies of a fault becomes one line and exit code 1.

    Parameters
    ----------
    command : callable
        Reads its arguments from the command line; returns, or raises `SystemExit`.
    """
    if not sys.platform.startswith("linux"):
        command()
        return
    noise, parent = os.memfd_create("standard error of native libraries"), os.getpid()
    watched = {signal.SIGCHLD, signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT}
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)  # whoever started us may ignore it, and then none can wait
    before = signal.pthread_sigmask(signal.SIG_BLOCK, watched)
    child = os.fork()
    if child == 0:
        _prepare(parent, noise)
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        command()
        return
    status = _wait_for(child, watched)
    signal.pthread_sigmask(signal.SIG_SETMASK, before)
    _exit_like(status, os.pread(noise, os.fstat(noise).st_size, 0))


def _prepare(parent: int, noise: int) -> None:
    """Tie this process to its parent, and part what native libraries write to standard error from our own."""
    ctypes.CDLL(None).prctl(_SET_DEATH_SIGNAL, signal.SIGKILL)
    if os.getppid() != parent:
        os._exit(1)
    if sys.stderr is not None:
        own = os.fdopen(os.dup(2), "w", buffering=1, encoding=sys.stderr.encoding, errors=sys.stderr.errors)
        sys.stderr = own
        os.dup2(noise, 2)


def _wait_for(child: int, watched: set[signal.Signals]) -> int:
    """Return the wait status of `child`; meanwhile pass on what signals are sent to this process.

    Those of a terminal reach both. So do those sent to a process group: they are passed on only to a child
    that does not end by itself.
    """
    while True:
        found = signal.sigwaitinfo(watched)
        if found.si_signo != signal.SIGCHLD:
            if found.si_code > 0:  # from the kernel, not from a process
                continue
            signal.sigtimedwait({signal.SIGCHLD}, _GRACE_S)
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return status
        if found.si_signo != signal.SIGCHLD:
            os.kill(child, found.si_signo)


def _exit_like(status: int, noise: bytes) -> None:
    """End as a child with this wait status ended; one that a fault has killed, in one line."""
    code = os.waitstatus_to_exitcode(status)
    if code >= 0:
        if code != 1:
            os.write(2, noise)
        sys.exit(code)
    name = signal.Signals(-code).name
    if name in _FAULTS:
        os.write(2, f"{epitaph(name, sys.argv, noise, is_limited(sys.argv))}\n".encode())
        sys.exit(1)
    signal.signal(-code, signal.SIG_DFL)
    os.kill(os.getpid(), -code)


def epitaph(name: str, arguments: Sequence[str], noise: bytes, is_limited: bool) -> str:
    """Return the line that says what killed a command.

    Parameters
    ----------
    name : str
        Of the signal.
    arguments : sequence of str
        The program and its arguments.
    noise : bytes
        What native libraries wrote to standard error; their last line is quoted.
    is_limited : bool
        Whether there is a limit on the memory of the process.

    Examples
    --------
    >>> epitaph("SIGKILL", ["unseen", "plan", "room.glb"], b"", is_limited=False)
    'unseen plan: ended by SIGKILL: the system ran out of memory, most likely; files written before are whole'
    """
    said = [line.strip() for line in noise.decode(errors="replace").splitlines() if line.strip()]
    words = f" ({said[-1][:_LAST_WORDS]})" if said else ""
    why = "a fault in a native library; please report it with its input"
    if name == "SIGKILL":
        why = "the system ran out of memory, most likely"
    elif is_limited:
        why = "not enough memory within the limit of this process, most likely"
    return f"{title_of(arguments)}: ended by {name}: {why}{words}; files written before are whole"


def title_of(arguments: Sequence[str]) -> str:
    """Return the program and its command, as lines on standard error begin."""
    return " ".join(["unseen", *[one for one in arguments[1:2] if not one.startswith("-")]])
