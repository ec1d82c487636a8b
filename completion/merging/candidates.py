# SPDX-License-Identifier: MIT
"""Candidates: the pairs of parts that come into question at all, without a look at all pairs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from completion.merging.agreement import LEAST_COSINE, LEAST_FACING, Part
from completion.merging.neighbours import Spots, find_near, plant
from scenes.checks import BoolArray, FloatArray, IntArray
from scenes.run.mapping import trim

_DEVIATIONS = 5.0  # at a part's middle, beyond which no test is needed


def find_candidates(parts: Sequence[Part]) -> IntArray:
    """Return the pairs (k, 2), ascending, each of whose surfaces passes near the other's middle.

    Both are of one kind; planes face alike. Parts of one plane are a pair however far apart they are.
    """
    if not parts:
        return np.zeros((0, 2), dtype=np.int64)
    middles = np.array([one.middle() for one in parts])
    own = np.array([
        one.variance_at(middle[None], one.own_doubt())[0] for one, middle in zip(parts, middles, strict=True)
    ])  # fmt: skip
    normals = np.array([one.fit.surface.normal(m[None])[0] for one, m in zip(parts, middles, strict=True)])
    curved = np.array([one.form.is_curved for one in parts])
    none = np.zeros(len(parts))
    tree = plant(_spots(middles, none, _DEVIATIONS * np.sqrt(own), normals, curved))
    passed = []
    for i, part in enumerate(parts):
        trim()
        near = find_near(tree, part.form, (_DEVIATIONS, *part.spread()), LEAST_COSINE)
        near = near[(curved[near] == part.form.is_curved) & (near != i)]
        height, variance = (
            part.fit.surface.distance(middles[near]),
            part.variance_at(middles[near], part.own_doubt()),
        )
        passes = np.square(height) <= _DEVIATIONS**2 * (variance + own[near])
        if not part.form.is_curved:
            passes &= ~(normals[near] @ normals[i] < LEAST_COSINE)
        passed.append(i * len(parts) + near[passes])
    one, other = np.divmod(np.concatenate(passed), len(parts))
    both = np.intersect1d(one * len(parts) + other, other * len(parts) + one)
    pairs = np.stack(np.divmod(both, len(parts)), axis=1)
    return np.asarray(pairs[pairs[:, 0] < pairs[:, 1]], dtype=np.int64)


def find_hosts(small: Sequence[Part], parts: Sequence[Part]) -> list[list[int]]:
    """Return for each small part the parts, ascending, that it may lie on: all of these and some others."""
    hosts: list[list[int]] = [[] for _ in small]
    if not small:
        return hosts
    middles = np.array([one.points.mean(axis=0) for one in small])
    radii = np.array(
        [np.linalg.norm(one.points - m, axis=1).max() for one, m in zip(small, middles, strict=True)]
    )
    normals = np.array([one.fit.surface.normal(m[None])[0] for one, m in zip(small, middles, strict=True)])
    curved = np.array([one.form.is_curved for one in small])
    factor = float(np.sqrt(max(1 + one.slack for one in small)))
    scales = np.array([np.hypot(one.scale, one.doubt.shift_m) for one in small])
    tree = plant(_spots(middles, radii, factor * scales, normals, curved))
    for i, part in enumerate(parts):
        trim()
        for j in find_near(tree, part.form, (factor, *part.spread()), LEAST_FACING).tolist():
            hosts[j].append(i)
    return hosts


def _spots(
    middles: FloatArray, radii: FloatArray, reaches: FloatArray, normals: FloatArray, curved: BoolArray
) -> Spots:
    """Spots of parts; a curved one has all normals."""
    low, high = np.where(curved[:, None], -1.0, normals), np.where(curved[:, None], 1.0, normals)
    return Spots(middles, radii, reaches, low, high)
