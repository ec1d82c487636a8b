# SPDX-License-Identifier: MIT
"""Point clouds: points of any file that holds some, without grid or sensor position, for fitting."""

from __future__ import annotations

import os
from dataclasses import dataclass

import numpy as np

from scenes.checks import ColourArray, FloatArray, InputError, IntArray, check_point, frozen_copy, usable_rows
from scenes.io.format import RawPoints, Units, points_of
from scenes.io.guard import check_file, reading
from scenes.io.registry import format_of, point_suffixes
from scenes.io.scan_files import check_own_unit, check_units, open_scans, split_index

_MOST_LABEL = 2**31 - 1


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
        `.xyz .txt .csv .pts .asc .ds` (text), `.ply .pcd .las .laz .e57 .npz .ptx .3d`, or an RGB-D folder.
        Scans give all their valid points in world coordinates, those of several scans one after the other. An
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
    if source.is_dir():  # its scans come in metres
        raw, metres = points_of(open_scans(source).read(number, units=units)), 1.0
    else:
        known = format_of(check_file(source).suffix)
        if known is None or known.points is None:
            raise InputError(
                f"{source}: cannot read points from {source.suffix.lower() or 'a file without suffix'}; "
                f"known: {', '.join(point_suffixes())}, RGB-D folders"
            )
        if known.unit is not None:
            check_own_unit(source, known.name, known.unit, units)
            metres = 1.0
        with reading(source, f"points in {source.suffix[1:].upper()} format"):
            raw = known.points(source, number)
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
