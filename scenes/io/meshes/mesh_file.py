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
from scenes.io.checks.documents import Beside, check_references, decode_text
from scenes.io.checks.guard import check_file
from scenes.io.checks.limits import check_limit
from scenes.io.formats.columns import unit_of_comment
from scenes.io.formats.crs import LengthUnit
from scenes.io.formats.facts import FormatFacts
from scenes.io.formats.format import format_of
from scenes.io.meshes.gltf import Contents, check_gltf, entry_list, read_gltf
from scenes.io.meshes.ifc import read_ifc
from scenes.io.meshes.obj import check_obj, cut_obj, number_objects, plain_obj, same_names_told
from scenes.io.meshes.off import read_off
from scenes.io.meshes.plain_gltf import plain_glb
from scenes.io.meshes.ply import check_ply, has_faces, plain_ply
from scenes.io.meshes.polygons import cut_ply
from scenes.io.meshes.stl import check_stl, plain_stl, stl_origin
from scenes.mesh.appearance import PlacedGeometry, look_of
from scenes.mesh.design import Design, Element

GLTF_SUFFIXES = (".glb", ".gltf")
_NAMELESS = re.compile(
    r"^\d+$|_[0-9a-f]{6}$"
)  # node numbers, and what trimesh draws at random for parts of one
_STL_HEADER, _COMMENTS = 80, 4096  # bytes


@dataclass(frozen=True, slots=True)
class MeshFormat:
    """A format of meshes: its suffixes, and its row of docs/format-table.md."""

    suffixes: tuple[str, ...]
    facts: FormatFacts


MESHES = (
    MeshFormat(
        (".glb", ".gltf"),
        FormatFacts(
            title="`.glb` `.gltf`",
            read=(
                "triangles, transforms of nodes, instances, quantised numbers; y is up unless only z makes "
                "a room"
            ),
            lost="Draco, meshopt, sparse accessors, fans are refused; cameras, animations, morphs",
            written="GLB: 1e-7 of the extent (float32 about an origin nearby that nodes hold in double)",
            poses="none: a mesh is a scene, or what scanners at `--origin` see of it",
            units="metres",
            colours="textures, of vertices, of materials (linear light)",
            noise="none",
        ),
    ),
    MeshFormat(
        (".obj",),
        FormatFacts(
            title="`.obj` with MTL",
            read="objects and materials are surfaces",
            lost="options before a map, curves",
            written="double, textures as PNG",
            poses="none: a mesh is a scene, or what scanners at `--origin` see of it",
            units="a comment such as `File units = inches`, else `--units`",
            colours="textures, of vertices (0 to 1, or bytes), of materials",
            noise="none",
        ),
    ),
    MeshFormat(
        (".ply",),
        FormatFacts(
            title="`.ply` with faces",
            read="triangles and polygons",
            lost="strips are refused",
            written="double",
            poses="none: a mesh is a scene, or what scanners at `--origin` see of it",
            units="a comment, else `--units`",
            colours="of vertices and faces; a texture that it names",
            noise="none",
        ),
    ),
    MeshFormat(
        (".stl",),
        FormatFacts(
            title="`.stl`",
            read="text or binary",
            lost="colours, attributes",
            written="binary float32 about an origin that the header names, which only we read back",
            poses="none: a mesh is a scene, or what scanners at `--origin` see of it",
            units="the header, as in `units=mm`, else `--units`",
            noise="none",
        ),
    ),
    MeshFormat(
        (".off",),
        FormatFacts(
            title="`.off`",
            read="OFF, COFF, NOFF, STOFF as text",
            lost="texture coordinates, normals",
            written="double",
            poses="none: a mesh is a scene, or what scanners at `--origin` see of it",
            colours="of vertices and faces",
            noise="none",
        ),
    ),
    MeshFormat(
        (".ifc",),
        FormatFacts(
            title="`.ifc` (`unseen[ifc]`)",
            read="elements with geometry, openings cut: class, name, GlobalId, storey, type, map conversion",
            lost="elements without a body, with a count; ifcXML, ifcZIP; spaces, grids, annotations",
            written="exports of completions",
            poses="none: a mesh is a scene, or what scanners at `--origin` see of it",
            units="the file's",
            colours="of items",
            noise="none",
        ),
    ),
)
MESH_SUFFIXES = tuple(suffix for mesh in MESHES for suffix in mesh.suffixes)
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
        What IFC states, or comments: lines of # (SketchUp writes "File units = inches"), comments of a PLY,
        the header of an STL.
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
    placed, n_faces, warnings, unit = _read_placed(file)
    parts = [part for node in placed.graph.nodes_geometry if (part := _part(placed, node)) is not None]
    return MeshFile(parts, Design(tuple(Element(part.name) for part in parts)), n_faces, warnings, unit=unit)


def _read_placed(file: Path) -> tuple[Any, int, tuple[str, ...], LengthUnit | None]:
    """A trimesh scene, how many triangles the file holds by its structure, warnings, and a stated unit."""
    suffix = file.suffix.lower()
    data, held, doubts = b"", Contents(0), tuple[str, ...]()
    if suffix in GLTF_SUFFIXES:
        gltf = read_gltf(file)
        beside = check_references(file, gltf.content)
        if "KHR_texture_transform" in entry_list(gltf.content, "extensionsUsed"):
            doubts = ("KHR_texture_transform is not applied: textures may be shifted or scaled",)
        held = check_gltf(gltf.content, gltf.buffers)
        named = [node["name"] for node in entry_list(gltf.content, "nodes") if {"mesh", "name"} <= {*node}]
        doubts = (*doubts, *same_names_told(len(named) - len({*map(str, named)}), len(named)))
        if (plain := plain_glb(gltf)) is not None:
            gltf, data = plain
            suffix, held = ".glb", check_gltf(gltf.content, gltf.buffers)
    else:
        beside = check_references(file)
    if suffix == ".obj":
        data = plain_obj(file.read_bytes())
        held = Contents(check_obj(data))
        data, doubts = number_objects(cut_obj(data))
    elif suffix == ".ply":
        data = plain_ply(file.read_bytes())
        held = Contents(check_ply(data))
        data = cut_ply(data)
    elif suffix == ".stl":
        data = plain_stl(file.read_bytes())
        held = Contents(check_stl(data))
    check_limit("texels", beside.texels + held.texels, "texels of its textures")
    if suffix == ".off":
        placed = _read_off(file)
        n_faces = sum(len(geometry.faces) for geometry in placed.geometry.values())
        return placed, n_faces, beside.warnings, None
    import trimesh  # slow to load: only where a mesh is read

    stream = io.BytesIO(data or file.read_bytes())
    placed = trimesh.load_scene(
        stream, file_type=suffix[1:], resolver=Beside(file), process=False, split_objects=True
    )
    if suffix == ".stl":
        placed.apply_translation(stl_origin(file))
    return placed, held.faces, (*beside.warnings, *doubts), unit_of_comment(_comments(data, suffix))


def _comments(data: bytes, suffix: str) -> str:
    """The comments before what a file holds."""
    if suffix == ".stl":
        return decode_text(data[:_STL_HEADER].split(b"\n")[0])
    lines = decode_text(data[:_COMMENTS]).splitlines()
    return "\n".join(line for line in lines if line.startswith(("#", "comment")))


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
