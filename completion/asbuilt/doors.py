# SPDX-License-Identifier: MIT
"""Open doors: the leaf that is not in its place, turned about one of its upright edges."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from completion.asbuilt.faces import DesignFaces
from completion.asbuilt.findings import Extra
from scenes.checks import FloatArray

_ANGLES = np.radians(np.arange(10, 121, 3))
_CELL = 0.12  # of a leaf's places, metres
_NEAR_M = 0.04  # of a place of the leaf to what was measured
_LEAST = 0.6  # share of the leaf's places that are measured there


def leaf_of(
    faces: DesignFaces, surface: int, extra: Sequence[Extra], scale: float
) -> tuple[str, float] | None:
    """Return the extra that is the leaf of a door, and by how much it is open, radians; None for none.

    The largest upright face of the door is turned about both of its upright edges, either way; half of it at
    least must have been measured where it then lies.
    """
    mine = np.flatnonzero((faces.element == surface) & (faces.sign == 0) & (np.abs(faces.normal[:, 2]) < 0.1))
    if not len(mine) or not extra:
        return None
    f = mine[np.argmax(faces.area[mine])]
    half = faces.half[f]
    near = [one for one in extra if _gap(one, faces.centre[f]) < 2.5 * float(half.max())]
    if not near:
        return None
    from scipy.spatial import cKDTree

    points = np.concatenate([one.points for one in near])
    names = np.repeat(np.arange(len(near)), [len(one.points) for one in near])
    tree, step = cKDTree(points), _CELL * scale
    across = np.arange(step, 2 * half[0] - step / 2, step)
    upright = np.arange(-half[1] + step, half[1] - step / 2, step)
    best: tuple[float, str, float] = (_LEAST, "", 0.0)
    for edge in (-1.0, 1.0):
        hinge = faces.centre[f] + edge * half[0] * faces.u[f]
        for way in (-1.0, 1.0):
            for angle in _ANGLES:
                out = -edge * np.cos(angle) * faces.u[f] + way * np.sin(angle) * faces.normal[f]
                places = hinge + (across[:, None, None] * out + upright[:, None] * faces.v[f]).reshape(-1, 3)
                distance, index = tree.query(places, distance_upper_bound=2 * _NEAR_M * scale)
                held = distance < 1.5 * _NEAR_M * scale
                if held.mean() > best[0]:
                    most = int(np.bincount(names[index[held]]).argmax())
                    best = float(held.mean()), near[most].name, float(angle)
    return (best[1], best[2]) if best[1] else None


def _gap(one: Extra, place: FloatArray) -> float:
    """Distance of a place (3,) from the box of an extra."""
    return float(np.linalg.norm(np.maximum(np.maximum(one.box_m[0] - place, place - one.box_m[1]), 0.0)))
