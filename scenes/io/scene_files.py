# SPDX-License-Identifier: MIT
"""Scene files: a mesh becomes a Scene, with textures, names and warnings, and is written again."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from scenes.checks import BoolArray, ColourArray, FloatArray, InputError
from scenes.io.checks.guard import guard_reading
from scenes.io.formats.format import Units, check_units, metres_of
from scenes.io.meshes.glb_writer import glb_of
from scenes.io.meshes.mesh_file import GLTF_SUFFIXES, check_mesh_suffix, read_mesh_file
from scenes.io.meshes.obj import write_obj
from scenes.io.meshes.off import write_off
from scenes.io.meshes.ply_writer import write_mesh_ply
from scenes.io.meshes.stl import write_stl
from scenes.limits import FINE_M, LARGE_M, SMALL_M
from scenes.mesh.appearance import PlacedGeometry, join_looks
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.mesh.mesh_parts import parts_of
from scenes.mesh.orientation import Axis, axis_in_file, decide_mode, suggest_up, world_from_file_up
from scenes.mesh.winding import turn_outside_out
from scenes.run.atomic import write_bytes
from scenes.world.scene import Mode, Scene

_MOST_SHARED = 2  # faces at an edge of a surface
_Z_UP = "the geometry shows that z is up, though glTF says y: z was taken; --up y says otherwise"
_EXACT = 1e-15  # of the largest coordinate: what a change of units leaves
_NEGLIGIBLE_M = 1e-5  # steps
_FEW = 10_000  # points that tell whether all went through 32 bits


def mesh_doubts(
    mesh: LabelledMesh, metres: float | FloatArray = 1.0, body: NDArray[np.int64] | None = None
) -> tuple[str, ...]:
    """Return warnings: faces without area, twice there, the other way round; coordinates that are rounded.

    `metres` is the unit of its vertices, one for all or one of each axis (3,). Faces of
    different bodies (m,) meet at no edge.

    Raises InputError: no face has an area, so that no ray can hit any.
    """
    has_area = mesh.face_areas() > 0
    if not has_area.any():
        raise InputError(f"none of its {len(mesh.faces)} faces has an area, so that no ray can hit any")
    return (
        *_face_doubts(mesh, has_area, body),
        *rounding_doubts(mesh.vertices, metres, single_steps(mesh.vertices, metres)),
    )


def _face_doubts(mesh: LabelledMesh, has_area: BoolArray, body: NDArray[np.int64] | None) -> Iterator[str]:
    n_faces, flat = len(mesh.faces), int((~has_area).sum())
    if flat:
        yield f"{flat} of {n_faces} faces have no area; no ray can hit them"
    faces = _weld(mesh)[has_area]
    single = _rows(np.sort(faces, axis=1))
    twice = len(faces) - len(single)
    if twice:
        yield f"{twice} of {n_faces} faces are there more than once; their area counts each time"
    faces = faces[single]
    if body is not None:
        numbers = faces + len(mesh.vertices) * body[has_area][single, None]
        faces = np.unique(numbers, return_inverse=True)[1].reshape(-1, 3).astype(np.int64)
    edges = np.concatenate([faces[:, [k, (k + 1) % 3]] for k in range(3)])
    _, same = np.unique(_keys(edges), return_counts=True)
    _, shared = np.unique(_keys(np.sort(edges, axis=1)), return_counts=True)
    crowded = int((shared > _MOST_SHARED).sum())
    turned = int((same > 1).sum())
    if crowded:
        edges_are = "edge is" if crowded == 1 else "edges are"
        yield f"{crowded} {edges_are} shared by three faces or more; the surface branches there"
    elif turned and body is None:  # closed bodies were turned, and open ones are told
        edges_have = "edge has both its" if turned == 1 else "edges have both their"
        yield (
            f"{turned} {edges_have} faces in one direction: some faces are turned the wrong way, so that "
            "inside and outside (--mode) may be mistaken"
        )


def _weld(mesh: LabelledMesh) -> NDArray[np.int64]:
    """Faces by places instead of vertices: those of one place have one number."""
    places = np.ascontiguousarray(mesh.vertices) + 0.0  # no negative zeros
    as_bytes = places.view(np.dtype((np.void, places.dtype.itemsize * 3))).reshape(-1)
    _, number = np.unique(as_bytes, return_inverse=True)
    return np.asarray(number, dtype=np.int64)[mesh.faces]


def _rows(faces: NDArray[np.int64]) -> NDArray[np.intp]:
    """The first of each kind of row."""
    wide = np.ascontiguousarray(faces).view(np.dtype((np.void, faces.dtype.itemsize * 3))).reshape(-1)
    return np.asarray(np.sort(np.unique(wide, return_index=True)[1]), dtype=np.intp)


def _keys(edges: NDArray[np.int64]) -> NDArray[np.int64]:
    """One number an edge."""
    return np.asarray(edges[:, 0] << np.int64(32) | edges[:, 1], dtype=np.int64)


def single_steps(points: FloatArray, metres: float | FloatArray) -> FloatArray:
    """Return the steps (3,) of coordinates (n, 3) that went through 32-bit floats, metres; 0 for others.

    So are steps below a hundredth of a millimetre.

    `metres` is their unit, one for all or one of each axis (3,).
    """
    largest = np.array([max(column.max(initial=0.0), -column.min(initial=0.0)) for column in points.T])
    few = points[:: -(-len(points) // _FEW) or 1]
    if not (np.abs(few.astype(np.float32) - few) <= _EXACT * largest).all():
        return np.zeros(3)
    steps = np.asarray(np.spacing(largest.astype(np.float32)) * metres, np.float64)
    return np.where(steps > _NEGLIGIBLE_M, steps, 0.0)


def rounding_doubts(points: FloatArray, metres: float | FloatArray, steps_m: FloatArray) -> tuple[str, ...]:
    """Return a warning where points (n, 3), as the file holds them, went through 32-bit floats too far away.

    `metres` is their unit, one for all or one of each axis (3,), `steps_m` (3,) what `single_steps` gives.
    """
    steps = np.unique(steps_m)
    if not steps[-1] > FINE_M:
        return ()
    rounded = " and ".join(f"{step:.2g}" for step in steps if step > FINE_M)
    return (
        f"coordinates up to {(np.abs(points) * metres).max():.4g} m are stored in 32 bits, so they are "
        f"rounded to steps of {rounded} m; save the file about an origin of its own",
    )


def open_scene(
    spec: str | os.PathLike[str], *, up: Axis | None = None, units: Units = "m", mode: Mode | None = None
) -> Scene:
    """Return `builtin:NAME`, or the scene of a mesh file.

    Parameters
    ----------
    spec : str or path
        What the command line takes as SCENE.
    up, units, mode
        Of mesh files, as for `load_scene`; built-in scenes know their own.

    Raises
    ------
    InputError
        As `builtin_scene` and `load_scene`.
    """
    text = os.fspath(spec)
    if not text.startswith("builtin:"):
        return load_scene(text, up=up, units=units, mode=mode)
    from scenes.world.builtin import builtin_scene  # scikit-image is slow to import and not needed for files

    return builtin_scene(text.removeprefix("builtin:"))


def load_scene(
    path: str | os.PathLike[str],
    *,
    up: Axis | None = None,
    units: Units = "m",
    mode: Mode | None = None,
    design: bool = False,
) -> Scene:
    """Read a mesh file: GLB, glTF, OBJ + MTL, PLY, STL or OFF; or IFC.

    Every placed geometry of the file, of an OBJ every object and material, becomes one surface with its name;
    its true surface is unknown (None). Groups of an OBJ are objects where there are no others. Textures,
    vertex and face colours are kept; base colours multiply. Which side of a face is outside is told by the
    order of its corners; normals in the file do not count.

    Of an IFC file every element with geometry becomes one surface, its openings cut, in the frame of the map
    where the file has a map conversion; `Scene.design` tells what it is.

    Parameters
    ----------
    path : str or path
        The file. Materials and textures beside it are only read from within its folder.
    up : "x", "y" or "z", optional
        Axis of the file that is up; it becomes the world's z. When not given it is z, but y of GLB and glTF
        (glTF 2.0, section 3.4), unless the geometry stands on z: that gives a warning.
    units : "mm", "cm", "m", "in", "ft" or "us-ft"
        Unit of the file's coordinates; metres where the file states another means that one.
    mode : "room" or "object", optional
        How to scan it; decided from the geometry when not given (see `scenes.mesh.orientation.decide_mode`).
    design : bool
        Whether its surfaces are bodies: those that are inside out are turned (see `scenes.mesh.winding`). IFC
        always is a design. Which axis of a design is up is not doubted: its scans tell.

    Raises
    ------
    InputError
        Missing, empty, damaged, no faces, vertices that are not finite, or a material, texture or buffer that
        is named outside the file's folder.
    """
    if up is not None and up not in get_args(Axis):
        raise InputError(f"unknown up axis {up!r}; known: x, y, z")
    check_units(units)
    file = check_mesh_suffix(Path(path))
    with guard_reading(file, "a mesh"):
        held = read_mesh_file(file)
        mesh, names = _join(file, held.parts)
        if len(mesh.faces) != held.n_faces:
            raise InputError(f"holds {held.n_faces} faces, of which {len(mesh.faces)} can be read")
        metres, told = metres_of(held.unit, units)
        body = mesh.face_surface.astype(np.int64) if design and held.body is None else held.body
        mesh, turned = (mesh, ()) if body is None else _turn_outside_out(mesh, metres, body)
        doubts = [*held.warnings, *told, *turned, *mesh_doubts(mesh, metres, body)]
        places = mesh.vertices * metres
        if held.design.conversion is not None:
            places = held.design.conversion.apply(places)
            doubts.append(held.design.conversion.sentence())
        mesh, chosen, said = _upright(mesh.at(places), up, is_gltf=file.suffix.lower() in GLTF_SUFFIXES)
        kind = decide_mode(mesh) if mode is None else mode
        is_design = design or bool(held.design.schema)
        doubts += [] if is_design else [*said, *_up_doubt(mesh, kind, chosen)]
        return Scene(
            mesh=mesh,
            surfaces=(None,) * len(names),
            surface_names=names,
            name=file.stem,
            mode=kind,
            warnings=(*doubts, *_size_doubt(mesh)),
            file_up=chosen,
            design=held.design,
        )


def _upright(
    mesh: LabelledMesh, up: Axis | None, *, is_gltf: bool
) -> tuple[LabelledMesh, Axis, tuple[str, ...]]:
    """A mesh of a file, metres, in the world; the axis that became z, and what is to be said of it."""
    chosen: Axis = up or ("y" if is_gltf else "z")
    turned = mesh.at(world_from_file_up(chosen).apply(mesh.vertices))
    if up is None and is_gltf and _stands_on_z(turned, mesh):
        return mesh, "z", (_Z_UP,)
    return turned, chosen, ()


def _stands_on_z(mesh: LabelledMesh, upright: LabelledMesh) -> bool:
    """Tell whether a mesh that was turned from y up stands on the file's z: as a room only, or clearly."""
    mode = decide_mode(mesh)
    if mode == "room":
        return False
    return suggest_up(mesh, mode) == "y" or decide_mode(upright) == "room"  # y of the world is the file's z


def _turn_outside_out(
    mesh: LabelledMesh, metres: FloatArray, body: NDArray[np.int64]
) -> tuple[LabelledMesh, tuple[str, ...]]:
    """The mesh of a design with the outside of its bodies outside, and what was done."""
    turned = turn_outside_out(mesh.at(mesh.vertices * metres), body)
    n_elements = int(mesh.face_surface.max()) + 1
    counted = (
        (
            turned.n_components,
            f"faces inside out were turned in {turned.n_components} closed components of "
            f"{turned.n_surfaces} of {n_elements} elements",
        ),
        (
            turned.n_open,
            f"not closed all round: {turned.n_open} of {n_elements} elements; which side of them is outside "
            "is as in the file",
        ),
    )
    return turned.mesh.at(mesh.vertices), tuple(sentence for count, sentence in counted if count)


def _join(file: Path, parts: list[PlacedGeometry]) -> tuple[LabelledMesh, tuple[str, ...]]:
    """Return all parts as one mesh, and the surfaces' names."""
    if not any(len(part.faces) for part in parts):
        raise InputError(
            f"{file}: holds no faces; a scene needs triangles (a point cloud is a scan, not a scene)"
        )
    vertices = np.vstack([part.vertices for part in parts])
    bad = int((~np.isfinite(vertices)).any(axis=1).sum())
    if bad:
        raise InputError(f"{file}: {bad} of {len(vertices)} vertices are not finite; repair the file first")
    starts = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    faces = np.vstack([part.faces + start for part, start in zip(parts, starts, strict=True)])
    labels = np.repeat(np.arange(len(parts), dtype=np.int32), [len(part.faces) for part in parts])
    appearance = join_looks([part.look for part in parts])
    return LabelledMesh(vertices, faces, labels, appearance), _unique_names([part.name for part in parts])


def _unique_names(names: list[str]) -> tuple[str, ...]:
    """Number repeated names from their second occurrence on."""
    seen: dict[str, int] = {}
    unique = []
    for name in names:
        seen[name] = seen.get(name, 0) + 1
        unique.append(name if seen[name] == 1 else f"{name} {seen[name]}")
    return tuple(unique)


def _up_doubt(mesh: LabelledMesh, mode: Mode, up: Axis) -> Iterator[str]:
    """Say which axis of a file looks vertical, if not the one that was taken."""
    suggested = suggest_up(mesh, mode)
    if suggested not in (None, "z"):
        axis = axis_in_file(suggested, up)
        yield f"the geometry suggests that {axis} is up, not {up}; give --up {axis} if so"


def _size_doubt(mesh: LabelledMesh) -> tuple[str, ...]:
    doubt = units_doubt(float(np.linalg.norm(np.diff(mesh.bounds(), axis=0))))
    return (doubt,) if doubt else ()


def units_doubt(diagonal_m: float) -> str:
    """Return a warning when a diagonal looks like another unit, "" otherwise."""
    if diagonal_m < SMALL_M:
        return f"the diagonal is {1000 * diagonal_m:.3g} mm; if that is wrong, --units says the file's unit"
    if diagonal_m > LARGE_M:
        return f"the diagonal is {diagonal_m:.3g} m; if that is wrong, --units says the file's unit"
    return ""


def save_scene(scene: Scene, path: str | os.PathLike[str]) -> list[Path]:
    """Write a scene by suffix, atomically; return the files that were written.

    `.glb` is y up by its nodes' transforms, as glTF asks, textured, a node a surface.
    `.obj` has an object a surface, materials and textures beside it. `.ply` and `.off` hold colours at the
    vertices, textures sampled there. `.stl` holds the geometry alone. All but GLB and STL are in double
    precision; these two are in single precision about an origin near the geometry (`local_origin`).

    Raises
    ------
    InputError
        Another suffix, or a folder that does not exist.
    """
    target = Path(path)
    mesh, names = scene.mesh, scene.surface_names
    writers: dict[str, Callable[[], list[Path] | None]] = {
        ".glb": lambda: write_bytes(target, glb_of(parts_of(mesh, names))),
        ".obj": lambda: write_obj(parts_of(mesh, names), target),
        ".ply": lambda: _write_ply(mesh, names, target),
        ".stl": lambda: write_stl(mesh, target),
        ".off": lambda: write_off(target, *_paint_vertices(mesh)),
    }
    writer = writers.get(target.suffix.lower())
    if writer is None:
        suffix = target.suffix or "a name without suffix"
        raise InputError(f"{target}: cannot write scenes to {suffix}; known: {', '.join(writers)}")
    return writer() or [target]


def _paint_vertices(mesh: LabelledMesh) -> tuple[FloatArray, Any, ColourArray | None]:
    """Vertices, faces and colours (n, 3) at the vertices; corners that differ in colour are parted."""
    if mesh.appearance is None:
        return mesh.vertices, mesh.faces, None
    faces = np.repeat(np.arange(len(mesh.faces), dtype=np.int32), 3)
    looked_up = mesh.appearance.colour(faces, np.tile(np.eye(3), (len(mesh.faces), 1)))
    colour = np.rint(looked_up * 255).clip(0, 255).astype(np.uint8)
    corner = mesh.faces.ravel()
    key = np.column_stack([corner, colour]).astype(np.int64)
    _, first, index = np.unique(key, axis=0, return_index=True, return_inverse=True)
    return mesh.vertices[corner[first]], index.reshape(-1, 3), colour[first]


def _write_ply(mesh: LabelledMesh, names: Sequence[str], path: Path) -> None:
    """PLY in double precision; the surfaces' names are in comments."""
    vertices, faces, colour = _paint_vertices(mesh)
    properties = {} if colour is None else dict(zip(("red", "green", "blue"), colour.T, strict=True))
    lines = [f"surface {number} {' '.join(name.split())}" for number, name in enumerate(names)]
    write_mesh_ply(path, vertices, faces, properties, lines)
