# SPDX-License-Identifier: MIT
"""Motions: rigid motions as (3, 4) arrays, a turn and a shift."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from scenes.checks import FloatArray

STILL: FloatArray = np.eye(4)[:3].copy()
"""The motion (3, 4) that moves nothing."""


def inverses(motions: FloatArray) -> FloatArray:
    """The inverses (n, 3, 4) of motions (n, 3, 4)."""
    turned = np.swapaxes(motions[:, :, :3], 1, 2)
    shifted = -np.einsum("nij,nj->ni", turned, motions[:, :, 3])
    return np.ascontiguousarray(np.concatenate([turned, shifted[:, :, None]], axis=2))


def inverse(motion: FloatArray) -> FloatArray:
    """The inverse (3, 4) of a motion (3, 4)."""
    return np.asarray(inverses(motion[None])[0])


def in_units(motions: FloatArray, unit_m: float) -> FloatArray:
    """Motions (..., 3, 4) whose shifts are in units of `unit_m` instead of metres."""
    return np.ascontiguousarray(motions / np.array([1.0, 1.0, 1.0, unit_m]))


def compose(first: FloatArray, then: FloatArray) -> FloatArray:
    """The motions (..., 3, 4) of going by `then` and afterwards by `first`; either may be several."""
    turn = first[..., :3] @ then[..., :3]
    shift = (first[..., :3] @ then[..., 3:])[..., 0] + first[..., 3]
    return np.ascontiguousarray(np.concatenate([turn, shift[..., None]], axis=-1))


def perturb(motion: FloatArray, change: FloatArray, middle: FloatArray) -> FloatArray:
    """The motion (3, 4) after a small turn about the place `middle` (3,) and a shift: `change` (6,)."""
    turn = Rotation.from_rotvec(change[:3]).as_matrix()
    shift = middle + change[3:] - turn @ middle
    return compose(np.concatenate([turn, shift[:, None]], axis=1), motion)


def angle_between(first: FloatArray, others: FloatArray) -> FloatArray:
    """The angles (n,) between the turns of a motion (3, 4) and others (n, 3, 4), radians."""
    cosine = (np.einsum("ij,nij->n", first[:, :3], others[:, :, :3]) - 1) / 2
    return np.asarray(np.arccos(np.clip(cosine, -1.0, 1.0)))
