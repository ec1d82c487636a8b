# SPDX-License-Identifier: MIT
"""Winding: closed components of a mesh with faces that are inside out, and their outside turned outside."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from scenes.checks import BoolArray, FloatArray
from scenes.mesh.labelled_mesh import Appearance, LabelledMesh

_SAME_M = 1e-6  # corners that are so near each other are one
_INSIDE = 0.75  # of a full solid angle: within is 1, outside 0


class TurnedMesh(NamedTuple):
    """A mesh whose closed components have their outside outside.

    Attributes
    ----------
    mesh : LabelledMesh
        The same faces; turned ones have their corners in reverse order.
    n_components : int
        How many had faces that were turned.
    n_surfaces : int
        How many surfaces they belong to.
    n_open : int
        Surfaces with faces of no closed component.
    """

    mesh: LabelledMesh
    n_components: int
    n_surfaces: int
    n_open: int


def turn_outside_out(mesh: LabelledMesh, body: NDArray[Any]) -> TurnedMesh:
    """Turn faces so that every closed component encloses a positive volume.

    A component are faces of one `body` (m,) that are joined at edges which two of them share. It is closed
    where its faces can be turned so that each edge is there as often in one direction as in the other.
    Cavities stay: components of negative volume inside a positive one of the same body, by the winding number
    of one of their corners (Jacobson et al. 2013, section 3).
    """
    faces, flipped = _sides(mesh, body)
    component = np.minimum(*flipped.T)
    corners = mesh.corners
    signed = _volumes(corners, component)
    volume = np.bincount(flipped[:, 0], signed, flipped.max() + 1)
    volume -= np.bincount(flipped[:, 1], signed, len(volume))
    # of the two ways to turn a component, that of positive volume; as it is where both are alike
    turned = volume[flipped[:, 1]] > volume[flipped[:, 0]]
    closed = (flipped[:, 0] != flipped[:, 1]) & _closed(faces, turned, component)[component]
    turned &= closed
    n_turned = np.bincount(component, turned, len(volume))
    inward = np.flatnonzero(n_turned == np.bincount(component, minlength=len(volume)))
    for k in inward[n_turned[inward] > 0]:
        own = component == k
        around = (body == body[own.argmax()]) & closed & ~turned & ~own
        if around.any() and _is_inside(corners[own.argmax(), 0], corners[around]):
            turned &= ~own
    look = mesh.appearance
    if look is not None:
        uv = None if look.corner_uv is None else _reverse(look.corner_uv, turned)
        look = Appearance(_reverse(look.corner_colour, turned), look.images, look.face_image, uv)
    surface = mesh.face_surface
    return TurnedMesh(
        LabelledMesh(mesh.vertices, _reverse(mesh.faces, turned), surface, look),
        len(np.unique(component[turned])),
        len(np.unique(surface[turned])),
        len(np.unique(surface[~closed])),
    )


def _sides(mesh: LabelledMesh, body: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Faces (m, 3) by places of their body, and the component (m, 2) of each face's two sides.

    Sides are joined as faces are that have an edge in opposite directions: those of a component that can be
    turned evenly are two components, those of a Moebius strip one.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    corner, n = mesh.faces.ravel(), len(mesh.faces)
    place = np.rint((mesh.vertices - mesh.vertices.min(axis=0)) / _SAME_M).astype(np.int64)[corner]
    key = np.column_stack([np.repeat(body, 3), place])
    faces = np.unique(key, axis=0, return_inverse=True)[1].reshape(-1, 3).astype(np.int64)
    edges = _edges(faces)
    _, edge, shared = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True, return_counts=True)
    order = np.argsort(edge.ravel(), kind="stable")
    pair = order[(shared == 2)[edge.ravel()[order]]].reshape(-1, 2)
    a, b = (pair % n).T
    same_way = edges[pair[:, 0], 0] == edges[pair[:, 1], 0]
    ends = np.concatenate([a, a + n]), np.concatenate([b + n * same_way, b + n * ~same_way])
    graph = coo_array((np.ones(len(ends[0]), np.bool_), ends), shape=(2 * n, 2 * n))
    return faces, connected_components(graph, directed=False)[1].reshape(2, n).T


def _edges(faces: NDArray[Any]) -> NDArray[Any]:
    """Directed edges (3 m, 2): all from corner 0 to 1, then 1 to 2, then 2 to 0."""
    return np.concatenate([faces[:, [k, (k + 1) % 3]] for k in range(3)])


def _volumes(corners: FloatArray, component: NDArray[Any]) -> FloatArray:
    """Six times the signed volumes (m,) between faces and the first corner of their component."""
    first = np.full(component.max() + 1, len(corners))
    np.minimum.at(first, component, np.arange(len(corners)))
    a, b, c = np.moveaxis(corners - corners[first[component], :1], 1, 0)
    volumes: FloatArray = np.einsum("ij,ij->i", a, np.cross(b, c))
    return volumes


def _closed(faces: NDArray[Any], turned: BoolArray, component: NDArray[Any]) -> BoolArray:
    """Which components have each edge as often in one direction as in the other, when faces are turned."""
    edges, of = _edges(faces), np.tile(component, 3)
    way = np.where(edges[:, 0] < edges[:, 1], 1, -1) * np.where(np.tile(turned, 3), -1, 1)
    way[edges[:, 0] == edges[:, 1]] = 0
    found, index = np.unique(np.column_stack([of, np.sort(edges, axis=1)]), axis=0, return_inverse=True)
    surplus = np.bincount(index.ravel(), way, len(found)) != 0
    return np.asarray(np.bincount(found[:, 0], surplus, component.max() + 1) == 0)


def _is_inside(place: FloatArray, corners: FloatArray) -> bool:
    """Tell whether a place (3,) is inside closed triangles (m, 3, 3): their solid angle is a full one."""
    a, b, c = np.moveaxis(corners - place, 1, 0)
    la, lb, lc = (np.linalg.norm(one, axis=1) for one in (a, b, c))
    triple = np.einsum("ij,ij->i", a, np.cross(b, c))
    ab, bc, ca = (np.einsum("ij,ij->i", one, other) for one, other in ((a, b), (b, c), (c, a)))
    angle = 2 * np.arctan2(triple, la * lb * lc + bc * la + ca * lb + ab * lc)
    return bool(angle.sum() / (4 * np.pi) > _INSIDE)


def _reverse(array: NDArray[Any], chosen: BoolArray) -> NDArray[Any]:
    """Values at corners (m, 3, ...), those of chosen faces in reverse order."""
    return np.where(chosen.reshape(-1, *[1] * (array.ndim - 1)), array[:, ::-1], array)
