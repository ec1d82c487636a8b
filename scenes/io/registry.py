# SPDX-License-Identifier: MIT
"""Registry of formats of points and scans: a new format is a module with a `FORMAT`, and a line here.

Messages, the lists of known suffixes and the command line's texts follow from it.
"""

from __future__ import annotations

from functools import cache
from importlib import import_module

from scenes.io.format import Format

_MODULES = ("npz", "ply_scan", "pcd", "ptx", "e57_writer", "uos", "las", "text")


@cache
def formats() -> tuple[Format, ...]:
    """Return all formats, in the order in which messages name them."""
    held: list[Format] = []
    for module in _MODULES:
        value = import_module(f"scenes.io.{module}").FORMAT
        held += value if isinstance(value, tuple) else (value,)
    return tuple(held)


def format_of(suffix: str) -> Format | None:
    """Return the format of a suffix, in lower or upper case, None where there is none."""
    return next((known for known in formats() if suffix.lower() in known.suffixes), None)


def point_suffixes() -> tuple[str, ...]:
    """Return the suffixes of files whose points can be read."""
    return tuple(suffix for known in formats() if known.points for suffix in known.suffixes)


def scan_suffixes() -> tuple[str, ...]:
    """Return the suffixes of files that may hold scans."""
    return tuple(suffix for known in formats() if known.scans for suffix in known.suffixes)


def written_suffixes() -> tuple[str, ...]:
    """Return the suffixes of files that scans can be written to."""
    return tuple(suffix for known in formats() if known.write for suffix in known.suffixes)


def text_suffixes() -> tuple[str, ...]:
    """Return the suffixes of text that may hold points."""
    return tuple(suffix for known in formats() if known.is_text for suffix in known.suffixes)
