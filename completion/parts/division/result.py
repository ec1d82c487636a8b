# SPDX-License-Identifier: MIT
"""What the segmentation of a part gives: a label for each point, a surface for each label."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from completion.fitting.degeneracy import check_spread, principal
from completion.fitting.moments import centroid
from completion.fitting.result import FitError, SurfaceFit
from completion.fitting.rounding import allow_for_rounding
from completion.parts.division.limits import LEAST_POINTS
from scenes.checks import FloatArray, InputError, IntArray, check_points, frozen_copy
from texture.engine.compiled import compiled


@dataclass(frozen=True, slots=True, eq=False)
class PartSegmentation:
    """Points of a part divided into faces, each on one surface.

    A face is connected: two bores on one axis are two faces. `groups` says which faces are on one surface.

    Attributes
    ----------
    labels : (n,) int
        Face of each point, in the order of the input: k + 1 for `fits[k]`, 0 for none. Of a mesh, of each
        vertex: on an edge that of the larger face.
    fits : tuple of SurfaceFit
        A surface for each face: plane, sphere, cylinder, cone or torus, with its covariance, residuals of
        neighbours that are alike allowed for.
    groups : tuple of int
        One a face: faces with equal numbers are on one surface, as far as the points tell.
    noise_m, spacing_m : float
        Estimated deviation of the points along the normal, and their sampling distance; metres.
    triangle_labels : (m,) int or None
        Of a mesh, the face of each triangle.
    is_model : bool
        Whether a mesh is a tessellated model, whose corners lie on its surfaces, and not a scanned one.
    names : tuple of int
        What each face is called, ascending: 1, 2, ... unless labels were given.
    warnings : tuple of str
        What is doubtful, a sentence each.
    """

    labels: IntArray
    fits: tuple[SurfaceFit, ...]
    groups: tuple[int, ...]
    noise_m: float
    spacing_m: float
    triangle_labels: IntArray | None = None
    is_model: bool = False
    names: tuple[int, ...] = ()
    warnings: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "labels", frozen_copy(self.labels, np.int32))
        if not self.names:
            object.__setattr__(self, "names", tuple(range(1, len(self.fits) + 1)))
        if self.triangle_labels is not None:
            object.__setattr__(self, "triangle_labels", frozen_copy(self.triangle_labels, np.int32))

    def members(self, number: int) -> IntArray:
        """Places (m,) of the points of face `number`, from 1."""
        return np.flatnonzero(self.labels == number)

    def allow_for_rounding(self, points: FloatArray, step_m: float) -> PartSegmentation:
        """Return it with fits that allow for coordinates of points (n, 3) in steps, metres."""
        fits = [
            allow_for_rounding(fit, points[self.members(number)], step_m)
            for number, fit in enumerate(self.fits, start=1)
        ]
        return replace(self, fits=tuple(fits))

    def by_surface(self) -> IntArray:
        """Labels (n,) of surfaces: of each point the least number of a face on its surface, 0 for none."""
        first = {group: number for number, group in reversed(list(enumerate(self.groups, start=1)))}
        members = np.array([0, *(first[group] for group in self.groups)], dtype=np.int64)
        return members[self.labels]

    def __repr__(self) -> str:
        kinds = Counter(fit.surface.kind for fit in self.fits)
        named = ", ".join(f"{count} {kind}" for kind, count in sorted(kinds.items())) or "nothing"
        share = float(np.mean(self.labels > 0)) if len(self.labels) else 0.0
        return f"PartSegmentation({named}; {share:.1%} of {len(self.labels)} points)"


def no_faces(n: int, reason: str) -> PartSegmentation:
    """The division of n points that have no surface, and why."""
    return PartSegmentation(np.zeros(n, np.int32), (), (), noise_m=0.0, spacing_m=0.0, warnings=(reason,))


MOST_POINTS = 30_000  # that surfaces are sought in; all others find their face afterwards
_N_HALVINGS = 40


def checked_cloud(
    points: object, normals: object | None, noise_m: float | None
) -> tuple[FloatArray, FloatArray | None]:
    """Return points (n, 3) and unit normals (n, 3), None where there are none.

    Raises
    ------
    InputError
        Other shapes, numbers that are not finite, normals without length, a noise below zero.
    """
    cloud = check_points("points", points)
    if noise_m is not None and not (np.isfinite(noise_m) and noise_m >= 0):
        raise InputError(f"noise_m must be a number of metres from 0, got {noise_m}")
    if normals is None:
        return cloud, None
    turned = check_points("normals", normals)
    if len(turned) != len(cloud):
        raise InputError(f"{len(turned)} normals for {len(cloud)} points; give one a point")
    length = np.linalg.norm(turned, axis=1, keepdims=True)
    if not length.all():
        raise InputError(f"{int((length == 0).sum())} of {len(turned)} normals have no length")
    return cloud, np.asarray(turned / length)


def too_little(points: FloatArray) -> str:
    """Why places (n, 3) can hold no surface, a sentence; empty where they may."""
    if len(points) < LEAST_POINTS:
        few = f"the points lie in {len(points)} places; a surface needs {LEAST_POINTS}"
        return f"{few}, so that none was looked for"
    middle = centroid(points)
    try:
        check_spread(len(points), principal(points, middle)[0], middle, 1)
    except FitError as error:
        return f"{error}; no surface was looked for"
    return ""


def thin_points(points: FloatArray, most: int) -> IntArray:
    """Return places (m,), in order, of at most so many distinct points (n, 3): one in each cell of a grid."""
    order = np.lexsort(points.T)  # stable: of copies the first comes first
    is_new = np.ones(len(points), dtype=np.bool_)
    is_new[1:] = (points[order[1:]] != points[order[:-1]]).any(axis=1)
    first = np.sort(order[is_new])
    if len(first) <= most:
        return first
    distinct = points[first] - points.min(axis=0)
    extent = float(distinct.max())
    low, high = 0.0, extent
    best = first[:: -(-len(first) // most)]
    for _ in range(_N_HALVINGS):
        side = (low + high) / 2
        first_of_cell = _first_of_cells(distinct, side, most)
        if len(first_of_cell) > most:
            low = side
            continue
        best, high = first[first_of_cell], side
        if len(first_of_cell) > 0.95 * most:
            break
    return best


@compiled
def _first_of_cells(points: FloatArray, side: float, most: int) -> IntArray:
    """Places (m,), ascending, of the first point (n, 3) in each cell of a grid; one more than `most` at most.

    Cells that are met stand in a table of places, found by their hash and looked for from there on.
    """
    size = 4
    while size < 4 * most + 4:
        size *= 2
    table, found, cell = np.full(size, -1, dtype=np.int64), np.empty(most + 1, dtype=np.int64), np.empty(3)
    n = 0
    for i in range(len(points)):
        for a in range(3):
            cell[a] = np.floor(points[i, a] / side)
        slot = (int(cell[0]) * 73856093 ^ int(cell[1]) * 19349663 ^ int(cell[2]) * 83492791) & (size - 1)
        while table[slot] >= 0:
            other = table[slot]
            if (
                np.floor(points[other, 0] / side) == cell[0]
                and np.floor(points[other, 1] / side) == cell[1]
                and np.floor(points[other, 2] / side) == cell[2]
            ):
                break
            slot = (slot + 1) & (size - 1)
        if table[slot] < 0:
            table[slot] = i
            found[n] = i
            n += 1
            if n > most:
                break
    return found[:n].copy()
