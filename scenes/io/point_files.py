# SPDX-License-Identifier: MIT
"""Files of points, without grid or sensor position, and of parts: points or a mesh, with surface labels."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from scenes.checks import (
    ArrayValue,
    BoolArray,
    ColourArray,
    FloatArray,
    InputError,
    IntArray,
    Value,
    check_point,
    frozen_copy,
    usable_rows,
)
from scenes.io.checks.guard import check_file, guard_reading
from scenes.io.formats.format import (
    METRES_PER_UNIT,
    RawPoints,
    Units,
    check_own_unit,
    check_units,
    format_of,
    metres_of,
    point_suffixes,
    points_of,
    step_warnings,
)
from scenes.io.meshes.mesh_file import is_mesh
from scenes.io.scan_files import open_scans, split_index
from scenes.io.scene_files import load_scene, rounding_doubts, single_steps
from scenes.limits import LARGE_PART_M
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.run.libraries import import_extra, open3d_cloud
from scenes.scan.colour import unit_colour

_NO_HEIGHTS = (-9999.0, -99999.0, -999999.0, -32767.0, -32768.0)  # rasters' numbers for no data
_MOST_LABEL = 2**31 - 1


@dataclass(frozen=True, slots=True, eq=False)
class PointCloud(Value):
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
    step_m : float
        Between the values that coordinates can take, metres; 0 where they are not rounded.
    metres_per_unit : (3,) float
        Of the file's coordinates along x, y and z.
    times : (n,) float, optional
        When each point was measured, seconds on the file's own clock; NaN where the file does not tell.
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
    step_m: float = 0.0
    metres_per_unit: FloatArray = field(default_factory=lambda: np.ones(3))
    times: FloatArray | None = None

    def __post_init__(self) -> None:
        for name in ("points", "normals", "origins", "metres_per_unit", "times"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, frozen_copy(getattr(self, name), np.float64))
        if self.colour is not None:
            object.__setattr__(self, "colour", frozen_copy(self.colour, np.uint8))
        for name in ("label", "rows"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, frozen_copy(getattr(self, name), np.int64))
        object.__setattr__(self, "n_rows", max(self.n_rows, len(self.points)))

    def to_open3d(self) -> Any:
        """Return it as an `open3d.geometry.PointCloud`; raises InputError without Open3D."""
        colour = None if self.colour is None else unit_colour(self.colour)
        return open3d_cloud(self.points, colour, self.normals)

    def to_pandas(self) -> Any:
        """Return a `pandas.DataFrame` of x, y, z and what else the file has; raises InputError without it."""
        columns: dict[str, Any] = dict(zip("xyz", self.points.T, strict=True))
        if self.colour is not None:
            columns |= dict(zip(("red", "green", "blue"), self.colour.T, strict=True))
        more = {"label": self.label, "time_s": self.times}
        return import_extra("pandas", "pandas").DataFrame(
            columns | {name: held for name, held in more.items() if held is not None}
        )

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
    units : "mm", "cm", "m", "in", "ft" or "us-ft"
        Unit of the lengths in the file.

    Raises
    ------
    InputError
        Unusable file: the message names file, line where there are lines, cause and cure.
    """
    check_units(units)
    source, number = split_index(path)
    if not source.exists():
        raise InputError(f"{source}: no such file or folder")
    if source.is_dir():  # its scans come in metres
        raw, units = points_of(open_scans(source).read(number, units=units)), "m"
    else:
        known = format_of(check_file(source).suffix)
        if known is None or known.points is None:
            raise InputError(
                f"{source}: cannot read points from {source.suffix.lower() or 'a file without suffix'}; "
                f"known: {', '.join(point_suffixes())}, RGB-D folders"
            )
        if known.unit is not None:
            check_own_unit(source, known.name, known.unit, units)
            units = "m"
        with guard_reading(source, f"points in {source.suffix[1:].upper()} format"):
            raw = known.points(source, number)
    name = source.name if number is None else f"{source.name}#{number}"
    cloud = _cloud(raw, units, name)
    if not len(cloud.points):
        raise InputError(f"{source}: holds no finite point")
    return cloud


def _cloud(raw: RawPoints, units: Units, name: str) -> PointCloud:
    """The finite points, in metres."""
    metres, sentences = metres_of(raw.unit, units)
    is_usable, normals, origins = usable_rows(raw.points), raw.normals, raw.origins
    step_m = raw.step * float(metres.max())
    warnings = (*raw.warnings, *sentences, *step_warnings(step_m))
    is_none, number = _without_height(raw.points)
    n_all, n_bad, n_none = len(is_usable), int((~is_usable).sum()), int((is_none & is_usable).sum())
    if n_none:
        warnings += (f"{n_none} of {n_all} points have the height {number:g}, which says none: left out",)
        is_usable = is_usable & ~is_none
    if n_bad:
        warnings += (f"{n_bad} of {n_all} points are not finite or lie beyond 1e12 m and were left out",)
    are_all = not (n_bad or n_none)
    kept = slice(None) if are_all else np.flatnonzero(is_usable)
    if not step_m:
        steps_m = single_steps(raw.points[kept], metres)
        warnings += rounding_doubts(raw.points[kept], metres, steps_m)
        step_m = float(steps_m.max())
    if normals is not None:
        normals = np.nan_to_num(normals[kept], nan=0.0, posinf=0.0, neginf=0.0)
    if origins is not None:
        origins = np.broadcast_to(origins, raw.points.shape)[kept] * metres
    colour = None if raw.colour is None else raw.colour[kept]
    return PointCloud(
        points=raw.points[kept] if (metres == 1).all() else raw.points[kept] * metres,
        normals=normals,
        origins=origins,
        colour=colour,
        name=name,
        warnings=warnings,
        label=None if raw.label is None else _labels(raw.label[kept], name),
        rows=None if are_all else np.flatnonzero(is_usable),
        n_rows=len(is_usable),
        step_m=step_m,
        metres_per_unit=metres,
        times=None if raw.times is None else raw.times[kept],
    )


def _without_height(points: FloatArray) -> tuple[BoolArray, float]:
    """Which points (n, 3) have a height that stands for none, far below all others, and that number."""
    for number in _NO_HEIGHTS:
        is_none = np.asarray(points[:, 2] == number)
        if is_none.any() and not (points[~is_none, 2] < number / 2).any():
            return is_none, number
    return np.zeros(len(points), np.bool_), 0.0


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


@dataclass(frozen=True, slots=True, eq=False)
class PartFile(ArrayValue):
    """What a file holds of a part.

    Attributes
    ----------
    points : (n, 3) float
        World coordinates, metres; of a mesh its vertices.
    mesh : LabelledMesh, optional
        The mesh, where it is one.
    normals : (n, 3) float, optional
        Of points, where the file holds one for each.
    origins : (n, 3) float, optional
        Of points, where the scanner stood that measured each, metres; None where the file does not tell.
    label : (n,) int, optional
        What the file calls the surface of each point; 0 and less for none.
    rows, n_rows : (n,) int or None, int
        Place of each point among all of the file, where some were left out; see `PointCloud`.
    warnings : tuple of str
        What was left out or is doubtful.
    step_m : float
        As of `PointCloud`.
    """

    points: FloatArray
    n_rows: int
    mesh: LabelledMesh | None = None
    normals: FloatArray | None = None
    origins: FloatArray | None = None
    label: IntArray | None = None
    rows: IntArray | None = None
    warnings: tuple[str, ...] = ()
    step_m: float = 0.0


def read_part_file(path: str | os.PathLike[str], units: Units = "m") -> PartFile:
    """Read points, as `read_points` does, or a mesh, as `load_scene` does: a PLY file with faces is one.

    Raises InputError: an unusable file; the message names file, cause and cure.
    """
    source, number = split_index(path)
    if number is None and is_mesh(source):
        return _from_mesh(source, units)
    cloud = read_points(path, units)
    normals = cloud.normals
    if normals is not None and not (np.linalg.norm(normals, axis=1) > 0).all():
        normals = None  # some are unknown
    warnings = (*cloud.warnings, *_doubts(cloud.points), *_one_sided(cloud))
    return PartFile(
        points=cloud.points,
        normals=normals,
        origins=cloud.origins,
        label=cloud.label,
        rows=cloud.rows,
        n_rows=cloud.n_rows,
        warnings=warnings,
        step_m=cloud.step_m,
    )


def _from_mesh(path: Path, units: Units) -> PartFile:
    """A mesh; the labels of its vertices where a PLY file holds them for as many."""
    scene, metres = load_scene(path, up="z", units=units, mode="object"), METRES_PER_UNIT[units]
    mesh = scene.mesh
    label = None
    if path.suffix.lower() == ".ply":
        label = read_points(path, units).label
        label = label if label is not None and len(label) == len(mesh.vertices) else None
    return PartFile(
        points=mesh.vertices,
        mesh=mesh,
        label=label,
        n_rows=len(mesh.vertices),
        warnings=tuple(dict.fromkeys((*scene.warnings, *_doubts(mesh.vertices)))),
        step_m=float(single_steps(mesh.vertices / metres, metres).max()),
    )


def _one_sided(cloud: PointCloud) -> tuple[str, ...]:
    """What is told of points that a scanner measured from one place: a sentence, or none."""
    if cloud.origins is None or (cloud.origins != cloud.origins[0]).any():
        return ()
    near, far = np.quantile(np.linalg.norm(cloud.points - cloud.origins[0], axis=1), (0, 1))
    return (
        f"all points were measured from one place, {near:.2g} to {far:.2g} m away, and show one side: "
        "--backs infers others of a part; use `unseen complete` for rooms, plants and what stands in them",
    )


def _doubts(points: FloatArray) -> tuple[str, ...]:
    diagonal = float(np.linalg.norm(np.ptp(points, axis=0)))
    if diagonal <= LARGE_PART_M:
        return ()
    return (f"the diagonal is {diagonal:.3g} m; if that is wrong, --units says the file's unit",)
