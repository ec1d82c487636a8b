# SPDX-License-Identifier: MIT
"""Pieces of one face of a model are one face: slivers, chords that two surfaces share, what these part."""

from __future__ import annotations

import numpy as np

from completion.parts.division.growing import refine_surface
from completion.parts.division.patches import Patches, most_turn, pairs_of
from scenes.checks import IntArray
from scenes.surfaces.catalogue import Surface

_ROUNDS = 20
_FEW = 12  # triangles of a plane that may be a chord of what is beside it


def join_slivers(patches: Patches, face: IntArray) -> None:
    """Give patches without a normal the face (p,) of the largest neighbour that has one, in place."""
    first, other = np.repeat(np.arange(len(face)), np.diff(patches.bends.indptr)), patches.bends.indices
    order = np.lexsort((patches.area[other], first))
    first, other = first[order], other[order]
    for _ in range(_ROUNDS):
        joins = (face[first] < 0) & patches.is_thin[first] & (face[other] >= 0)
        if not joins.any():
            break
        face[first[joins]] = face[other[joins]]  # the largest is the last


def whole_faces(
    patches: Patches, labels: IntArray, surfaces: list[Surface]
) -> tuple[IntArray, list[Surface]]:
    """Return labels (m,) of triangles and surfaces, without planes of few triangles that are chords.

    Two surfaces that touch may share a plane, which parts what is one; steep triangles are in none.
    """
    mesh, labels = patches.mesh, labels.copy()
    a, b, _ = pairs_of(mesh)
    pairs = np.concatenate([np.column_stack([a, b]), np.column_stack([b, a])])
    count = np.bincount(labels[labels >= 0], minlength=len(surfaces))
    is_few = np.array([surface.kind == "plane" for surface in surfaces], np.bool_) & (count <= _FEW)
    few = (labels >= 0) & np.append(is_few, False)[labels]
    trial = np.where(few, -1, labels)
    for _ in range(_FEW):
        for one, two in pairs[few[pairs[:, 0]]]:
            if trial[one] < 0 <= trial[two]:
                members = np.flatnonzero(labels == trial[two])
                trial[one] = trial[two] if _is_chord(patches, one, surfaces[trial[two]], members) else -1
    lost = np.bincount(labels[few & (trial < 0)], minlength=len(surfaces)) > 0
    labels = np.where(few & ~np.append(lost, False)[labels], trial, labels)
    _unite(patches, labels, surfaces, pairs[: len(a)])
    left, number = np.unique(labels, return_inverse=True)
    n_none = int(left[0] < 0)
    return number.reshape(-1) - n_none, [surfaces[k] for k in left[n_none:]]


def _is_chord(patches: Patches, triangle: int, surface: Surface, members: IntArray) -> bool:
    """Whether a triangle is a chord of a surface, as its members (k,) are."""
    mesh, one = patches.mesh, np.array([triangle])
    is_near = np.abs(surface.distance(mesh.vertices[mesh.faces[triangle]])) <= patches.tolerance_m
    if surface.kind == "plane" or not is_near.all():
        return False
    turn, area = patches.turns(members, surface), patches.areas
    return bool(
        patches.turns(one, surface)[0] <= most_turn(turn, area[members], surface, np.ones(1, np.int64))[0]
    )


def _unite(patches: Patches, labels: IntArray, surfaces: list[Surface], pairs: IntArray) -> None:
    """Give faces that touch, and are on one surface, one of their labels (m,), in place."""
    mesh = patches.mesh
    beside = labels[pairs]
    beside = np.unique(
        np.sort(beside[(beside >= 0).all(axis=1) & (beside[:, 0] != beside[:, 1])], axis=1), axis=0
    )
    area = np.bincount(labels[labels >= 0], patches.areas[labels >= 0], minlength=len(surfaces))
    for pair in beside:
        large, small = pair[np.argsort(-area[pair], kind="stable")]
        surface = surfaces[large]
        if surface.kind == surfaces[small].kind and surface.kind != "plane" and (labels == small).any():
            corners = mesh.vertices[np.unique(mesh.faces[(labels == small) | (labels == large)])]
            better = refine_surface(surface, corners, patches.tolerance_m)
            if better is not None and np.abs(better[0].distance(corners)).max() <= patches.tolerance_m:
                labels[labels == small], surfaces[large] = large, better[0]
