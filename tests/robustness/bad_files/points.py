# SPDX-License-Identifier: MIT
"""Bad point files, for fitting: text, PLY, PCD, LAS, E57, npz and PTX."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from completion.fitting.pipeline import fit
from completion.fitting.result import FitError
from scenes.io.point_files import read_points
from scenes.io.scene_files import units_doubt
from tests.robustness.bad_files import scans
from tests.robustness.bad_files.case import Case, Outcome, cut
from tests.robustness.bad_files.meshes import folder_called

AXES = "".join(f"property float {axis}\n" for axis in "xyz")
PLY = f"ply\nformat {{0}} 1.0\nelement vertex {{1}}\n{AXES}end_header\n"
PCD = (
    "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {0}\nHEIGHT 1\n"
    "VIEWPOINT 0 0 0 1 0 0 0\nPOINTS {0}\nDATA ascii\n"
)


def grid() -> Any:
    return np.stack(np.meshgrid(np.arange(8), np.arange(6), [0.0]), axis=-1).reshape(-1, 3) / 5


def read(path: Path | str) -> tuple[str, ...]:
    cloud = read_points(path)
    diagonal = float(np.linalg.norm(np.ptp(cloud.points, axis=0)))
    doubt = units_doubt(diagonal) if diagonal > 0 else "all points are in one place"
    return (*cloud.warnings, *filter(None, [doubt]))


def read_and_fit(path: Path | str) -> tuple[str, ...]:
    try:
        fit(read_points(path).points, "plane")
    except FitError as error:  # as the command does
        raise FitError(f"{path}: {error}") from error
    return ()


def rows(points: Any) -> str:
    return "".join(f"{x!r} {y!r} {z!r}\n" for x, y, z in np.asarray(points, float).tolist())


def write_text(folder: Path, points: Any) -> Path:
    (folder / "a.xyz").write_text(rows(points))
    return folder / "a.xyz"


def write_ply(folder: Path, points: Any) -> Path:
    (folder / "a.ply").write_text(PLY.format("ascii", len(points)) + rows(points))
    return folder / "a.ply"


def write_pcd(folder: Path, points: Any) -> Path:
    (folder / "a.pcd").write_text(PCD.format(len(points)) + rows(points))
    return folder / "a.pcd"


def write_npz(folder: Path, points: Any) -> Path:
    np.savez(folder / "a.npz", points=np.asarray(points, float))
    return folder / "a.npz"


RAW: dict[str, Callable[[Path, Any], Path]] = {
    "text points": write_text, "PLY points": write_ply, "PCD points": write_pcd, "npz points": write_npz,
}  # fmt: skip


def spoilt(reader: str, change: Callable[[bytes], bytes]) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        path = RAW[reader](folder, grid())
        path.write_bytes(change(path.read_bytes()))
        return path

    return write


def clouds() -> Iterator[tuple[int, str, Any, Any, tuple[Outcome, ...]]]:
    bad = grid()
    bad[5, 1] = np.nan
    yield 1, "a point that is NaN", bad, read, ("warned",)
    bad = grid()
    bad[5] = -np.inf
    yield 1, "a point that is infinite", bad, read, ("warned",)
    yield 1, "all points NaN", grid() * np.nan, read, ("refused",)
    yield 2, "no point", grid()[:0], read, ("refused",)
    yield 4, "millimetres", grid() * 1000, read, ("warned",)
    yield 4, "micrometres as metres", grid() / 1e6, read, ("warned",)
    yield 4, "beyond what can be reckoned with", grid() * 1e200, read_and_fit, ("refused",)
    yield 9, "all on a line, and a plane is asked for", grid() * [1, 0, 0], read_and_fit, ("refused",)
    yield 9, "all in one place, and a plane is asked for", grid() * 0, read_and_fit, ("refused",)
    yield 9, "two points, and a plane is asked for", grid()[:2], read_and_fit, ("refused",)


def cases() -> Iterator[Case]:
    """All bad point files."""
    for kind, name, points, reads, expected in clouds():
        for reader, raw in RAW.items():
            yield Case(kind, reader, name, lambda f, raw=raw, p=points: raw(f, p), reads, expected)
    for reader in RAW:
        suffix = {"text points": "xyz"}.get(reader, reader[:3].lower())
        for share in (0.1, 0.5):
            if reader != "text points":
                yield Case(
                    5, reader, f"cut at {share:.0%}", spoilt(reader, lambda d, s=share: cut(d, s)), read
                )
        yield Case(5, reader, "cut within a line", spoilt(reader, lambda d: d[:-6]), read)
        yield Case(5, reader, "0 bytes", spoilt(reader, lambda _: b""), read)
        yield Case(5, reader, "random bytes", spoilt(reader, lambda _: bytes(range(256)) * 8), read)
        yield Case(5, reader, "a folder", lambda f, s=suffix: folder_called(f, f"a.{s}"), read)
    for suffix in ("las", "e57", "ptx"):
        reader = f"{suffix.upper()} points"
        for share in (0.05, 0.5, 0.99):
            change = scans.spoilt(suffix, lambda d, s=share: cut(d, s))
            yield Case(5, reader, f"cut at {share:.0%}", change, read)
        yield Case(5, reader, "random bytes", scans.spoilt(suffix, lambda _: bytes(range(256)) * 8), read)
    yield Case(
        5,
        "PLY points",
        "more points announced",
        spoilt("PLY points", lambda d: d.replace(b"vertex 48", b"vertex 49")),
        read,
    )
    yield Case(
        5,
        "PLY points",
        "fewer points announced",
        spoilt("PLY points", lambda d: d.replace(b"vertex 48", b"vertex 47")),
        read,
    )
    yield Case(
        5,
        "PLY points",
        "text called binary",
        spoilt("PLY points", lambda d: d.replace(b"ascii", b"binary_big_endian")),
        read,
        ("refused", "warned"),
    )
    yield Case(
        5,
        "PCD points",
        "more points announced",
        spoilt("PCD points", lambda d: d.replace(b" 48", b" 49")),
        read,
    )
    yield Case(
        5,
        "PCD points",
        "fewer points announced",
        spoilt("PCD points", lambda d: d.replace(b" 48", b" 47")),
        read,
    )
    yield Case(
        5,
        "text points",
        "another number of points announced",
        spoilt("text points", lambda d: b"49\n" + d),
        read,
    )
    yield Case(5, "text points", "a line of words", spoilt("text points", lambda d: d + b"and so on\n"), read)
    yield Case(
        6,
        "PLY points",
        "10^12 points announced",
        spoilt("PLY points", lambda d: d.replace(b"vertex 48", b"vertex 1000000000000")),
        read,
    )
    yield Case(
        6,
        "PCD points",
        "10^12 points announced",
        spoilt("PCD points", lambda d: d.replace(b" 48", b" 1000000000000")),
        read,
    )
    yield Case(6, "npz points", "300 MB of zeros in 300 KB", scans.npz_bomb, read)
    yield Case(
        6,
        "LAS points",
        "10^15 points announced",
        scans.spoilt("las", lambda d: d[:247] + struct.pack("<Q", 10**15) + d[255:]),
        read,
    )
    yield Case(
        6,
        "E57 points",
        "10^12 points announced",
        scans.spoilt("e57", scans.e57_xml(lambda x: x.replace(b'recordCount="', b'recordCount="1000000000'))),
        read,
    )
    yield Case(
        6,
        "E57 points",
        "entities that double 30 times",
        scans.spoilt("e57", scans.e57_xml(scans.laughing_xml)),
        read,
    )
    yield Case(
        6,
        "PTX points",
        "10^9 x 10^9 points announced",
        scans.spoilt("ptx", lambda d: b"1000000000\n" * 2 + d.split(b"\n", 2)[2]),
        read,
    )
    yield Case(8, "npz points", "three rows of n numbers", lambda f: write_npz(f, grid().T), read)
    yield Case(16, "npz points", "points that are objects", objects, read)


def objects(folder: Path) -> Path:
    np.savez(folder / "a.npz", points=np.full((4, 3), None), allow_pickle=True)
    return folder / "a.npz"
