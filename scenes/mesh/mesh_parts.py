# SPDX-License-Identifier: MIT
"""Mesh parts for files: a labelled mesh by surface and texture image, and its origin in files; thinning."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenes.checks import ColourArray, FloatArray, InputError
from scenes.mesh.labelled_mesh import Appearance, LabelledMesh

_FINE_M = 1e-5  # rounding that is no matter


@dataclass(frozen=True, slots=True, eq=False)
class MeshPart:
    """Faces of one surface that look alike: with one image, or with colours.

    Attributes
    ----------
    name : str
        The surface's name, numbered where it has several parts.
    vertices : (n, 3) float
        World coordinates, metres.
    faces : (m, 3) int64
        Corners.
    surface : int
        Id of the surface.
    colour : (n, 3) uint8, optional
        sRGB; where there is an image it multiplies it. None for a mesh without appearance.
    image : (h, w, 3) uint8, optional
        Texture.
    uv : (n, 2) float32, optional
        Texture coordinates, (0, 0) the lower left corner.
    block : str
        The block of space that it is in, of large models (`scenes.mesh.blocks`); "" for none.
    """

    name: str
    vertices: FloatArray
    faces: NDArray[np.int64]
    surface: int
    colour: ColourArray | None = None
    image: ColourArray | None = None
    uv: NDArray[np.float32] | None = None
    block: str = ""


def parts_of(mesh: LabelledMesh, names: Sequence[str]) -> list[MeshPart]:
    """Return the parts of a mesh, in the order of its surfaces and images; each surface id has a name.

    Raises InputError: a face names a surface without name.
    """
    if len(mesh.faces) and not 0 <= int(mesh.face_surface.min()) <= int(mesh.face_surface.max()) < len(names):
        raise InputError(f"faces name surface {int(mesh.face_surface.max())}, there are {len(names)} names")
    look = mesh.appearance
    image = np.full(len(mesh.faces), -1, np.int32)
    if look is not None and look.face_image is not None and look.corner_uv is not None:
        image = look.face_image
    parts: list[MeshPart] = []
    for surface, number in sorted(set(zip(mesh.face_surface.tolist(), image.tolist(), strict=True))):
        chosen = np.flatnonzero((mesh.face_surface == surface) & (image == number))
        earlier = sum(part.surface == surface for part in parts)
        name = names[surface] if not earlier else f"{names[surface]} {earlier + 1}"
        parts.append(_part(mesh, look, chosen=chosen, surface=int(surface), number=int(number), name=name))
    return parts


def _part(
    mesh: LabelledMesh,
    look: Appearance | None,
    chosen: NDArray[np.int64],
    surface: int,
    number: int,
    name: str,
) -> MeshPart:
    """The chosen faces; a vertex for each place, colour and texture coordinate."""
    corner = mesh.faces[chosen].ravel().astype(np.int64)
    if look is None:
        used, faces = np.unique(corner, return_inverse=True)
        return MeshPart(name, mesh.vertices[used], faces.reshape(-1, 3), surface)
    colour = np.rint(look.corner_colour[chosen].reshape(-1, 3) * 255).clip(0, 255).astype(np.uint8)
    key = [corner[:, None], colour.astype(np.int64)]
    uv = None
    if number >= 0 and look.corner_uv is not None:
        uv = look.corner_uv[chosen].reshape(-1, 2)
        key.append(uv.view(np.int32).astype(np.int64))
    _, first, faces = np.unique(np.hstack(key), axis=0, return_index=True, return_inverse=True)
    return MeshPart(
        name=name,
        vertices=mesh.vertices[corner[first]],
        faces=faces.reshape(-1, 3),
        surface=surface,
        colour=colour[first],
        image=look.images[number] if number >= 0 else None,
        uv=None if uv is None else uv[first],
    )


def local_origin(points: FloatArray) -> FloatArray:
    """Return the origin (3,), in whole metres, about which `points` (n, 3) are to be written as float32.

    Zero where they are near enough to the world's own: rounding stays below 0.01 mm, or would hardly change
    because they reach about as far as they are away.

    Examples
    --------
    >>> local_origin(np.array([[500000.2, 5000000.0, 100.0], [500002.0, 5000003.0, 101.0]])).tolist()
    [500001.0, 5000002.0, 100.0]
    >>> local_origin(np.array([[-3.0, 0.0, 0.0], [9.0, 1.0, 2.0]])).tolist()
    [0.0, 0.0, 0.0]
    """
    if not len(points):
        return np.zeros(3)
    low, high = points.min(axis=0), points.max(axis=0)
    middle = (low + high) / 2
    step = float(np.spacing(np.float32(np.abs([low, high]).max())))
    is_near = step < _FINE_M or np.linalg.norm(middle) < np.linalg.norm(high - low)
    return np.zeros(3) if is_near else np.round(middle)


_COARSER = 1.25  # each try


def thin_mesh(
    vertices: FloatArray, faces: NDArray[Any], most: int
) -> tuple[FloatArray, NDArray[np.int64], NDArray[np.int64]]:
    """Join vertices that lie in one cell of a lattice, as coarse as it takes (Rossignac & Borrel 1993).

    A mesh (n, 3), metres, (m, 3) with no more than `most` triangles stays as it is. Returns the vertices (k,
    3) and faces (l, 3) of a thinner mesh, and which of the vertices (k,) it consists of.
    """
    faces = np.asarray(faces, dtype=np.int64)
    kept = np.arange(len(vertices))
    if len(faces) <= most:
        return vertices, faces, kept
    low = vertices.min(axis=0)
    area = np.linalg.norm(np.cross(*(vertices[faces[:, k]] - vertices[faces[:, 0]] for k in (1, 2))), axis=1)
    side, few = float(np.sqrt(area.sum() / most)) / 2, faces
    while len(few) > most:
        cell = np.floor((vertices - low) / side).astype(np.int64)
        _, kept, index = np.unique(cell, axis=0, return_index=True, return_inverse=True)
        few = index.reshape(-1)[faces]
        few = few[(few[:, 0] != few[:, 1]) & (few[:, 1] != few[:, 2]) & (few[:, 0] != few[:, 2])]
        side *= _COARSER
    return vertices[kept], few, kept
