# SPDX-License-Identifier: MIT
"""Freedom of surfaces: one rotation that they share, and their offsets, held by how well they are known.

The shared rotation keeps the angles between them, which relations or drawings say better than a patch does.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from completion.fitting.patches.boundary import Boundaries, Boundary
from completion.fitting.patches.constraints import Equations, equations_of
from completion.fitting.patches.patch import SideName, SplinePatch
from scenes.checks import FloatArray, InputError
from scenes.surfaces.catalogue import Cylinder, Plane

_STEP = 1e-6  # of differences
_NEEDED = {Plane: ("offset", "normal"), Cylinder: ("point", "direction", "radius")}


class Freedom:
    """How surfaces may move: a rotation (3), then of a plane its offset, of a cylinder two and its radius.

    Parameters
    ----------
    boundaries : mapping
        The surfaces where they were given; equal ones move together.
    scale : float
        Unit of the boundaries' lengths, in that of their deviations.

    Raises
    ------
    InputError
        A surface of which it is not said how well it is known.
    """

    def __init__(self, boundaries: Boundaries, scale: float) -> None:
        self.given = boundaries
        starts, columns, n = dict[bytes, int](), dict[SideName, int](), 3
        weights = np.zeros((3, 3))
        rest = list[float]()
        for side, one in boundaries.items():
            sd = _deviations(side, one)
            key = _key(one.surface)
            if key not in starts:
                starts[key] = n
                own, axis = _weights(one.surface, sd, scale)
                weights += (np.eye(3) - np.outer(axis, axis)) * own[0]
                rest += own[1:]
                n += len(own) - 1
            columns[side] = starts[key]
        self._columns: Mapping[SideName, int] = columns
        self.information = np.diag(np.concatenate([np.zeros(3), rest]))
        """(k, k) of rotation and offsets, in the boundaries' unit."""
        self.information[:3, :3] = weights

    @property
    def n(self) -> int:
        """How many parameters there are."""
        return len(self.information)

    def moved(self, x: FloatArray) -> Boundaries:
        """Return the boundaries whose surfaces are moved by parameters (k,)."""
        turn = Rotation.from_rotvec(x[:3]).as_matrix()
        return {
            side: replace(one, surface=_moved(one.surface, turn, x[self._columns[side] :]))
            for side, one in self.given.items()
        }

    def equations(self, patch: SplinePatch, x: FloatArray) -> Equations:
        """Return the equations of the controls' coordinates and, after them, these parameters, at x (k,)."""
        plain = equations_of(patch, self.moved(x))
        slopes = np.zeros((len(plain.rows), self.n))
        for k in range(self.n):
            step = _STEP * np.eye(self.n)[k]
            after, before = (equations_of(patch, self.moved(x + sign * step)).misfit for sign in (1, -1))
            slopes[:, k] = (after - before) / (2 * _STEP)
        columns = np.concatenate([plain.columns, patch.controls.size + np.arange(self.n)])
        value = plain.value + slopes @ x
        is_linear = np.ones(len(plain.rows), dtype=bool)
        return Equations(columns, np.column_stack([plain.rows, slopes]), plain.misfit, value, is_linear)


def _key(surface: Plane | Cylinder) -> bytes:
    if isinstance(surface, Plane):
        return np.concatenate([surface.point, surface.normal_direction]).tobytes()
    return np.concatenate([surface.point, surface.direction, [surface.radius]]).tobytes()


def _deviations(side: SideName, one: Boundary) -> list[float]:
    needed = _NEEDED[type(one.surface)]
    found = [float(one.deviations.get(name, np.nan)) for name in needed]
    if not np.isfinite(found).all() or min(found) < 0 or not max(found) > 0:
        raise InputError(
            f"{side}: a free surface needs to be known by its standard deviations {', '.join(needed)}, as "
            "`unseen fit` writes them; add them, or hold the surfaces"
        )
    return [max(sd, 1e-12) for sd in found]


def _weights(surface: Plane | Cylinder, sd: list[float], scale: float) -> tuple[list[float], FloatArray]:
    """Information on each tilt and on each offset, and the direction about which nothing tilts."""
    if isinstance(surface, Plane):
        return [2 / sd[1] ** 2, (scale / sd[0]) ** 2], surface.normal_direction
    shift = 2 * (scale / sd[0]) ** 2
    return [2 / sd[1] ** 2, shift, shift, (scale / sd[2]) ** 2], surface.direction


def _moved(surface: Plane | Cylinder, turn: FloatArray, x: FloatArray) -> Plane | Cylinder:
    if isinstance(surface, Plane):
        normal = turn @ surface.normal_direction
        return Plane(surface.point + x[0] * normal, normal, turn @ surface.u_direction)
    zero = turn @ surface.zero_direction
    axis = turn @ surface.direction
    point = surface.point + x[0] * zero + x[1] * np.cross(axis, zero)
    return Cylinder(point, axis, surface.radius + x[2], zero, surface.concave)
