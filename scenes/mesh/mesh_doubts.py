# SPDX-License-Identifier: MIT
"""Doubts about a mesh: what a user should know of its faces and coordinates before they are relied on."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from scenes.checks import BoolArray, FloatArray, InputError
from scenes.mesh.labelled_mesh import LabelledMesh

_FINE_M = 1e-3  # to which coordinates should be known
_MOST_SHARED = 2  # faces at an edge of a surface


def mesh_doubts(mesh: LabelledMesh) -> tuple[str, ...]:
    """Return warnings: faces without area, twice there, the other way round; coordinates that are rounded.

    Raises InputError: no face has an area, so that no ray can hit any.
    """
    has_area = mesh.face_areas() > 0
    if not has_area.any():
        raise InputError(f"none of its {len(mesh.faces)} faces has an area, so that no ray can hit any")
    return (*_face_doubts(mesh, has_area), *_coordinate_doubts(mesh.vertices))


def _face_doubts(mesh: LabelledMesh, has_area: BoolArray) -> Iterator[str]:
    n_faces, flat = len(mesh.faces), int((~has_area).sum())
    if flat:
        yield f"{flat} of {n_faces} faces have no area; no ray can hit them"
    faces = _welded(mesh)[has_area]
    single = _rows(np.sort(faces, axis=1))
    twice = len(faces) - len(single)
    if twice:
        yield f"{twice} of {n_faces} faces are there more than once; their area counts each time"
        faces = faces[single]
    edges = np.concatenate([faces[:, [k, (k + 1) % 3]] for k in range(3)])
    _, same = np.unique(_keys(edges), return_counts=True)
    _, shared = np.unique(_keys(np.sort(edges, axis=1)), return_counts=True)
    crowded = int((shared > _MOST_SHARED).sum())
    turned = int((same > 1).sum())
    if crowded:
        edges_are = "edge is" if crowded == 1 else "edges are"
        yield f"{crowded} {edges_are} shared by three faces or more; the surface branches there"
    elif turned:
        edges_have = "edge has both its" if turned == 1 else "edges have both their"
        yield (
            f"{turned} {edges_have} faces in one direction: some faces are turned the wrong way, so that "
            "inside and outside (--mode) may be mistaken"
        )


def _welded(mesh: LabelledMesh) -> NDArray[np.int64]:
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


def _coordinate_doubts(vertices: FloatArray) -> Iterator[str]:
    """A warning where coordinates went through 32-bit floats too far from the origin."""
    largest = np.float32(np.abs(vertices).max())
    step = float(np.spacing(largest))
    if step > _FINE_M and (vertices.astype(np.float32) == vertices).all():
        yield (
            f"coordinates up to {largest:.4g} m are stored in 32 bits, so they are rounded to steps of "
            f"{step:.2g} m; save the file about an origin of its own"
        )
