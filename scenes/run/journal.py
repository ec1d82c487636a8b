# SPDX-License-Identifier: MIT
"""Packing: values of our dataclasses, arrays and plain values as one archive, in which nothing can be run."""

from __future__ import annotations

import dataclasses
import json
import math
import sys
import zipfile
from collections.abc import Callable, Sequence
from contextlib import suppress
from enum import Enum
from pathlib import Path
from shutil import rmtree
from typing import IO, Any, Protocol, TypeVar

import numpy as np
import scipy  # its parts load when they are first used
from numpy.typing import NDArray

from scenes.checks import InputError
from scenes.run.atomic import atomic_path, json_text, make_folder, write_text
from scenes.run.mapping import allocate, fill_from, release

_STRUCTURE, _SMALL = "structure", "small"
# Bytes. Smaller arrays stand one after the other in one member, which takes a tenth of the time.
_LEAST = 1 << 14
_LARGE = 1 << 30  # bytes; members of twice as many need room for longer sizes
_PACKAGES = ("scenes", "texture", "completion", "nbv")
_PLAIN = (str, int, float, bool, type(None))
_MAKERS: dict[str, Callable[[list[Any]], Any]] = {
    "list": list,
    "tuple": tuple,
    "set": set,
    "frozenset": frozenset,
    "dict": dict,
}


class PackingError(ValueError):
    """A value that cannot be packed, or an archive that cannot be unpacked."""


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class _Arrays:
    """The arrays of a value: large ones each by itself, the bytes of the small ones together."""

    large: list[NDArray[Any]]
    small: bytearray

    def add(self, array: NDArray[Any]) -> list[Any]:
        """Keep an array; return what it is found by."""
        if array.nbytes >= _LEAST or not array.flags.c_contiguous or array.dtype.fields is not None:
            self.large.append(array)
            return [len(self.large) - 1]
        self.small.extend(array.tobytes())
        return [len(self.small) - array.nbytes, array.dtype.str, *array.shape]

    def find(self, place: int, kind: str = "", *shape: int) -> NDArray[Any]:
        """Return the array that `add` told to be here."""
        if not kind:
            return self.large[place]
        dtype = np.dtype(kind)
        count = math.prod(shape)
        return np.frombuffer(self.small, dtype, count, place).reshape(shape).copy()


def pack(value: object, stream: IO[bytes]) -> None:
    """Write `value`: dataclasses, enumerations, containers, arrays, sparse matrices and numbers.

    The same value gives the same bytes. Raises PackingError: it holds something else.

    Examples
    --------
    >>> from io import BytesIO
    >>> stream = BytesIO()
    >>> pack((1, "a", np.array([0.5, np.nan])), stream)
    >>> unpack(stream)
    (1, 'a', array([0.5, nan]))
    """
    arrays = _Arrays([], bytearray())
    structure = _pack(value, arrays)
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for number, array in enumerate(arrays.large):
            with archive.open(str(number), "w", force_zip64=array.nbytes > _LARGE) as member:
                np.lib.format.write_array(member, array, allow_pickle=False)
            release(array)
        with archive.open(_SMALL, "w") as member:
            member.write(arrays.small)
        with archive.open(_STRUCTURE, "w") as member:
            member.write(json.dumps(structure).encode())


def unpack(stream: IO[bytes]) -> Any:
    """Return the value that `pack` wrote, arrays as writeable as they were, and mapped where they are large.

    Raises InputError: the disk has no room for them. Raises PackingError: damaged, or of classes that are not
    there.
    """
    try:
        with zipfile.ZipFile(stream) as archive:
            names = [name for name in archive.namelist() if name not in (_STRUCTURE, _SMALL)]
            large = [_array(archive, name) for name in names]
            arrays = _Arrays(large, bytearray(archive.read(_SMALL)))
            return _unpack(json.loads(archive.read(_STRUCTURE)), arrays)
    except (InputError, PackingError):
        raise
    except Exception as error:  # whatever a damaged archive makes its readers raise
        raise PackingError(f"cannot be unpacked: {error}") from error


def _array(archive: zipfile.ZipFile, name: str) -> NDArray[Any]:
    """Read an array, which is no pickle, a block at a time."""
    with archive.open(name) as stream:
        version = np.lib.format.read_magic(stream)
        if version != (1, 0):
            raise PackingError(f"array {name} is of version {version}")
        shape, is_fortran, dtype = np.lib.format.read_array_header_1_0(stream)
        n_bytes = archive.getinfo(name).file_size - stream.tell()
        if dtype.hasobject or math.prod(shape) * dtype.itemsize != n_bytes:
            raise PackingError(f"array {name} has another size than its header states")
        array = allocate(shape[::-1] if is_fortran else shape, dtype)
        if fill_from(array, stream) != n_bytes or stream.read(1):  # at the end its checksum is looked at
            raise PackingError(f"array {name} breaks off")
    return array.T if is_fortran else array


def _pack(value: Any, arrays: _Arrays) -> Any:
    """Return `value` for JSON: plain values as they are, all else as [what it is, ...]."""
    if type(value) in _PLAIN:
        return value
    if isinstance(value, Enum):
        return ["enum", _name(type(value)), value.name]
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
        return ["class", _name(type(value)), *([k, _pack(v, arrays)] for k, v in fields.items())]
    if type(value).__name__ == "csr_array":
        parts = (value.data, value.indices, value.indptr, value.shape)
        return ["csr", *(_pack(part, arrays) for part in parts)]
    if isinstance(value, np.ndarray | np.generic):
        if value.dtype.hasobject:
            raise PackingError("an array of objects cannot be packed")
        where = arrays.add(np.asarray(value))
        if isinstance(value, np.generic):
            return ["scalar", *where]
        return ["array", bool(value.flags.writeable), *where]
    if type(value) is dict:
        return ["dict", *([_pack(k, arrays), _pack(v, arrays)] for k, v in value.items())]
    if type(value).__name__ in _MAKERS and type(value).__module__ == "builtins":
        return [type(value).__name__, *(_pack(item, arrays) for item in value)]
    raise PackingError(f"a {type(value).__name__} cannot be packed")


def _unpack(held: Any, arrays: _Arrays) -> Any:
    """Return the value that `_packed` described."""
    if not isinstance(held, list):
        return held
    kind, *content = held
    if kind == "array":
        array = arrays.find(*content[1:])
        array.setflags(write=content[0])
        return array
    if kind == "scalar":
        return arrays.find(*content)[()]
    if kind == "enum":
        return _class(content[0], Enum)[content[1]]
    if kind == "class":
        return _built(_class(content[0], object), {name: _unpack(item, arrays) for name, item in content[1:]})
    if kind == "dict":
        return {_unpack(k, arrays): _unpack(v, arrays) for k, v in content}
    items = [_unpack(item, arrays) for item in content]
    if kind == "csr":
        return scipy.sparse.csr_array(tuple(items[:3]), shape=items[3])
    return _MAKERS[kind](items)


def _built(kind: type[Any], fields: dict[str, Any]) -> Any:
    """Return a dataclass with these fields, as it was: what its checks would do to them is done already."""
    if not dataclasses.is_dataclass(kind) or {field.name for field in dataclasses.fields(kind)} != set(
        fields
    ):
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


_KEY_FILE = "key.json"
_Value = TypeVar("_Value")
_TRIES = 3  # to remove a folder that a worker may be writing to


class Journal(Protocol):
    """Remembers what steps came to."""

    def step(self, name: str, work: Callable[[], _Value]) -> _Value:
        """Return what a step came to; where it is not known `work` does it, and it is known from then on."""

    def turn(self, n_steps: int) -> Sequence[int]:
        """Return in which order to offer steps that are numbered from 0; none where nobody else does any."""

    def offer(self, name: str, work: Callable[[], object]) -> None:
        """Have a step done, unless it is known or another does it."""


class NoJournal:
    """Remembers nothing: every step is done."""

    def step(self, name: str, work: Callable[[], _Value]) -> _Value:  # noqa: ARG002 - what is not kept needs no name
        """Return what `work` returns."""
        return work()

    def turn(self, n_steps: int) -> Sequence[int]:  # noqa: ARG002 - nobody else does any
        """Return nothing."""
        return ()

    def offer(self, name: str, work: Callable[[], object]) -> None:
        """Do nothing: `step` will."""


NO_JOURNAL = NoJournal()


def is_blank(folder: Path) -> bool:
    """Tell whether the journal in a folder, if there is one, knows no step yet."""
    return all(path.name == _KEY_FILE for path in folder.rglob("*") if not path.is_dir())


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
        file = self._file(name)
        try:
            with file.open("rb") as stream:
                known: _Value = unpack(stream)
        except (OSError, PackingError):
            value = work()
            with atomic_path(file) as temporary:
                with temporary.open("wb") as stream:
                    pack(value, stream)
                if self._key() != self.key:
                    raise InputError(f"{self.folder}: now holds the journal of another run") from None
            return value
        return known

    def turn(self, n_steps: int) -> Sequence[int]:  # noqa: ARG002 - nobody else does any
        """Return nothing."""
        return ()

    def offer(self, name: str, work: Callable[[], object]) -> None:
        """Do nothing: `step` will."""

    def part(self, name: str) -> FileJournal:
        """Return the journal of a part of the run, whose steps are called as those of the whole."""
        return FileJournal(self.folder / name, self.key)

    def forget(self) -> None:
        """Remove the journal: the run has ended. What a worker of it comes to later is not kept."""
        with suppress(OSError):
            (self.folder / _KEY_FILE).unlink()
        for _ in range(_TRIES):
            rmtree(self.folder, ignore_errors=True)
            if not self.folder.exists():
                return

    def _file(self, name: str) -> Path:
        return self.folder / f"{name}.npz"

    def _key(self) -> str | None:
        try:
            held: Any = json.loads((self.folder / _KEY_FILE).read_text("utf-8"))
            return str(held["key"])
        except (OSError, ValueError, KeyError, TypeError, RecursionError):
            return None
