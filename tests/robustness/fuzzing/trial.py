# SPDX-License-Identifier: MIT
"""Trial: one file given to one reader, and what came of it."""

from __future__ import annotations

import os
import re
import stat
import sys
import tempfile
import traceback
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from scenes.checks import InputError
from scenes.io.meshes import ifc_geometry
from tests.robustness.fuzzing.case import Case
from tests.robustness.fuzzing.invariants import BrokenInvariantError
from tests.robustness.fuzzing.targets import Target

_RESULTS = os.path.join(tempfile.gettempdir(), "unseen-ifc-")  # of the program that meshes IFC
_ELSEWHERE = tuple(
    {sys.prefix, sys.base_prefix, "/proc", "/sys", "/dev", str(Path(np.__file__).parents[1]), _RESULTS}
)
_SOURCES = str(Path(__file__).resolve().parents[3])
_FORBIDDEN = (
    "os.system",
    "subprocess.Popen",
    "socket.connect",
    "pickle.find_class",
    "os.exec",
    "os.posix_spawn",
)


@dataclass(frozen=True)
class Outcome:
    """What came of a file.

    Attributes
    ----------
    kind : str
        "read" or "refused", or what is against the promise: "outside the promise", "broken invariant",
        "unclear message", "opened elsewhere", "noise"; the supervision adds "crash", "hang", "memory".
    text : str
        The message, or what was wrong.
    place : str
        Where in the code, by which findings are told apart.
    """

    kind: str
    text: str = ""
    place: str = ""

    @property
    def is_finding(self) -> bool:
        """Whether the promise is broken."""
        return self.kind not in ("read", "refused")


class Watch:
    """Sees which files are opened and what is warned of while a file is read."""

    def __init__(self) -> None:
        self.folder = ""
        self.seen: list[str] = []
        self.printed = _printed_bytes()
        sys.addaudithook(self._hear)

    def _hear(self, event: str, arguments: tuple[Any, ...]) -> None:
        if not self.folder:
            return
        if event == "subprocess.Popen" and ifc_geometry.__file__ in arguments[1]:
            return
        if event in _FORBIDDEN:
            self.seen.append(f"{event} {arguments[:1]!r}"[:200])
        elif event == "open" and isinstance(arguments[0], str | bytes):
            path = os.path.abspath(os.fsdecode(arguments[0]))
            if not path.startswith((self.folder, *_ELSEWHERE)) and not path.endswith(
                (".py", ".pyc", ".pyi", ".nbi", ".nbc")
            ):
                self.seen.append(path)

    @contextmanager
    def within(self, folder: Path) -> Iterator[list[str]]:
        """Watch while only files in `folder` may be opened."""
        self.seen, self.folder = [], f"{folder.resolve()}{os.sep}input"
        try:
            yield self.seen
        finally:
            self.folder = ""


def attempt(target: Target, case: Case, folder: Path, watch: Watch | None = None) -> Outcome:
    """Write the case, let the reader read it, and judge."""
    path = case.write(folder)
    if watch is None:
        return judge(target, path)
    with watch.within(folder) as opened:
        outcome = judge(target, path)
    before, watch.printed = watch.printed, _printed_bytes()
    if watch.printed > before and not outcome.is_finding:
        return Outcome("noise", "libraries print to the standard error", "standard error")
    if opened and not outcome.is_finding:
        return Outcome("opened elsewhere", opened[0], re.sub(r"\d+", "#", opened[0])[-60:])
    return outcome


def _printed_bytes() -> int:
    """How much libraries have printed, where the standard error is a file."""
    state = os.fstat(2)
    return state.st_size if stat.S_ISREG(state.st_mode) else 0


def judge(target: Target, path: Path) -> Outcome:
    """Let the reader read a path."""
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        warnings.simplefilter("ignore", DeprecationWarning)  # which Python shows to developers alone
        try:
            target.read(path)
        except InputError as error:
            outcome = _judge_message(error, path)
        except BrokenInvariantError as error:
            outcome = Outcome("broken invariant", str(error), str(error))
        except MemoryError as error:
            outcome = Outcome("memory", repr(error)[:300], _place(error))
        except BaseException as error:
            outcome = Outcome("outside the promise", f"{type(error).__name__}: {error}"[:300], _place(error))
        else:
            outcome = Outcome("read")
    if heard and not outcome.is_finding:
        first = heard[0]
        where = f"{Path(first.filename).name}:{first.lineno}"
        return Outcome("noise", f"{first.category.__name__}: {first.message} ({where})"[:300], where)
    return outcome


def _judge_message(error: InputError, path: Path) -> Outcome:
    """One printable line that names the file, and no want of memory."""
    text = str(error)
    if isinstance(error.__cause__, MemoryError):
        return Outcome("memory", text[:300], _place(error.__cause__))
    if path.name not in text:
        return Outcome("unclear message", f"does not name the file: {text}"[:300], _place(error))
    if not text.isprintable() or len(text) > 1500:
        return Outcome("unclear message", f"not one line: {text!r}"[:300], _place(error))
    return Outcome("refused", text)


def _place(error: BaseException) -> str:
    """Innermost line of the project, and the innermost of all."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [
        frame
        for frame in frames
        if frame.filename.startswith(_SOURCES)
        and "/tests/" not in frame.filename
        and "/.venv/" not in frame.filename
    ]
    spots = [f"{Path(frame.filename).name}:{frame.lineno}" for frame in (*own[-1:], *frames[-1:])]
    return f"{type(error).__name__} at {' < '.join(dict.fromkeys(reversed(spots)))}"
