# SPDX-License-Identifier: MIT
"""Rounds of a patch fit: feet of the points, then controls by least squares under the equations of the joins.

Surfaces that are free share one rotation, which keeps the angles between them, and have offsets of their own.

Freedom of surfaces: one rotation that they share, and their offsets, held by how well they are known.
The shared rotation keeps the angles between them, which relations or drawings say better than a patch does.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from scipy.sparse import block_array, block_diag, coo_array, csc_array, csr_array, kron
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from completion.fitting.limits import BESIDE, EVEN_BY_NOISE, EVENNESS, MOST_STEP, STILL_RMS, STILL_SURFACES
from completion.fitting.patches.joins import Boundaries, Boundary, ControlEquations, JoinKind, equations_of
from completion.fitting.patches.parametrisation import stretch
from completion.fitting.patches.spline import SIDES, Basis, SideName, SplinePatch, products
from scenes.checks import BoolArray, FloatArray, InputError
from scenes.surfaces.catalogue import Cylinder, Plane


class Feet(NamedTuple):
    """Where the nearest places are: parameters, normals there, and how far points are across the patch."""

    uv: FloatArray  # (k, 2)
    normals: FloatArray  # (k, 3)
    distance: FloatArray  # (k,) along the normal
    is_inside: BoolArray  # (k,) False where the foot is on a boundary, and the point perhaps beyond


def feet_of(patch: SplinePatch, points: FloatArray, uv: FloatArray, steps: int) -> Feet:
    """Return the feet of points (k, 3) after some Gauss-Newton steps from parameters (k, 2)."""
    uv, controls = uv.copy(), patch.controls.reshape(-1, 3)
    for number in range(steps + 1):
        at, along_u, along_v = (
            products(patch.bases, uv, order) @ controls for order in ((0, 0), (1, 0), (0, 1))
        )
        off = points - at
        if number == steps:
            break
        uu, uv_, vv = (_dot(*pair) for pair in ((along_u, along_u), (along_u, along_v), (along_v, along_v)))
        right_u, right_v = _dot(along_u, off), _dot(along_v, off)
        determinant = np.maximum(uu * vv - uv_**2, 1e-9 * uu * vv + 1e-300)
        step = np.column_stack([vv * right_u - uv_ * right_v, uu * right_v - uv_ * right_u])
        uv = np.clip(uv + np.clip(step / determinant[:, None], -MOST_STEP, MOST_STEP), 0.0, 1.0)
    across = np.cross(along_u, along_v)
    normals = across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-300)
    return Feet(uv, normals, _dot(off, normals), np.asarray(((uv > 0.0) & (uv < 1.0)).all(axis=1)))


def nearest_uv(patch: SplinePatch, uv: FloatArray, points: FloatArray, stride: int) -> FloatArray:
    """Return parameters (k, 2) to begin with, of points (k, 3).

    Each `stride`-th of them has known ones (j, 2).
    """
    if stride == 1:
        return uv
    nearest = cKDTree(points[::stride]).query(points)[1]
    return feet_of(patch, points, uv[nearest], 1).uv


def _dot(first: FloatArray, second: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("ij,ij->i", first, second))


_SAMPLED = 2  # places a span, along u and along v, at which evenness is measured


class QuadraticForm(NamedTuple):
    """The quadratic form x' matrix x - 2 x' right of the controls' coordinates."""

    matrix: csc_array  # (k, k)
    right: FloatArray  # (k,)


def normal_equations(
    bases: tuple[Basis, Basis], uv: FloatArray, points: FloatArray, normals: FloatArray
) -> QuadraticForm:
    """Return those of points (k, 3) whose feet are at parameters (k, 2), where normals (k, 3) are.

    The squared distance to the tangent plane, and `BESIDE` times that to the foot.
    """
    along_u, along_v = bases
    cell = along_u.span(uv[:, 0]) * along_v.spans + along_v.span(uv[:, 1])
    order = np.argsort(cell, kind="stable")
    starts = np.searchsorted(cell[order], np.arange(along_u.spans * along_v.spans + 1))
    rows = products(bases, uv[order])
    n_each = (along_u.degree + 1) * (along_v.degree + 1)
    values, numbers = rows.data.reshape(-1, n_each), rows.indices.reshape(-1, n_each)
    across, place = normals[order], points[order]
    pull = across * np.einsum("ij,ij->i", across, place)[:, None] + BESIDE * place
    right = rows.T @ pull
    blocks, at, eye = list[FloatArray](), list[FloatArray](), BESIDE * np.eye(3)
    for low, high in pairwise(starts.tolist()):
        if low == high:
            continue
        members = values[low:high]
        wide = (members[:, :, None] * across[low:high, None]).reshape(high - low, -1)
        blocks.append(wide.T @ wide + np.kron(members.T @ members, eye))
        at.append((3 * numbers[low][:, None] + np.arange(3)).ravel())
    size, n_local = 3 * along_u.n * along_v.n, 3 * n_each
    where = np.array(at, dtype=np.int32).reshape(-1, n_local)
    row, column = np.repeat(where, n_local, axis=1).ravel(), np.tile(where, (1, n_local)).ravel()
    matrix = coo_array((np.array(blocks).ravel(), (row, column)), shape=(size, size))
    return QuadraticForm(matrix.tocsc(), right.ravel())


def thin_plate(bases: tuple[Basis, Basis]) -> csc_array:
    """Return the form (k, k) of the controls' coordinates that integrates squared second derivatives."""
    along_u, along_v = bases
    terms = (
        weight * kron(csr_array(along_u.gram(order)), csr_array(along_v.gram(2 - order)))
        for order, weight in ((2, 1.0), (1, 2.0), (0, 1.0))
    )
    return csc_array(kron(sum(terms), np.eye(3)))


def evenness(patch: SplinePatch) -> csc_array:
    """Return the form (k, k) that integrates squared second derivatives along the patch, not across it.

    It keeps controls evenly spread without touching the shape: where parameters run evenly a patch bends
    across itself alone.
    """
    at = [(np.arange(_SAMPLED * base.spans) + 0.5) / (_SAMPLED * base.spans) for base in patch.bases]
    uv = np.stack(np.meshgrid(*at, indexing="ij"), axis=-1).reshape(-1, 2)
    normals = np.nan_to_num(patch.normals(uv))
    rows = [products(patch.bases, uv, order) for order in ((2, 0), (1, 1), (0, 2))]
    weights = np.array([1.0, 2.0, 1.0]) / len(uv)
    parts = list[list[csr_array]]()
    for a in range(3):
        share = [float(a == b) - normals[:, a] * normals[:, b] for b in range(3)]
        parts.append(
            [
                sum(w * (row.T @ (row * by[:, None])) for row, w in zip(rows, weights, strict=True))
                for by in share
            ]
        )
    stacked = block_array(parts, format="coo")
    n = patch.bases[0].n * patch.bases[1].n
    row, column = (3 * (position % n) + position // n for position in (stacked.row, stacked.col))
    return coo_array((stacked.data, (row, column)), shape=stacked.shape).tocsc()


class BorderedSystem:
    """A quadratic form under equations, factorised."""

    def __init__(self, matrix: csc_array, equations: ControlEquations) -> None:
        self.equations, self.size = equations, matrix.shape[0]
        n_rows = len(equations.rows)
        row, column = np.nonzero(equations.rows)
        held = (equations.rows[row, column], (row, equations.columns[column]))
        border = coo_array(held, shape=(n_rows, self.size))
        scale = float(np.abs(matrix.diagonal()).mean())
        self._scale = scale
        whole = block_array([[matrix / scale, border.T], [border, None]]) if n_rows else matrix / scale
        self._solved = splu(csc_array(whole))

    def solve(self, right: FloatArray, value: FloatArray | None = None) -> FloatArray:
        """Return the coordinates (k,) or (k, r) at the minimum for right sides, under the equations.

        `value` (q,) are those of the equations; 0 when not given.
        """
        n_rows = len(self.equations.rows)
        tail = np.zeros((n_rows, *right.shape[1:])) if value is None else value
        return np.asarray(self._solved.solve(np.concatenate([right / self._scale, tail]))[: self.size])


_DIFFERENCE = 1e-6  # of differences
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
        of_offsets = list[float]()
        for side, boundary in boundaries.items():
            sd = _deviations(side, boundary)
            key = _key(boundary.surface)
            if key not in starts:
                starts[key] = n
                weights_here, axis = _weights(boundary.surface, sd, scale)
                weights += (np.eye(3) - np.outer(axis, axis)) * weights_here[0]
                of_offsets += weights_here[1:]
                n += len(weights_here) - 1
            columns[side] = starts[key]
        self._columns: Mapping[SideName, int] = columns
        self.information = np.diag(np.concatenate([np.zeros(3), of_offsets]))
        """(k, k) of rotation and offsets, in the boundaries' unit."""
        self.information[:3, :3] = weights

    @property
    def n(self) -> int:
        """How many parameters there are."""
        return len(self.information)

    def move(self, x: FloatArray) -> Boundaries:
        """Return the boundaries whose surfaces are moved by parameters (k,)."""
        turn = Rotation.from_rotvec(x[:3]).as_matrix()
        return {
            side: replace(boundary, surface=_move_surface(boundary.surface, turn, x[self._columns[side] :]))
            for side, boundary in self.given.items()
        }

    def equations(self, patch: SplinePatch, x: FloatArray) -> ControlEquations:
        """Return the equations of the controls' coordinates and, after them, these parameters, at x (k,)."""
        plain = equations_of(patch, self.move(x))
        slopes = np.zeros((len(plain.rows), self.n))
        for k in range(self.n):
            step = _DIFFERENCE * np.eye(self.n)[k]
            after, before = (equations_of(patch, self.move(x + sign * step)).misfit for sign in (1, -1))
            slopes[:, k] = (after - before) / (2 * _DIFFERENCE)
        columns = np.concatenate([plain.columns, patch.controls.size + np.arange(self.n)])
        value = plain.value + slopes @ x
        is_linear = np.ones(len(plain.rows), dtype=bool)
        return ControlEquations(
            columns, np.column_stack([plain.rows, slopes]), plain.misfit, value, is_linear
        )


def _key(surface: Plane | Cylinder) -> bytes:
    if isinstance(surface, Plane):
        return np.concatenate([surface.point, surface.normal_direction]).tobytes()
    return np.concatenate([surface.point, surface.direction, [surface.radius]]).tobytes()


def _deviations(side: SideName, boundary: Boundary) -> list[float]:
    needed = _NEEDED[type(boundary.surface)]
    deviations = [float(boundary.deviations.get(name, np.nan)) for name in needed]
    if not np.isfinite(deviations).all() or min(deviations) < 0 or not max(deviations) > 0:
        raise InputError(
            f"{side}: a free surface needs to be known by its standard deviations {', '.join(needed)}, as "
            "`unseen fit` writes them; add them, or hold the surfaces"
        )
    return [max(sd, 1e-12) for sd in deviations]


def _weights(surface: Plane | Cylinder, sd: list[float], scale: float) -> tuple[list[float], FloatArray]:
    """Information on each tilt and on each offset, and the direction about which nothing tilts."""
    if isinstance(surface, Plane):
        return [2 / sd[1] ** 2, (scale / sd[0]) ** 2], surface.normal_direction
    shift = 2 * (scale / sd[0]) ** 2
    return [2 / sd[1] ** 2, shift, shift, (scale / sd[2]) ** 2], surface.direction


def _move_surface(surface: Plane | Cylinder, turn: FloatArray, x: FloatArray) -> Plane | Cylinder:
    if isinstance(surface, Plane):
        normal = turn @ surface.normal_direction
        return Plane(surface.point + x[0] * normal, normal, turn @ surface.u_direction)
    zero = turn @ surface.zero_direction
    axis = turn @ surface.direction
    point = surface.point + x[0] * zero + x[1] * np.cross(axis, zero)
    return Cylinder(point, axis, surface.radius + x[2], zero, surface.concave)


ON_ALL, STEPS = 2, 2
"""Rounds at the end that take all points (the others take some), and steps to the feet in each."""

_ANNEALED = (1e-3, 1e-5, 1e-5, 1e-6, 1e-7)
"""Smoothing of the first rounds."""

_MOST_ROUNDS = 12  # further ones, until the rms falls by a smaller share
_SOME = 20_000  # points
_FREE_ROUNDS = 15  # at most, and shares of a point's error by which surfaces still move


class State(NamedTuple):
    """A patch on the way: where the feet of points are (k, 2), and what is around it, at unit size."""

    patch: SplinePatch
    uv: FloatArray
    around: Boundaries


def fit_by_rounds(state: State, places: FloatArray, smoothing: float) -> State:
    """Return the patch after rounds on some of the places (k, 3), until it rests, and on all of them."""
    stride = max(1, len(places) // _SOME)
    places_used, last = places[::stride], np.inf
    coarse = state._replace(uv=state.uv[::stride])
    for number in range(len(_ANNEALED) + _MOST_ROUNDS):
        weight = _ANNEALED[number] if number < len(_ANNEALED) else 0.0
        coarse = next_round(
            coarse, places_used, max(weight, smoothing), rms=last, is_first=number == 0, is_stretched=True
        )
        rms, _ = rms_of(coarse.patch, feet_of(coarse.patch, places_used, coarse.uv, 0))
        if number > len(_ANNEALED) and rms > (1 - STILL_RMS) * last:
            break
        last = rms
    state = coarse._replace(uv=nearest_uv(coarse.patch, coarse.uv, places, stride))
    for _ in range(ON_ALL):
        state = next_round(state, places, smoothing, rms=last)
    return state


def next_round(
    state: State,
    places: FloatArray,
    weight: float,
    *,
    rms: float = np.inf,
    is_first: bool = False,
    is_stretched: bool = False,
) -> State:
    """Return the patch after feet, then controls; places (k, 3), smoothed by a weight, off by `rms` so far.

    In the first round points are taken to lie where their parameters say. Where it is stretched, sides that
    nothing holds are taken back to where the points end.
    """
    uv, normals = state.uv, np.zeros_like(places)
    if not is_first:
        feet = feet_of(state.patch, places, uv, STEPS)
        uv, normals = feet.uv, feet.normals
        if is_stretched:
            held = {side for side, boundary in state.around.items() if boundary.join is not JoinKind.TANGENT}
            uv = stretch(uv, set(SIDES) - held)
    normal = normal_equations(state.patch.bases, uv, places, normals)
    plate = thin_plate(state.patch.bases) * (weight * len(places) * (BESIDE if is_first else 1.0))
    equations = equations_of(state.patch, {} if is_first else state.around).independent()
    even = 0.0 * plate if is_first else evenness(state.patch) * (even_weight(rms) * len(places))
    solved = BorderedSystem(csc_array(normal.matrix + plate + even), equations).solve(
        normal.right, equations.value
    )
    return state._replace(patch=_with(state.patch, equations.impose(solved)), uv=uv)


def even_weight(rms: float) -> float:
    """Return the weight of parameters that run evenly, for points that are so far off."""
    return min(EVENNESS, EVEN_BY_NOISE * rms**2)


def release_surfaces(
    state: State, places: FloatArray, freedom: Freedom, variance: float, smoothing: float
) -> State:
    """Return the patch and the surfaces when these may move; places (k, 3) are off by `variance`."""
    moved = np.zeros(freedom.n)
    plate = thin_plate(state.patch.bases) * (smoothing * len(places))
    for _ in range(_FREE_ROUNDS):
        feet = feet_of(state.patch, places, state.uv, STEPS)
        normal = normal_equations(state.patch.bases, feet.uv, places, feet.normals)
        even = evenness(state.patch) * (even_weight(float(np.sqrt(variance))) * len(places))
        form = block_diag([normal.matrix + plate + even, variance * freedom.information], format="csc")
        equations = freedom.equations(state.patch, moved).independent()
        right = np.concatenate([normal.right, np.zeros(freedom.n)])
        solved, last = BorderedSystem(csc_array(form), equations).solve(right, equations.value), moved
        moved = solved[-freedom.n :]
        state = State(_with(state.patch, solved[: -freedom.n]), feet.uv, freedom.move(moved))
        if np.abs(moved - last).max() < STILL_SURFACES * np.sqrt(variance):
            break
    return state


def impose_joins(patch: SplinePatch, around: Boundaries) -> SplinePatch:
    """Return the patch moved the little way that linearised equations left."""
    for _ in range(4):
        equations = equations_of(patch, around).independent()
        if not len(equations.rows) or np.abs(equations.misfit).max() < 1e-15:
            break
        patch = _with(patch, equations.impose(patch.controls.ravel()))
    return patch


def _with(patch: SplinePatch, coordinates: FloatArray) -> SplinePatch:
    return SplinePatch(coordinates.reshape(patch.controls.shape), patch.degree)


def information(state: State, places: FloatArray, smoothing: float) -> csc_array:
    """Return the form (j, j) of the controls' coordinates that places (k, 3) of unit variance give."""
    feet = feet_of(state.patch, places, state.uv, 1)
    normal = normal_equations(state.patch.bases, feet.uv, places, feet.normals)
    return csc_array(normal.matrix + thin_plate(state.patch.bases) * (smoothing * len(places)))


def rms_of(patch: SplinePatch, feet: Feet, around: Boundaries = MappingProxyType({})) -> tuple[float, int]:
    """Return the rms of the feet's distances, and how many points took part: those inside.

    It is over the degrees of freedom of the controls that may move across the patch.
    """
    members = feet.distance[feet.is_inside]
    n, m, _ = patch.controls.shape
    held = sum(
        (m if side[0] == "u" else n) * (2 if boundary.join is JoinKind.TANGENT else 1)
        for side, boundary in around.items()
    )
    return float(np.sqrt((members @ members) / max(len(members) - max(n * m - held, 0), 1))), len(members)
