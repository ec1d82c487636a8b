# SPDX-License-Identifier: MIT
"""Journal: what each step of a long run came to, so that one that was killed goes on after the last.

A step is a pure function of what the journal's key names. A run that is made of the same takes the steps that
are there as they are, and comes to the same end.
"""

from __future__ import annotations

import dataclasses
import io
import json
import sys
import zipfile
from collections.abc import Callable
from enum import Enum
from pathlib import Path
from shutil import rmtree
from typing import Any, Protocol, TypeVar

import numpy as np
import scipy  # its parts load when they are first used
from numpy.typing import NDArray

from scenes.run.atomic import json_text, make_folder, write_bytes, write_text

_KEY_FILE = "key.json"
_Value = TypeVar("_Value")
_STRUCTURE = "structure"
_PACKAGES = ("scenes", "texture", "completion", "nbv")
_PLAIN = (str, int, float, bool, type(None))
_MAKERS: dict[str, Callable[[list[Any]], Any]] = {
    "list": list,
    "tuple": tuple,
    "set": set,
    "frozenset": frozenset,
    "dict": dict,
}


class Journal(Protocol):
    """Remembers what steps came to."""

    def step(self, name: str, work: Callable[[], _Value]) -> _Value:
        """Return what a step came to; where it is not known `work` does it, and it is known from then on."""


class NoJournal:
    """Remembers nothing: every step is done."""

    def step(self, name: str, work: Callable[[], _Value]) -> _Value:  # noqa: ARG002 - what is not kept needs no name
        """Return what `work` returns."""
        return work()


NO_JOURNAL = NoJournal()


class FileJournal:
    """A journal in a folder of its own; one that was made of something else is thrown away.

    Steps may be done by several threads at a time.

    Parameters
    ----------
    folder : Path
        Made where it is not there.
    key : str
        Tells what the run is made of: inputs, options, seed, versions.

    Raises
    ------
    InputError
        The folder cannot be made or written.
    """

    def __init__(self, folder: Path, key: str) -> None:
        self.folder, self.key = folder, key
        if self._key() != key:
            self.forget()
            make_folder(folder)
            write_text(folder / _KEY_FILE, json_text({"key": key}))

    def step(self, name: str, work: Callable[[], _Value]) -> _Value:
        """Return what a step came to; what is not known yet `work` does, and it is kept.

        Raises
        ------
        InputError
            The folder cannot be written.
        PackingError
            The value is not built of dataclasses of ours, arrays and plain values.
        """
        file = self.folder / f"{name}.npz"
        try:
            known: _Value = unpack(file.read_bytes())
        except (OSError, PackingError):
            value = work()
            write_bytes(file, pack(value))
            return value
        return known

    def part(self, name: str) -> FileJournal:
        """Return the journal of a part of the run, whose steps are called as those of the whole."""
        return FileJournal(self.folder / name, self.key)

    def forget(self) -> None:
        """Remove the journal: the run has ended."""
        rmtree(self.folder, ignore_errors=True)

    def _key(self) -> str | None:
        try:
            held: Any = json.loads((self.folder / _KEY_FILE).read_text("utf-8"))
            return str(held["key"])
        except (OSError, ValueError, KeyError, TypeError, RecursionError):
            return None


class PackingError(ValueError):
    """A value that cannot be packed, or an archive that cannot be unpacked."""


def pack(value: object) -> bytes:
    """Return `value` as bytes: dataclasses, enumerations, containers, arrays, sparse matrices and numbers.

    Raises PackingError: it holds something else.

    Examples
    --------
    >>> unpack(pack((1, "a", np.array([0.5, np.nan]))))
    (1, 'a', array([0.5, nan]))
    """
    arrays: list[NDArray[Any]] = []
    structure = _packed(value, arrays)
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w") as archive:
        for number, array in enumerate(arrays):
            held = io.BytesIO()
            np.lib.format.write_array(held, array, allow_pickle=False)
            _add(archive, str(number), held.getvalue())
        _add(archive, _STRUCTURE, json.dumps(structure).encode())
    return data.getvalue()


def unpack(data: bytes) -> Any:
    """Return the value that `pack` made `data` of, arrays as writeable as they were.

    Raises PackingError: damaged, or of classes that are not there.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            arrays: dict[str, NDArray[Any]] = {
                name: np.lib.format.read_array(io.BytesIO(archive.read(name)), allow_pickle=False)
                for name in archive.namelist()
                if name != _STRUCTURE
            }
            return _unpacked(json.loads(archive.read(_STRUCTURE)), arrays)
    except PackingError:
        raise
    except Exception as error:  # whatever a damaged archive makes its readers raise
        raise PackingError(f"cannot be unpacked: {error}") from error


def _add(archive: zipfile.ZipFile, name: str, data: bytes) -> None:
    """Add a member without the time of day, so that the same value gives the same bytes."""
    archive.writestr(zipfile.ZipInfo(name), data, zipfile.ZIP_DEFLATED, compresslevel=1)


def _packed(value: Any, arrays: list[NDArray[Any]]) -> Any:
    """Return `value` for JSON: plain values as they are, all else as [what it is, ...]."""
    if type(value) in _PLAIN:
        return value
    if isinstance(value, Enum):
        return ["enum", _name(type(value)), value.name]
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
        return ["class", _name(type(value)), *([k, _packed(v, arrays)] for k, v in fields.items())]
    if type(value).__name__ == "csr_array":
        parts = (value.data, value.indices, value.indptr, value.shape)
        return ["csr", *(_packed(part, arrays) for part in parts)]
    if isinstance(value, np.ndarray | np.generic):
        if value.dtype.hasobject:
            raise PackingError("an array of objects cannot be packed")
        arrays.append(np.asarray(value))
        if isinstance(value, np.generic):
            return ["scalar", len(arrays) - 1]
        return ["array", len(arrays) - 1, bool(value.flags.writeable)]
    if type(value) is dict:
        return ["dict", *([_packed(k, arrays), _packed(v, arrays)] for k, v in value.items())]
    if type(value).__name__ in _MAKERS and type(value).__module__ == "builtins":
        return [type(value).__name__, *(_packed(item, arrays) for item in value)]
    raise PackingError(f"a {type(value).__name__} cannot be packed")


def _unpacked(held: Any, arrays: dict[str, NDArray[Any]]) -> Any:
    """Return the value that `_packed` described."""
    if not isinstance(held, list):
        return held
    what, *rest = held
    if what == "array":
        array = arrays[str(rest[0])]
        array.setflags(write=rest[1])
        return array
    if what == "scalar":
        return arrays[str(rest[0])][()]
    if what == "enum":
        return _class(rest[0], Enum)[rest[1]]
    if what == "class":
        return _built(_class(rest[0], object), {name: _unpacked(item, arrays) for name, item in rest[1:]})
    if what == "dict":
        return {_unpacked(k, arrays): _unpacked(v, arrays) for k, v in rest}
    items = [_unpacked(item, arrays) for item in rest]
    if what == "csr":
        return scipy.sparse.csr_array(tuple(items[:3]), shape=items[3])
    return _MAKERS[what](items)


def _built(kind: type[Any], fields: dict[str, Any]) -> Any:
    """Return a dataclass with these fields, as it was: what its checks would do to them is done already."""
    if not dataclasses.is_dataclass(kind) or {one.name for one in dataclasses.fields(kind)} != set(fields):
        raise PackingError(f"{kind.__name__} has other fields now")
    value: Any = object.__new__(kind)
    for name, item in fields.items():
        object.__setattr__(value, name, item)
    return value


def _name(kind: type) -> str:
    if kind.__module__.partition(".")[0] not in _PACKAGES:
        raise PackingError(f"a {kind.__module__}.{kind.__qualname__} cannot be packed")
    return f"{kind.__module__}:{kind.__qualname__}"


def _class(name: str, base: type) -> Any:
    """Return a class of ours that is imported already."""
    module, _, qualified = name.partition(":")
    if module.partition(".")[0] not in _PACKAGES or module not in sys.modules or not qualified.isidentifier():
        raise PackingError(f"{name} is no class of this project")
    kind = getattr(sys.modules[module], qualified, None)
    if not isinstance(kind, type) or not issubclass(kind, base):
        raise PackingError(f"{name} is no class of this project")
    return kind
