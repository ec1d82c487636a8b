# SPDX-License-Identifier: MIT
"""Pipes: meshes of tubes along a path."""

import numpy as np

_AROUND = 48  # corners of a ring


def tube(path, radius, across=(0.0, 1.0, 0.0)):
    """Corners (n, 3) and triangles (m, 3) of an open tube along a path (k, 3) at right angles to `across`."""
    path, across = np.asarray(path, float), np.asarray(across, float)
    along = np.gradient(path, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    out = np.cross(along, across)
    turn = 2 * np.pi * np.arange(_AROUND) / _AROUND
    rings = path[:, None] + radius * (np.cos(turn)[:, None] * out[:, None] + np.sin(turn)[:, None] * across)
    number = np.arange(len(path) * _AROUND).reshape(len(path), _AROUND)
    a, b = number[:-1], np.roll(number[:-1], -1, axis=1)
    c, d = number[1:], np.roll(number[1:], -1, axis=1)
    faces = np.concatenate(
        [np.stack([a, b, d], axis=-1).reshape(-1, 3), np.stack([a, d, c], axis=-1).reshape(-1, 3)]
    )
    return rings.reshape(-1, 3), faces
