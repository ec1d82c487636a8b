# SPDX-License-Identifier: MIT
"""Arrays: `.npz` files, each array held against its archive's directory before numpy makes room for it."""

from __future__ import annotations

import math
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from scenes.checks import InputError
from scenes.io.guard import check_file, reading
from scenes.io.limits import check_limit, check_unpacked
from scenes.run.mapping import allocate, fill_from

_KNOWN = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)  # what numpy writes; others may ask for any memory
_SUFFIX = ".npy"


class ArrayFile:
    """The arrays of an open `.npz` file, by name; none is read before it is asked for.

    Raises InputError: more entries or unpacked bytes than the limits allow, two arrays of one name, or an
    unknown packing.
    """

    def __init__(self, archive: zipfile.ZipFile) -> None:
        entries = archive.infolist()
        check_limit("entries", len(entries), "files in the archive")
        check_unpacked(
            sum(entry.file_size for entry in entries), sum(entry.compress_size for entry in entries), "it"
        )
        for entry in entries:
            if entry.compress_type not in _KNOWN:
                raise InputError(f"its {entry.filename!r} is packed in a way that numpy does not write")
            check_unpacked(entry.file_size, entry.compress_size, f"its {entry.filename!r}")
        self._archive = archive
        self._entries = {entry.filename.removesuffix(_SUFFIX): entry for entry in entries}
        if len(self._entries) < len(entries):
            raise InputError("holds two arrays of one name")

    @property
    def files(self) -> tuple[str, ...]:
        """Names of the arrays."""
        return tuple(self._entries)

    def __getitem__(self, name: str) -> NDArray[Any]:
        """Return an array, mapped where it is large.

        Raises InputError: there is none of that name, it holds Python objects, or its header announces
        another size than the archive holds.
        """
        if name not in self._entries:
            raise InputError(f"has no {name!r}; it holds {', '.join(self._entries) or 'nothing'}")
        entry = self._entries[name]
        with self._archive.open(entry) as stream:
            shape, is_fortran, dtype = _header(stream, name)
            announced, held = math.prod(shape) * dtype.itemsize, entry.file_size - stream.tell()
            if dtype.hasobject:
                raise InputError(f"its {name!r} holds Python objects (a pickle), which are never opened")
            if min(shape, default=1) < 0 or announced != held:
                raise InputError(
                    f"its {name!r} announces {dtype} of shape {shape}: {announced} bytes, {held} are there"
                )
            array = allocate(shape[::-1] if is_fortran else shape, dtype)
            n_there = fill_from(array, stream) + len(stream.read(1))  # at the end its checksum is looked at
            if n_there != held:
                raise InputError(f"truncated: its {name!r} is {n_there} bytes, {held} are announced")
        return array.T if is_fortran else array


def _header(stream: Any, name: str) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Shape, order and type that an array's own header announces."""
    version = npy.read_magic(stream)
    readers = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
    if version not in readers:
        raise InputError(f"its {name!r} is in version {version} of numpy's format; 1.0 and 2.0 are known")
    shape, is_fortran, dtype = readers[version](stream)
    return shape, is_fortran, dtype


@contextmanager
def open_arrays(path: Path) -> Iterator[ArrayFile]:
    """Open an `.npz` file; whatever goes wrong while it is open is an InputError that names it.

    Raises InputError: as `check_file` and `ArrayFile`; no archive, damaged.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     np.savez(Path(folder, "a.npz"), points=np.zeros((2, 3)))
    ...     with open_arrays(Path(folder, "a.npz")) as arrays:
    ...         arrays.files, arrays["points"].shape
    (('points',), (2, 3))
    """
    with reading(path, "an .npz file"):
        file: BinaryIO
        with check_file(path).open("rb") as file, zipfile.ZipFile(file) as archive:
            yield ArrayFile(archive)
