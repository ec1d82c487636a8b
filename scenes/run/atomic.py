# SPDX-License-Identifier: MIT
"""Atomic output: a file or a folder's files appear whole or not at all; what stood there survives a failure.

One run at a time writes to a folder; its files are staged, and appear together.
"""

from __future__ import annotations

import json
import math
import os
import re
import shutil
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, Self

import numpy as np

from scenes.checks import InputError
from scenes.run.mapping import mapped_in


@contextmanager
def atomic_path(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path in the same folder, with the same suffix, that replaces `path` on success.

    The temporary file is flushed to disk (fsync) before `os.replace`. When the block raises, or writes
    nothing, the temporary file is removed and `path` stays as it was. Raises InputError: the folder does not
    exist or cannot be written, `path` is a folder, or the block wrote no file.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     with atomic_path(Path(folder, "a.txt")) as temporary:
    ...         _ = temporary.write_text("whole")
    ...     Path(folder, "a.txt").read_text()
    'whole'
    """
    target = Path(path)
    if target.is_dir():
        raise InputError(f"{target}: is a folder; name a file to write")
    if not target.parent.is_dir():
        raise InputError(f"{target}: cannot write, there is no folder {target.parent}")
    temporary = target.with_name(f".{target.stem}.{os.getpid()}.tmp{target.suffix}")
    try:
        with guard_writing(target):
            yield temporary
            if not temporary.is_file():
                raise InputError(f"{target}: nothing was written")
            flush_to_disk(temporary)
            temporary.replace(target)
            flush_to_disk(target.parent)
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


@contextmanager
def guard_writing(path: Path) -> Iterator[None]:
    """Turn what the file system refuses, such as a full disk, into an InputError that names `path`."""
    try:
        yield
    except OSError as error:
        raise InputError(f"{path}: cannot write: {error.strerror or error}") from error


def make_folder(path: str | os.PathLike[str]) -> Path:
    """Return `path` as a folder, made with those it lies in where they are not there.

    Raises InputError: it cannot be made.
    """
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot make this folder: {error.strerror or error}") from error
    return folder


def flush_to_disk(path: Path) -> None:
    """Ask the system to put a file, or a folder's list of files, on the disk."""
    if path.is_dir() and os.name == "nt":
        return  # Windows cannot open folders
    descriptor = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def write_bytes(path: str | os.PathLike[str], *parts: bytes | memoryview) -> None:
    """Write `parts`, one after the other, to `path` atomically."""
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        for part in parts:
            file.write(part)


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write `text` as UTF-8 with plain line ends to `path` atomically; half letters as by `encodable`."""
    write_bytes(path, encodable(text).encode("utf-8"))


def encodable(text: str) -> str:
    r"""Return `text` with half letters written as `\udcf6`, which JSON reads back as they were.

    File names of another encoding than the system's have them (PEP 383).
    """
    return text.encode("utf-8", "backslashreplace").decode("utf-8")


def write_json(path: str | os.PathLike[str], value: object) -> None:
    """Write `value` as JSON to `path` atomically, the same text as of `json_text`.

    What a mapping holds is written one after the other, and so are the items of its sequences: long documents
    are never text as a whole, and arrays in them are numbers only then.
    """
    if not isinstance(value, Mapping) or not value:
        write_text(path, json_text(value))
        return
    with atomic_path(path) as temporary, temporary.open("w", encoding="utf-8", newline="\n") as file:
        file.writelines(_json_parts(value))


def _json_parts(value: Mapping[Any, Any]) -> Iterator[str]:
    """The text of a mapping that is not empty, in parts."""
    for number, (key, item) in enumerate(value.items()):
        yield ",\n" if number else "{\n"
        yield f"  {encodable(json.dumps(str(key), ensure_ascii=False))}: "
        if not isinstance(item, list | tuple) or not item:
            yield _indent(item, 2)
            continue
        for index, element in enumerate(item):
            yield (",\n" if index else "[\n") + 4 * " " + _indent(element, 4)
        yield "\n  ]"
    yield "\n}\n"


def _indent(value: object, n_spaces: int) -> str:
    """JSON whose lines, but the first, begin so far to the right."""
    return json_text(value).rstrip("\n").replace("\n", "\n" + n_spaces * " ")


def json_text(value: object, indent: int | None = 2) -> str:
    """Return `value` as strict JSON: keys in their order, floats by repr, NaN and infinities as null.

    Arrays and tuples become lists, paths strings.

    Examples
    --------
    >>> json_text({"b": np.array([1.5, np.nan]), "a": np.int64(2)}, indent=None)
    '{"b": [1.5, null], "a": 2}'
    """
    text = encodable(json.dumps(to_plain(value), indent=indent, allow_nan=False, ensure_ascii=False))
    return text if indent is None else text + "\n"


def to_plain(value: Any) -> Any:
    """Return `value` built of dict, list, str, int, float, bool and None alone."""
    if isinstance(value, np.ndarray | np.generic):
        return to_plain(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): to_plain(item) for key, item in value.items()}
    if value is None or isinstance(value, str | int):
        return value
    if isinstance(value, Sequence):
        return [to_plain(item) for item in value]
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    raise TypeError(f"{type(value).__name__} has no JSON form")


_WAIT_S = 2.0  # that a run which was just killed may need to be gone
_POLL_S = 0.02
_LEFTOVER = re.compile(r"\..+\.\d+\.tmp(\.[^.]+)?")  # of `scenes.run.atomic.atomic_path`


class Stage:
    """A folder inside another one, which must exist; `commit` puts its files into that in one go.

    The staged folder is renamed first, which is what decides: before that a run that ends, however it ends,
    has changed nothing; after it `settle` puts the rest in place where the run itself no longer could. Until
    then the pixels of large scans are in it too (`scenes.run.mapping`), on the disk of the output. The
    name tells stages in one folder apart: that of an output file, "" for a whole folder.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder, Stage(Path(folder)) as stage:
    ...     _ = stage.path("a.txt").write_text("whole")
    ...     before = Path(folder, "a.txt").exists()
    ...     stage.commit()
    ...     before, Path(folder, "a.txt").read_text()
    (False, 'whole')
    """

    def __init__(self, folder: Path, name: str = "") -> None:
        self.target, self._name = folder, name
        self.folder, self._decided = _places(folder, name)
        self._mapped = mapped_in(self.folder)

    def __enter__(self) -> Self:
        """Settle what an earlier run left, and make the stage.

        Raises InputError: the folder cannot be written.
        """
        settle(self.target, self._name)
        with guard_writing(self.target):
            self.folder.mkdir()
        self._mapped.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Forget what was not committed."""
        self._mapped.__exit__(None, None, None)
        shutil.rmtree(self.folder, ignore_errors=True)

    def path(self, name: str) -> Path:
        """Return where to write the file `name`, which may have folders in it; they are made."""
        file = self.folder / name
        with guard_writing(self.target / name):
            file.parent.mkdir(parents=True, exist_ok=True)
        return file

    def files(self) -> list[Path]:
        """Return what is staged, relative to the folder, in order."""
        return sorted(_files(self.folder))

    def commit(self, last: str = "") -> None:
        """Put all files into the folder, over what was there; `last` is the one that seals them.

        Raises InputError: a folder stands where a file is to be, or the other way round; nothing has changed
        then. Or a file there cannot be replaced: the next run will.
        """
        for file in self.files():
            _check_free(self.target, file)
        with guard_writing(self.target):
            self.folder.rename(self._decided)
            flush_to_disk(self.target)
        _put(self._decided, self.target, last)


def settle(folder: Path, name: str = "") -> None:
    """Finish the commit of a run that was killed in the middle of it, and clear what one left uncommitted.

    Only who holds the folder's lock may.

    Raises InputError: a file cannot be replaced.
    """
    staged, decided = _places(folder, name)
    if decided.is_dir() and not decided.is_symlink():
        _put(decided, folder, "")
    if staged.is_dir() and not staged.is_symlink():
        shutil.rmtree(staged, ignore_errors=True)


def _places(folder: Path, name: str) -> tuple[Path, Path]:
    """Where files wait, and what that folder is called once they are to be put in place."""
    middle = f"-{name}" if name else ""
    return folder / f".unseen{middle}-staged", folder / f".unseen{middle}-decided"


def _check_free(folder: Path, file: Path) -> None:
    """Raise InputError where a folder stands in the place of a file, or a file in that of a folder."""
    if (folder / file).is_dir():
        raise InputError(f"{folder / file}: is a folder, where a file is to be written")
    for place in file.parents:
        if (folder / place).exists() and not (folder / place).is_dir():
            raise InputError(f"{folder / place}: is a file, where a folder is to be made")


def _files(folder: Path) -> Iterator[Path]:
    for place, _, names in os.walk(folder):
        yield from (Path(place, name).relative_to(folder) for name in names)


def _put(decided: Path, folder: Path, last: str) -> None:
    """Move finished files into the folder: the manifest last, or last of all the file named `last`."""
    files = sorted(_files(decided), key=lambda file: (file.name == "manifest.json", str(file) == last, file))
    with guard_writing(folder):
        for file in files:
            (folder / file).parent.mkdir(parents=True, exist_ok=True)
            (decided / file).replace(folder / file)
        for place in sorted({(folder / file).parent for file in files}):
            flush_to_disk(place)
    shutil.rmtree(decided, ignore_errors=True)


@contextmanager
def hold_lock(folder: Path, name: str = "", wait_s: float = _WAIT_S) -> Iterator[None]:
    """Hold the lock of a folder, or of the output file `name` in it, and clear it of what a killed run left.

    The lock is an empty file, removed at the end; one that a killed run left behind locks nothing. Where the
    file system knows no locks, or the folder cannot be written, nothing is held. Raises InputError: another
    run still holds it after `wait_s` seconds.
    """
    file = lock_file(folder, name)
    try:
        stream = _open_lock(file, wait_s)
    except OSError:
        yield
        return
    with stream:
        if not name:
            remove_leftovers(folder)
        try:
            yield
        finally:
            with suppress(OSError):  # Windows keeps files that are open
                file.unlink()


def lock_file(folder: Path, name: str = "") -> Path:
    """Return the file that is the lock of a folder, or of the file `name` in it."""
    return folder / (f".unseen.{name}.lock" if name else ".unseen.lock")


def _open_lock(file: Path, wait_s: float) -> BinaryIO:
    """Return the lock's file, locked: the one that stands there now, not one that was just removed."""
    until = time.monotonic() + wait_s
    while True:
        stream = file.open("ab")
        if not _take_lock(stream.fileno()):
            stream.close()
            if time.monotonic() < until:
                time.sleep(_POLL_S)
                continue
            raise InputError(f"{file.parent}: another run writes there; wait for it, or give another --out")
        with suppress(FileNotFoundError):
            if os.path.samestat(os.fstat(stream.fileno()), file.stat()):
                return stream
        stream.close()


def remove_leftovers(folder: Path) -> None:
    """Remove what killed runs left in a folder and the folders in it; only who holds the lock may."""
    for file in sorted([*folder.glob(".*"), *folder.glob("*/.*")]):
        if _LEFTOVER.fullmatch(file.name) and file.is_file():
            with suppress(OSError):
                file.unlink()


def _take_lock(descriptor: int) -> bool:
    """Take the lock; False where another process holds it."""
    try:
        if sys.platform == "win32":
            import msvcrt

            os.lseek(descriptor, 0, os.SEEK_SET)
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except (BlockingIOError, PermissionError):
        return False
    except OSError:
        return True  # a file system without locks
    return True
