# SPDX-License-Identifier: MIT
"""Files of parts: points or a mesh, and the labels of surfaces that they hold."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scenes.checks import FloatArray, IntArray, freeze_arrays
from scenes.io.format import Units
from scenes.io.mesh_file import is_mesh
from scenes.io.point_files import read_points
from scenes.io.scan_files import split_index
from scenes.io.scene_files import load_scene
from scenes.mesh.labelled_mesh import LabelledMesh

_LARGE_M = 20.0  # diagonal of a part beyond which its unit is doubted


@dataclass(frozen=True, slots=True, eq=False)
class PartFile:
    """What a file holds of a part.

    Attributes
    ----------
    points : (n, 3) float
        World coordinates, metres; of a mesh its vertices.
    mesh : LabelledMesh, optional
        The mesh, where it is one.
    normals : (n, 3) float, optional
        Of points, where the file holds one for each.
    label : (n,) int, optional
        What the file calls the surface of each point; 0 and less for none.
    rows, n_rows : (n,) int or None, int
        Place of each point among all of the file, where some were left out; see `PointCloud`.
    warnings : tuple of str
        What was left out or is doubtful.
    """

    points: FloatArray
    n_rows: int
    mesh: LabelledMesh | None = None
    normals: FloatArray | None = None
    label: IntArray | None = None
    rows: IntArray | None = None
    warnings: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        freeze_arrays(self)


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
    warnings = (*cloud.warnings, *_doubts(cloud.points))
    return PartFile(
        points=cloud.points,
        normals=normals,
        label=cloud.label,
        rows=cloud.rows,
        n_rows=cloud.n_rows,
        warnings=warnings,
    )


def _from_mesh(path: Path, units: Units) -> PartFile:
    """A mesh; the labels of its vertices where a PLY file holds them for as many."""
    mesh = load_scene(path, units=units, mode="object").mesh
    label = None
    if path.suffix.lower() == ".ply":
        label = read_points(path, units).label
        label = label if label is not None and len(label) == len(mesh.vertices) else None
    return PartFile(
        points=mesh.vertices,
        mesh=mesh,
        label=label,
        n_rows=len(mesh.vertices),
        warnings=_doubts(mesh.vertices),
    )


def _doubts(points: FloatArray) -> tuple[str, ...]:
    diagonal = float(np.linalg.norm(np.ptp(points, axis=0)))
    if diagonal <= _LARGE_M:
        return ()
    return (f"the diagonal is {diagonal:.3g} m; if the file is in mm, cm or in give --units",)
