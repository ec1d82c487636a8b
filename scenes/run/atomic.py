# SPDX-License-Identifier: MIT
"""Atomic output: a file appears whole or not at all, and what stood there before survives a failure."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from scenes.checks import InputError


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
        with writing(target):
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
def writing(path: Path) -> Iterator[None]:
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
    """Write `text` as UTF-8 with plain line ends to `path` atomically."""
    write_bytes(path, text.encode("utf-8"))


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
        yield f"  {json.dumps(str(key), ensure_ascii=False)}: "
        if not isinstance(item, list | tuple) or not item:
            yield _indented(item, 2)
            continue
        for index, one in enumerate(item):
            yield (",\n" if index else "[\n") + 4 * " " + _indented(one, 4)
        yield "\n  ]"
    yield "\n}\n"


def _indented(value: object, n_spaces: int) -> str:
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
    text = json.dumps(to_plain(value), indent=indent, allow_nan=False, ensure_ascii=False)
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
