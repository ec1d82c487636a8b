# SPDX-License-Identifier: MIT
"""Point clouds: points of any file that holds some, without grid or sensor position, for fitting."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from scenes.checks import ColourArray, FloatArray, InputError, IntArray, check_point, frozen_copy, usable_rows
from scenes.files.scan_files import ScanSource, Units, check_units, itself, open_scans, split_index
from scenes.formats.arrays import open_arrays
from scenes.formats.e57.e57 import E57File
from scenes.formats.guard import check_file, reading
from scenes.formats.las.las import read_las_points
from scenes.formats.scans.cloud import RawPoints, joined
from scenes.formats.scans.npz import scans_in
from scenes.formats.scans.pcd import read_pcd_points
from scenes.formats.scans.point_table import read_point_table
from scenes.formats.scans.ptx import PtxFile
from scenes.formats.scans.scan_ply import is_scan_ply, read_ply_points
from scenes.scan.colour import colour_bytes
from scenes.scan.range_image import RangeImage

TEXT_SUFFIXES = (".xyz", ".txt", ".csv", ".ds", ".pts", ".asc")
_MOST_LABEL = 2**31 - 1
POINT_SUFFIXES = (*TEXT_SUFFIXES, ".ply", ".pcd", ".las", ".laz", ".e57", ".npz", ".ptx")


@dataclass(frozen=True, slots=True, eq=False)
class PointCloud:
    """Points of a file.

    Attributes
    ----------
    points : (n, 3) float
        World coordinates, metres, finite, at least one.
    normals : (n, 3) float, optional
        As in the file; rows may be zero where it knows none.
    origins : (n, 3) float, optional
        Where the scanner stood that measured each point, metres; None where the file does not tell.
    colour : (n, 3) uint8, optional
        sRGB.
    name : str
        The file's name, with #k where one scan was picked.
    warnings : tuple of str
        What was left out or assumed while reading.
    label : (n,) int, optional
        What the file calls the surface of each point; 0 and less for none.
    rows : (n,) int, optional
        Place of each point among all `n_rows` of the file, where some were left out.
    n_rows : int
        Points of the file, those that were left out too.
    """

    points: FloatArray
    normals: FloatArray | None = None
    origins: FloatArray | None = None
    colour: ColourArray | None = None
    name: str = ""
    warnings: tuple[str, ...] = ()
    label: IntArray | None = None
    rows: IntArray | None = None
    n_rows: int = 0

    def __post_init__(self) -> None:
        for field in ("points", "normals", "origins"):
            if getattr(self, field) is not None:
                object.__setattr__(self, field, frozen_copy(getattr(self, field), np.float64))
        if self.colour is not None:
            object.__setattr__(self, "colour", frozen_copy(self.colour, np.uint8))
        for field in ("label", "rows"):
            if getattr(self, field) is not None:
                object.__setattr__(self, field, frozen_copy(getattr(self, field), np.int64))
        object.__setattr__(self, "n_rows", max(self.n_rows, len(self.points)))

    def rays(self, origin: object | None = None) -> FloatArray:
        """The rays (n, 3), metres, from where the scanner stood to the points; `origin` (3,) if it is said.

        Raises
        ------
        InputError
            Neither the file nor `origin` tells where the scanner stood.
        """
        start = self.origins if origin is None else check_point("origin", origin)
        if start is None:
            raise InputError(f"{self.name} does not tell where the scanner stood; give --origin X,Y,Z")
        return np.asarray(self.points - start, dtype=np.float64)


def read_points(path: str | os.PathLike[str], units: Units = "m") -> PointCloud:
    """Return the points of a file, or of its k-th scan with `PATH#k`.

    Parameters
    ----------
    path : str or path
        `.xyz .txt .csv .pts .asc .ds` (text), `.ply .pcd .las .laz .e57 .npz .ptx`, or an RGB-D folder. Scans
        give all their valid points in world coordinates, those of several scans one after the other. An
        `.npz` holds `points` (n, 3) and perhaps `normals` and `label` (n,), or a scan. Labels of surfaces are
        also read from text with a column, and PLY with a property, of that name.
    units : "mm", "cm", "m" or "in"
        Unit of the lengths in the file.

    Raises
    ------
    InputError
        Unusable file: the message names file, line where there are lines, cause and cure.
    """
    metres = check_units(units)
    source, number = split_index(path)
    if not source.exists():
        raise InputError(f"{source}: no such file or folder")
    raw = (
        _from_scans(open_scans(source).read(number))
        if source.is_dir()
        else _from_file(check_file(source), number)
    )
    name = source.name if number is None else f"{source.name}#{number}"
    cloud = _cloud(raw, metres, name)
    if not len(cloud.points):
        raise InputError(f"{source}: holds no finite point")
    return cloud


def _cloud(raw: RawPoints, metres: float, name: str) -> PointCloud:
    """The finite points, in metres."""
    kept, normals, origins, warnings = usable_rows(raw.points), raw.normals, raw.origins, raw.warnings
    if not kept.all():
        n_left = int((~kept).sum())
        warnings += (f"{n_left} of {len(kept)} points are not finite or lie beyond 1e12 m and were left out",)
    if normals is not None:
        normals = np.nan_to_num(normals[kept], nan=0.0, posinf=0.0, neginf=0.0)
    if origins is not None:
        origins = np.broadcast_to(origins, raw.points.shape)[kept] * metres
    colour = None if raw.colour is None else raw.colour[kept]
    return PointCloud(
        points=raw.points[kept] * metres,
        normals=normals,
        origins=origins,
        colour=colour,
        name=name,
        warnings=warnings,
        label=None if raw.label is None else _labels(raw.label[kept], name),
        rows=None if kept.all() else np.flatnonzero(kept),
        n_rows=len(kept),
    )


def _labels(label: FloatArray, name: str) -> IntArray:
    """Labels as whole numbers; an empty field is none."""
    whole = np.nan_to_num(label, nan=0.0)
    strange = np.flatnonzero((whole != np.rint(whole)) | (np.abs(whole) > _MOST_LABEL))
    if len(strange):
        raise InputError(
            f"{name}: {len(strange)} of {len(label)} labels are no whole numbers up to {_MOST_LABEL} "
            f"(first {whole[strange[0]]:g}); rename the column `label` if it holds something else"
        )
    return whole.astype(np.int64)


def _from_file(file: Path, number: int | None) -> RawPoints:
    """Read a file by its suffix."""
    suffix = file.suffix.lower()
    if suffix not in POINT_SUFFIXES:
        raise InputError(
            f"{file}: cannot read points from {suffix or 'a file without suffix'}; known: "
            f"{', '.join(POINT_SUFFIXES)}, RGB-D folders"
        )
    readers: dict[str, Callable[[], RawPoints]] = {
        ".e57": partial(_from_several, E57File, file, number),
        ".ptx": partial(_from_several, PtxFile, file, number),
        ".npz": partial(_from_npz, file, number),
    }
    with reading(file, f"points in {suffix[1:].upper()} format"):
        if suffix in readers:
            return readers[suffix]()
        if number not in (None, 1):
            raise InputError(f"holds one cloud, so there is no #{number}")
        if suffix in TEXT_SUFFIXES:
            table = read_point_table(file)
            return RawPoints(table.points, table.normals, warnings=table.warnings, label=table.label)
        if suffix == ".ply":
            if is_scan_ply(file):
                return _from_scans(open_scans(file).read())
            return read_ply_points(file)
        if suffix == ".pcd":
            return read_pcd_points(file)
        return read_las_points(file)


def _from_scans(scans: Sequence[RangeImage]) -> RawPoints:
    """All valid points of organised scans, in the world."""
    found = []
    for scan in scans:
        colour = None if scan.colour is None else colour_bytes(scan.colour[scan.valid])
        found.append(RawPoints(scan.points()[scan.valid], origins=scan.origin, colour=colour))
    return joined(found)


def _from_several(opened: Callable[[Path], E57File | PtxFile], file: Path, number: int | None) -> RawPoints:
    """All valid points of the scans of a file, structured or not, or of the one that is picked."""
    scans = opened(file)
    n_scans = len(scans)
    if number is not None and not 1 <= number <= n_scans:
        raise InputError(f"there is no #{number}: there are {n_scans} scans, counted from 1")
    wanted = range(n_scans) if number is None else [number - 1]
    return joined([scans.points(index) for index in wanted])


def _from_npz(file: Path, number: int | None) -> RawPoints:
    """Arrays `points`, `normals` and `label`, or else a scan."""
    with open_arrays(file) as arrays:
        if "points" not in arrays.files:
            readers = tuple(partial(itself, scan) for scan in scans_in(arrays, file.stem))
            return _from_scans(ScanSource(file, "npz", readers).read(number))
        if number not in (None, 1):
            raise InputError(f"holds one cloud, so there is no #{number}")
        points = np.asarray(arrays["points"], dtype=np.float64)
        normals = np.asarray(arrays["normals"], np.float64) if "normals" in arrays.files else None
        label = np.asarray(arrays["label"], np.float64).ravel() if "label" in arrays.files else None
    if points.ndim < 2 or points.shape[-1] != 3 or (normals is not None and normals.shape != points.shape):
        shape = "" if normals is None else f" and normals {normals.shape}"
        raise InputError(
            f"expected points with shape (n, 3) and normals of the same, got {points.shape}{shape}"
        )
    points = points.reshape(-1, 3)
    if label is not None and len(label) != len(points):
        raise InputError(f"holds {len(label)} labels for {len(points)} points; give one a point")
    return RawPoints(points, None if normals is None else normals.reshape(-1, 3), label=label)
