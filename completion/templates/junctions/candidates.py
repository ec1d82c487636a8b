# SPDX-License-Identifier: MIT
"""Candidates: pairs of patches that may touch along a line, or be the tubes of an elbow."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from completion.templates.junctions.patches import Cloud, Patch
from scenes.checks import FloatArray, IntArray

_LEAST_TOUCHING = 6  # pairs of neighbours
_PARALLEL, _ACROSS, _TANGENT = np.cos(np.radians(15.0)), np.sin(np.radians(15.0)), np.cos(np.radians(25.0))
_ALIKE = 0.2  # of a radius, by which two tubes of a pipe may differ
_LEAST_TURN = np.sin(np.radians(8.0))
_MISS, _FAR, _OUT, _ARM = 0.8, 9.0, 2.2, 8.0  # radii: axes apart, corner away, bend off the axes, arms
_LEAST_POINTS = 60


class Candidate(NamedTuple):
    """Where a feature may be: its kind, and points (n, 3) about it, by truth (n,) of the cloud."""

    kind: str
    members: IntArray
    worth: float  # points of the smaller patch: the order in which they are tried


def touching(cloud: Cloud, patches: list[Patch]) -> list[Candidate]:
    """Return pairs of patches that lie side by side with one normal at their border."""
    label = np.full(len(cloud.points), -1)
    for k, patch in enumerate(patches):
        label[patch.members] = k
    found = []
    for (i, j), border in _borders(cloud, label).items():
        first, second = patches[i], patches[j]
        if len(border) < _LEAST_TOUCHING or (first.is_flat and second.is_flat):
            continue
        if not _are_tangent(first, second, cloud.points[border]):
            continue
        members = _about(cloud, first, second, border)
        if len(members) >= _LEAST_POINTS:
            found.append(Candidate("junction", members, float(min(len(first.members), len(second.members)))))
    return sorted(found, key=lambda one: -one.worth)


def _borders(cloud: Cloud, label: IntArray) -> dict[tuple[int, int], IntArray]:
    """Points (b,) of pairs that have a neighbour of another patch; narrow gaps of free points are closed."""
    closed = label.copy()
    for _ in range(2):
        free = np.flatnonzero(closed < 0)
        around = closed[cloud.neighbours[free]]
        for one in around.T:
            take = (closed[free] < 0) & (one >= 0)
            closed[free[take]] = one[take]
    row, column = np.nonzero(closed[cloud.neighbours] != closed[:, None])
    other = closed[cloud.neighbours[row, column]]
    own = closed[row]
    good = (own >= 0) & (other >= 0)
    pairs: dict[tuple[int, int], list[int]] = {}
    for a, b, point in zip(own[good], other[good], row[good], strict=True):
        pairs.setdefault((int(min(a, b)), int(max(a, b))), []).append(int(point))
    return {pair: np.unique(points) for pair, points in sorted(pairs.items())}


def _are_tangent(first: Patch, second: Patch, border: FloatArray) -> bool:
    """Whether both surfaces have one direction along, and one normal at points (b, 3) of the border."""
    axes = [patch.fit.model.turn[2] for patch in (first, second)]
    normals = [patch.fit.model.section(border).slope @ patch.fit.model.turn for patch in (first, second)]
    agree = np.abs(np.einsum("ij,ij->i", *normals))
    if first.is_flat or second.is_flat:
        flat, round_ = (0, 1) if first.is_flat else (1, 0)
        is_along = abs(float(np.median(normals[flat] @ axes[round_]))) < _ACROSS
    else:
        is_along = abs(float(axes[0] @ axes[1])) > _PARALLEL
    return bool(is_along and np.median(agree) > _TANGENT)


def _about(cloud: Cloud, first: Patch, second: Patch, border: IntArray) -> IntArray:
    """Points (m,) of both patches, and free ones, as far from the border as the narrower patch is wide."""
    tree = cKDTree(cloud.points[border])
    widths = [float(tree.query(cloud.points[patch.members])[0].max()) for patch in (first, second)]
    reach = 1.2 * min(widths) + 2 * cloud.spacing
    both = np.union1d(first.members, second.members)
    return np.asarray(both[tree.query(cloud.points[both])[0] <= reach])


def crossing(cloud: Cloud, patches: list[Patch]) -> list[Candidate]:
    """Return pairs of tubes of like radii whose axes cross not far from both."""
    tubes = [patch for patch in patches if not patch.is_flat and len(patch.members) >= _LEAST_POINTS // 2]
    found = []
    for i, first in enumerate(tubes):
        for second in tubes[:i]:
            if abs(first.radius - second.radius) > _ALIKE * max(first.radius, second.radius):
                continue
            members = _pipe(cloud, first, second)
            if len(members) >= _LEAST_POINTS:
                worth = float(min(len(first.members), len(second.members)))
                found.append(Candidate("elbow", members, worth))
    return sorted(found, key=lambda one: -one.worth)


def _pipe(cloud: Cloud, first: Patch, second: Patch) -> IntArray:
    """Points (m,) about the axes of two tubes, from where these cross; none where they do not."""
    none = np.zeros(0, dtype=np.int64)
    radius = (first.radius + second.radius) / 2
    axes = [_axis(patch) for patch in (first, second)]
    (p, a), (q, b) = axes
    sine = float(np.linalg.norm(np.cross(a, b)))
    if sine < _LEAST_TURN or abs(float((q - p) @ np.cross(a, b))) / sine > _MISS * radius:
        return none
    along = float(a @ b)
    s, t = np.linalg.solve([[1.0, -along], [along, -1.0]], [(q - p) @ a, (q - p) @ b])
    corner = (p + s * a + q + t * b) / 2
    on = np.zeros(len(cloud.points), dtype=np.bool_)
    for patch, axis in ((first, a), (second, b)):
        reach = (cloud.points[patch.members] - corner) @ axis
        way = np.sign(np.median(reach)) * axis
        if np.quantile(np.abs(reach), 0.05) > _FAR * radius or np.median(reach) == 0:
            return none
        local = cloud.points - corner
        height = np.clip(local @ way, 0.0, max(_ARM * radius, float(np.quantile(np.abs(reach), 0.5))))
        on |= np.linalg.norm(local - height[:, None] * way, axis=1) < _OUT * radius
    return np.flatnonzero(on)


def _axis(patch: Patch) -> tuple[FloatArray, FloatArray]:
    """A point (3,) of a tube's axis, and its direction (3,)."""
    model = patch.fit.model
    return model.origin - model.turn[0] / model.shape[0], model.turn[2]
