# SPDX-License-Identifier: MIT
"""Limits: how large what a file holds may be, in force for a block of code as `numpy.errstate` is.

Files come from strangers and say themselves how much they hold. Every reader asks here before it believes
them, so that a file of a few kilobytes cannot fill the memory; what exceeds a limit is refused with an error
that names the limit, the number met and the cure.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, fields, replace

from scenes.checks import InputError

_FREE_BYTES = 64 << 20  # up to so much no ratio is looked at: a blank page of that size packs to nothing


@dataclass(frozen=True, kw_only=True, slots=True)
class ReadLimits:
    """The largest that is read; the defaults are several times what rooms, halls and their scans need.

    Attributes
    ----------
    file_bytes : int
        One file, as it lies on the disk. 4 GiB: a day of terrestrial scanning.
    json_bytes : int
        One JSON text, also that inside GLB and E57 (there XML). 256 MiB, which take about 3 GB as objects.
    toml_bytes : int
        One TOML file. 1 MiB: people write them.
    unpacked_bytes : int
        What one packed file becomes in memory (.npz, .laz, .e57, packed .pcd, an image). 4 GiB.
    ratio : int
        Unpacked bytes for one packed, looked at beyond 64 MiB unpacked. 200: scans reach 20, drawings 100,
        bombs 1,000 and more.
    entries : int
        Files in an archive; frames, scans or poses of a file or folder; nodes of a glTF. 1,000,000.
    pixels : int
        One image, or the grid of one scan. 200,000,000: a full turn at 0.018 degrees.
    points : int
        One cloud, or the vertices of one mesh. 300,000,000.
    faces : int
        All triangles of a scene, each copy of what is placed several times counted. 100,000,000.
    texels : int
        All textures of a scene together. 1,000,000,000, which take 3 GB.

    Raises
    ------
    InputError
        A limit that is no integer of one or more.
    """

    file_bytes: int = 4 << 30
    json_bytes: int = 256 << 20
    toml_bytes: int = 1 << 20
    unpacked_bytes: int = 4 << 30
    ratio: int = 200
    entries: int = 1_000_000
    pixels: int = 200_000_000
    points: int = 300_000_000
    faces: int = 100_000_000
    texels: int = 1_000_000_000

    def __post_init__(self) -> None:
        for name, value in self.by_name().items():
            if isinstance(value, bool) or not isinstance(value, int) or value < 1:
                raise InputError(f"the limit {name} must be an integer of 1 or more, got {value!r}")

    def by_name(self) -> dict[str, int]:
        """Return all limits by name."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    def non_defaults(self) -> dict[str, int]:
        """Return those that are not the defaults."""
        usual = _USUAL.by_name()
        return {name: value for name, value in self.by_name().items() if value != usual[name]}


LIMIT_NAMES = tuple(field.name for field in fields(ReadLimits))
Limits = ReadLimits  # earlier name
_USUAL = ReadLimits()
_in_force: ContextVar[ReadLimits] = ContextVar("limits", default=_USUAL)


def current_limits() -> ReadLimits:
    """Return the limits in force here."""
    return _in_force.get()


@contextmanager
def limits(**changes: int) -> Iterator[ReadLimits]:
    """Put other limits, by the names of the fields of `ReadLimits`, in force for a block; the rest stay.

    Limits belong to the context that sets them: a thread that is started inside the block has the defaults.
    Raises InputError: an unknown name, or a value that is no integer of one or more.

    Examples
    --------
    >>> with limits(faces=1000):
    ...     current_limits().faces
    1000
    >>> current_limits().faces
    100000000
    """
    unknown = sorted(set(changes) - set(LIMIT_NAMES))
    if unknown:
        raise InputError(f"unknown limit {unknown[0]!r}; known: {', '.join(LIMIT_NAMES)}")
    token = _in_force.set(replace(current_limits(), **changes))
    try:
        yield current_limits()
    finally:
        _in_force.reset(token)


def check_limit(name: str, value: int, what: str) -> None:
    """Raise InputError when `value`, which a file holds or says that it holds, exceeds the limit `name`.

    `what` is said before the number: "its faces".
    """
    most = current_limits().by_name()[name]
    if value > most:
        raise InputError(
            f"{what}: {value:,} exceed the limit {name}={most:,}; if you trust the file, allow it with "
            f"--limit {name}={value} (in Python: with limits({name}={value}))"
        )


def check_unpacked(unpacked: int, packed: int, what: str) -> None:
    """Raise InputError when `packed` bytes would become more than the limits allow: too many, or too dense.

    `what` is said before the numbers: "the image".
    """
    check_limit("unpacked_bytes", unpacked, f"bytes that {what} unpacks to")
    if unpacked > _FREE_BYTES:
        check_limit("ratio", unpacked // max(packed, 1), f"unpacked bytes of {what} for each packed one")
