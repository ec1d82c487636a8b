# SPDX-License-Identifier: MIT
"""Cases: what is given to a reader: names and contents of files, and the one that the reader is told of."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path


@dataclass(frozen=True)
class Case:
    """Files of one folder.

    Attributes
    ----------
    files : dict
        Content of each file by its name, `/` between folders.
    entry : str
        The name a reader is given, "" for the folder itself.
    """

    files: dict[str, bytes]
    entry: str

    def changed(self, name: str, data: bytes) -> Case:
        """Return the case with another content of one file."""
        return replace(self, files={**self.files, name: data})

    def write(self, folder: Path) -> Path:
        """Make `folder` hold these files alone; return the path for the reader."""
        here = folder / "input"
        shutil.rmtree(here, ignore_errors=True)
        here.mkdir(parents=True)
        for name, data in self.files.items():
            file = here / name
            if "/" in name:
                file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(data)
        return here / self.entry if self.entry else here

    def pack(self) -> bytes:
        """Return the case as bytes, for corpora of a fuzzer that knows bytes alone."""
        sizes = [[name, len(data)] for name, data in self.files.items()]
        head = json.dumps([self.entry, sizes]).encode()
        return b"%d\n" % len(head) + head + b"".join(self.files.values())

    @classmethod
    def unpack(cls, data: bytes) -> Case | None:
        """Return the case that was packed, None where the bytes are none."""
        length, _, rest = data.partition(b"\n")
        try:
            size = int(length)
            entry, sizes = json.loads(rest[:size])
            files, start = {}, size
            for name, n_bytes in sizes:
                files[name] = rest[start : start + n_bytes]
                start += n_bytes
        except (ValueError, TypeError, KeyError):
            return None
        return cls(files, entry)


def case_of(make: Callable[[Path], object], folder: Path, entry: str) -> Case:
    """Return what `make(folder)` writes."""
    make(folder)
    names = sorted(path for path in folder.rglob("*") if path.is_file())
    return Case({path.relative_to(folder).as_posix(): path.read_bytes() for path in names}, entry)
