# SPDX-License-Identifier: MIT
"""Mesh files: each checked before trimesh reads it, which then opens nothing outside its folder."""

from __future__ import annotations

import io
import logging
import re
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenes.checks import InputError
from scenes.io.crs import LengthUnit
from scenes.io.documents import Beside, check_references
from scenes.io.format import format_of
from scenes.io.gltf import Contents, check_gltf, read_gltf
from scenes.io.guard import check_file
from scenes.io.ifc import read_ifc
from scenes.io.limits import check_limit
from scenes.io.obj import check_obj, plain_obj
from scenes.io.off import read_off
from scenes.io.plain_gltf import plain_glb
from scenes.io.ply import check_ply, has_faces, plain_ply
from scenes.io.stl import check_stl, plain_stl, stl_origin
from scenes.mesh.appearance import PlacedGeometry, look_of
from scenes.mesh.design import Design, Element

MESH_SUFFIXES = (".glb", ".gltf", ".obj", ".ply", ".stl", ".off", ".ifc")
_NAMELESS = re.compile(
    r"^\d+$|_[0-9a-f]{6}$"
)  # node numbers, and what trimesh draws at random for parts of one
# What trimesh logs of files is said by our warnings; without a handler it would go to the standard error.
logging.getLogger("trimesh").addHandler(logging.NullHandler())


@dataclass(frozen=True, slots=True, eq=False)
class MeshFile:
    """A mesh file.

    Attributes
    ----------
    parts : list of PlacedGeometry
        Its geometries where they are placed, in the file's frame and unit.
    design : Design
        What it tells of them.
    n_faces : int
        Triangles that it holds by its own structure, as placed.
    warnings : tuple of str
        What it names and is not there.
    unit : LengthUnit, optional
        What the file states of its lengths.
    body : (m,) int64, optional
        Which of its faces are of one solid; None where it does not tell.
    """

    parts: list[PlacedGeometry]
    design: Design
    n_faces: int
    warnings: tuple[str, ...]
    unit: LengthUnit | None = None
    body: NDArray[np.int64] | None = None


def is_mesh(path: str | PathLike[str]) -> bool:
    """Tell whether a file is a mesh by its suffix, or a PLY whose header announces faces."""
    file = Path(path)
    suffix = file.suffix.lower()
    return has_faces(file) if suffix == ".ply" else suffix in MESH_SUFFIXES


def check_mesh_suffix(path: Path) -> Path:
    """Return `path` when it is a file that ends like a mesh.

    Raises InputError otherwise; for files of scans with the cure.
    """
    file = check_file(path)
    suffix = file.suffix.lower()
    if suffix in MESH_SUFFIXES:
        return file
    if (known := format_of(suffix)) is not None and not known.is_text:
        raise InputError(
            f"{file}: {file.suffix} holds a scan or points, not a scene; give scans with --scans, "
            "or complete them (unseen complete)"
        )
    names = ", ".join(name[1:] for name in MESH_SUFFIXES)
    raise InputError(f"{file}: cannot read meshes from {suffix or 'a file without suffix'}; known: {names}")


def read_mesh_file(file: Path) -> MeshFile:
    """Check and read a mesh file, or one of IFC, of one of `MESH_SUFFIXES`.

    Raises InputError: whatever its structure gets wrong, a file that it names outside its folder, or more
    than the limits allow.
    """
    if file.suffix.lower() == ".ifc":
        ifc = read_ifc(file)
        return MeshFile(ifc.parts, ifc.design, len(ifc.body), ifc.warnings, unit=ifc.unit, body=ifc.body)
    placed, n_faces, warnings = _read_placed(file)
    parts = [part for node in placed.graph.nodes_geometry if (part := _part(placed, node)) is not None]
    return MeshFile(parts, Design(tuple(Element(part.name) for part in parts)), n_faces, warnings)


def _read_placed(file: Path) -> tuple[Any, int, tuple[str, ...]]:
    """A trimesh scene, how many triangles the file holds by its structure, and warnings."""
    suffix = file.suffix.lower()
    data, held = b"", Contents(0)
    if suffix in (".glb", ".gltf"):
        gltf = read_gltf(file)
        beside = check_references(file, gltf.content)
        held = check_gltf(gltf.content, gltf.buffers)
        if (plain := plain_glb(gltf)) is not None:
            gltf, data = plain
            suffix, held = ".glb", check_gltf(gltf.content, gltf.buffers)
    else:
        beside = check_references(file)
    if suffix == ".obj":
        data = plain_obj(file.read_bytes())
        held = Contents(check_obj(data))
    elif suffix == ".ply":
        data = plain_ply(file.read_bytes())
        held = Contents(check_ply(data))
    elif suffix == ".stl":
        data = plain_stl(file.read_bytes())
        held = Contents(check_stl(data))
    check_limit("texels", beside.texels + held.texels, "texels of its textures")
    if suffix == ".off":
        placed = _read_off(file)
        return placed, sum(len(geometry.faces) for geometry in placed.geometry.values()), beside.warnings
    import trimesh  # slow to load: only where a mesh is read

    stream = io.BytesIO(data or file.read_bytes())
    placed = trimesh.load_scene(
        stream, file_type=suffix[1:], resolver=Beside(file), process=False, split_objects=True
    )
    if suffix == ".stl":
        placed.apply_translation(stl_origin(file))
    return placed, held.faces, beside.warnings


def _read_off(file: Path) -> Any:
    """An OFF file, which is read here since trimesh leaves its colours out."""
    import trimesh  # slow to load: only where a mesh is read

    off = read_off(file)
    colours = {"vertex_colors": off.vertex_colour, "face_colors": off.face_colour}
    return trimesh.Scene({file.name: trimesh.Trimesh(off.vertices, off.faces, process=False, **colours)})


def _part(placed: Any, node: str) -> PlacedGeometry | None:
    """Return a node's geometry in the file's world frame, None for points and lines."""
    transform, key = placed.graph[node]
    geometry = placed.geometry[key]
    if np.shape(getattr(geometry, "faces", ()))[1:] != (3,):
        return None
    matrix = np.asarray(transform, dtype=np.float64)
    with np.errstate(invalid="ignore"):  # what is not finite is counted later
        vertices = np.asarray(geometry.vertices, dtype=np.float64) @ matrix[:3, :3].T + matrix[:3, 3]
    faces, look = np.asarray(geometry.faces), look_of(geometry)
    if np.linalg.det(matrix[:3, :3]) < 0:  # mirrored by its transform: keep the outside outside
        faces, look = faces[:, ::-1], look.flip()
    return PlacedGeometry(str(key) if _NAMELESS.search(str(node)) else str(node), vertices, faces, look)
