# SPDX-License-Identifier: MIT
"""Movement of vertices onto planes: along the normal or along rays, never so that a face flips or crosses."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from completion.flattening.meshes.crossings import new_crossings
from scenes.checks import BoolArray, FloatArray
from scenes.surfaces.catalogue import Plane

_GRAZING = 0.05  # cosine of the angle of incidence: rays that run flatter are not moved along
_NEAR = 3.0  # sd of the other plane's residuals within which a vertex beside it lies on it too


def move_onto(
    vertices: FloatArray, plane: Plane, height: FloatArray, origin: FloatArray | None
) -> FloatArray:
    """Vertices (n, 3) moved to heights (n,) over a plane: along its normal, or the rays from `origin`."""
    rise = height - plane.distance(vertices)
    if origin is None:
        return vertices + rise[:, None] * plane.normal_direction
    rays = vertices - origin
    reach = np.maximum(np.linalg.norm(rays, axis=1), 1e-30)
    rays = rays / reach[:, None]
    along = rays @ plane.normal_direction
    steep = np.abs(along) >= _GRAZING
    length = np.where(steep, rise / np.where(steep, along, 1.0), 0.0)
    length[length <= -reach] = 0.0  # the plane is behind the sensor
    out: FloatArray = vertices + length[:, None] * rays
    return out


def move_creases(
    vertices: FloatArray,
    moved: FloatArray,
    faces: NDArray[np.int32],
    flat: NDArray[np.int64],
    planes: dict[int, tuple[Plane, float]],
) -> FloatArray:
    """Flattened vertices that lie on a neighbouring plane too go to where both meet, or all three.

    `flat` (n,) is the label of the plane that a vertex was moved onto, 0 for others; `planes` has each
    plane with the rms of its residuals. A vertex lies on a plane if an edge joins it to a vertex of that
    plane, it is no farther from it than three rms, and nearer than the other end is to its own: of the two
    ends of an edge one alone goes to the crease, or the faces between would collapse.
    """
    pairs = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    pairs = pairs[np.all(flat[pairs] > 0, axis=1) & (flat[pairs[:, 0]] != flat[pairs[:, 1]])]
    off = np.stack([_off_others(vertices, pairs[:, ::way], flat, planes) for way in (1, -1)], axis=1)
    nearer = np.argmin(off, axis=1)
    every = np.arange(len(pairs))
    beside = np.stack([pairs[every, nearer], flat[pairs[every, 1 - nearer]]], axis=1)
    beside = np.unique(beside[off[every, nearer] <= 1.0], axis=0)
    also = dict[int, list[int]]()
    for vertex, label in beside.tolist():
        also.setdefault(vertex, [int(flat[vertex])]).append(label)
    out = moved.copy()
    for vertex, labels in also.items():
        normals = np.stack([planes[label][0].normal_direction for label in labels[:3]])
        away = np.array([planes[label][0].distance(vertices[vertex][None])[0] for label in labels[:3]])
        if np.linalg.svd(normals, compute_uv=False)[-1] > 0.1:
            out[vertex] = vertices[vertex] - np.linalg.lstsq(normals, away, rcond=None)[0]
    return out


def _off_others(
    vertices: FloatArray,
    pairs: NDArray[np.int32],
    flat: NDArray[np.int64],
    planes: dict[int, tuple[Plane, float]],
) -> FloatArray:
    """How far the first of each pair (m, 2) is off the plane of the second, over what is still on it."""
    off = np.full(len(pairs), np.inf)
    for label, (plane, rms) in planes.items():
        some = np.flatnonzero(flat[pairs[:, 1]] == label)
        reach = [_NEAR * max(rms, planes[int(own)][1]) for own in flat[pairs[some, 0]]]
        off[some] = np.abs(plane.distance(vertices[pairs[some, 0]])) / np.maximum(reach, 1e-300)
    return off


def hold_back(
    before: FloatArray, after: FloatArray, faces: NDArray[np.int32]
) -> tuple[FloatArray, BoolArray]:
    """Vertices (n, 3) after a movement in which no face turns over or crosses anew; (n,) which stayed.

    The vertices of a face that would are left where they were, until there is none.
    """
    held = np.zeros(len(before), np.bool_)
    after = after.copy()
    changed = np.any(after != before, axis=1)
    tested = changed.copy()
    while True:
        flipped = np.zeros(len(faces), np.bool_)
        near = changed[faces].any(axis=1)
        flipped[near] = _flipped(before, after, faces[near])
        wrong = flipped if flipped.any() else new_crossings(before, after, faces, tested[faces].any(axis=1))
        if not wrong.any():
            return after, held
        back = np.unique(faces[wrong])
        back = back[changed[back]]
        after[back], held[back], changed[back] = before[back], True, False
        if not flipped.any():
            tested[:] = False
            tested[back] = True


def wrong_faces(
    before: FloatArray, after: FloatArray, faces: NDArray[np.int32], origin: FloatArray | None = None
) -> tuple[int, int]:
    """How many faces turned over, and how many cross others anew, of all whose vertices (n, 3) moved.

    Where `origin` (n, 3) says from where they were measured, a face turned over if it shows its other side
    there.
    """
    moved = np.any(after != before, axis=1)[faces].any(axis=1)
    some = faces[moved]
    if origin is None:
        turned = _flipped(before, after, some)
    else:
        old, new = (np.linalg.det((at - origin)[some]) for at in (before, after))
        turned = (old * new <= 0) & (old != 0)
    return int(turned.sum()), int(new_crossings(before, after, faces, moved).sum())


def _flipped(before: FloatArray, after: FloatArray, faces: NDArray[np.int32]) -> BoolArray:
    """Faces whose normals turn by more than a right angle, or that collapse."""
    old, new = (
        np.cross(at[faces[:, 1]] - at[faces[:, 0]], at[faces[:, 2]] - at[faces[:, 0]])
        for at in (before, after)
    )
    turned: BoolArray = (np.sum(old * new, axis=1) <= 0) & np.any(old != 0, axis=1)
    return turned
