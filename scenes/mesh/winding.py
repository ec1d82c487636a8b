# SPDX-License-Identifier: MIT
"""Winding: closed components of a mesh with faces that are inside out, and their outside turned outside."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from scenes.checks import BoolArray, FloatArray
from scenes.mesh.labelled_mesh import LabelledMesh

_SAME_M = 1e-6  # corners that are so near each other are one
_MOST_TESTS = 200_000_000  # faces that components are held against: seconds
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
    is_closed : (m,) bool
        Which faces are of closed components.
    n_open : int
        Surfaces with faces of no closed component.
    """

    mesh: LabelledMesh
    n_components: int
    n_surfaces: int
    is_closed: BoolArray
    n_open: int


def turn_outside_out(mesh: LabelledMesh, body: NDArray[Any]) -> TurnedMesh:
    """Turn faces so that every closed component encloses a positive volume.

    A component are faces of one `body` (m,) that are joined at edges which two of them share. It is closed
    where its faces can be turned so that each edge is there as often in one direction as in the other.
    Cavities stay: components of negative volume inside a positive one of the same body, by the winding number
    of one of their corners (Jacobson et al. 2013, section 3); at most 200 million faces are looked at for it.
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
    turned &= ~_cavities(corners, body, component, closed, turned)
    look = mesh.appearance
    if look is not None:
        uv = None if look.corner_uv is None else _reverse(look.corner_uv, turned)
        look = replace(look, corner_colour=_reverse(look.corner_colour, turned), corner_uv=uv)
    surface = mesh.face_surface
    return TurnedMesh(
        LabelledMesh(mesh.vertices, _reverse(mesh.faces, turned), surface, look),
        len(np.unique(component[turned])),
        len(np.unique(surface[turned])),
        closed,
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
    faces = _numbers(np.repeat(body, 3), *place.T).reshape(-1, 3)
    edges = _edges(faces)
    edge = _numbers(*np.sort(edges, axis=1).T)
    shared = np.bincount(edge)
    order = np.argsort(edge, kind="stable")
    pair = order[(shared == 2)[edge[order]]].reshape(-1, 2)
    a, b = (pair % n).T
    same_way = edges[pair[:, 0], 0] == edges[pair[:, 1], 0]
    ends = np.concatenate([a, a + n]), np.concatenate([b + n * same_way, b + n * ~same_way])
    graph = coo_array((np.ones(len(ends[0]), np.bool_), ends), shape=(2 * n, 2 * n))
    return faces, connected_components(graph, directed=False)[1].reshape(2, n).T


def _numbers(*columns: NDArray[Any]) -> NDArray[np.int64]:
    """One number (n,) from 0 for each different row of columns (n,) of integers."""
    number = np.zeros(len(columns[0]), np.int64)
    for column in columns:
        index = np.unique(column, return_inverse=True)[1]
        number = np.unique(number * (index.max(initial=0) + 1) + index, return_inverse=True)[1]
    return number.astype(np.int64)


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
    edge = _numbers(of, *np.sort(edges, axis=1).T)
    uneven = np.bincount(edge, way)[edge] != 0
    return np.asarray(np.bincount(of, uneven) == 0)


def _cavities(
    corners: FloatArray,
    body: NDArray[Any],
    component: NDArray[Any],
    closed: BoolArray,
    turned: BoolArray,
) -> BoolArray:
    """Which faces (m,) are of components to be turned as a whole that lie inside others that stay."""
    share = np.bincount(component, turned) / np.maximum(np.bincount(component), 1)
    order = np.argsort(body, kind="stable")
    starts = np.flatnonzero(np.diff(body[order], prepend=body[order[0]] - 1))
    cavity = np.zeros(len(body), np.bool_)
    left = _MOST_TESTS
    for faces in np.split(order, starts[1:]):
        around = faces[closed[faces] & (share[component[faces]] == 0)]
        inward = np.unique(component[faces[share[component[faces]] == 1]])
        left -= len(inward) * len(faces)
        if left < 0:
            break
        for k in inward if len(around) else ():
            own = faces[component[faces] == k]
            cavity[own] = _is_inside(corners[own[0], 0], corners[around])
    return cavity


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
