# SPDX-License-Identifier: MIT
"""Rounds of a patch fit: feet of the points, then controls under the equations of the joins."""

from __future__ import annotations

from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from scipy.sparse import block_diag, csc_array

from completion.fitting.patches.boundary import Boundaries, Join
from completion.fitting.patches.constraints import equations_of
from completion.fitting.patches.feet import Feet, feet_of, nearest_uv
from completion.fitting.patches.freedom import Freedom
from completion.fitting.patches.least_squares import BESIDE, Bordered, evenness, normal_equations, thin_plate
from completion.fitting.patches.parametrisation import stretched
from completion.fitting.patches.patch import SIDES, SplinePatch
from scenes.checks import FloatArray

ON_ALL, STEPS = 2, 2
"""Rounds at the end that take all points (the others take some), and steps to the feet in each."""

_ANNEALED = (1e-3, 1e-5, 1e-5, 1e-6, 1e-7)
"""Smoothing of the first rounds."""

_MOST_ROUNDS, _STILL = 12, 2e-3  # further ones, until the rms falls by a smaller share
_EVEN = 1e-7  # weight of parameters that run evenly, a point, at most
_EVEN_BY_NOISE = 4e-3  # and of the squared rms at unit size: what is measured better is smoothed less
_SOME = 20_000  # points
_FREE_ROUNDS, _RESTS = 15, 0.01  # at most, and shares of a point's error by which surfaces still move


class State(NamedTuple):
    """A patch on the way: where the feet of points are (k, 2), and what is around it, at unit size."""

    patch: SplinePatch
    uv: FloatArray
    around: Boundaries


def fitted(state: State, places: FloatArray, smoothing: float) -> State:
    """Return the patch after rounds on some of the places (k, 3), until it rests, and on all of them."""
    stride = max(1, len(places) // _SOME)
    some, last = places[::stride], np.inf
    coarse = state._replace(uv=state.uv[::stride])
    for number in range(len(_ANNEALED) + _MOST_ROUNDS):
        weight = _ANNEALED[number] if number < len(_ANNEALED) else 0.0
        coarse = next_round(
            coarse, some, max(weight, smoothing), rms=last, is_first=number == 0, is_stretched=True
        )
        rms, _ = rms_of(coarse.patch, feet_of(coarse.patch, some, coarse.uv, 0))
        if number > len(_ANNEALED) and rms > (1 - _STILL) * last:
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
            held = {side for side, one in state.around.items() if one.join is not Join.TANGENT}
            uv = stretched(uv, set(SIDES) - held)
    normal = normal_equations(state.patch.bases, uv, places, normals)
    plate = thin_plate(state.patch.bases) * (weight * len(places) * (BESIDE if is_first else 1.0))
    equations = equations_of(state.patch, {} if is_first else state.around).independent()
    even = 0.0 * plate if is_first else evenness(state.patch) * (even_weight(rms) * len(places))
    solved = Bordered(csc_array(normal.matrix + plate + even), equations).solve(normal.right, equations.value)
    return state._replace(patch=_with(state.patch, equations.imposed(solved)), uv=uv)


def even_weight(rms: float) -> float:
    """Return the weight of parameters that run evenly, for points that are so far off."""
    return min(_EVEN, _EVEN_BY_NOISE * rms**2)


def released(state: State, places: FloatArray, freedom: Freedom, variance: float, smoothing: float) -> State:
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
        solved, last = Bordered(csc_array(form), equations).solve(right, equations.value), moved
        moved = solved[-freedom.n :]
        state = State(_with(state.patch, solved[: -freedom.n]), feet.uv, freedom.moved(moved))
        if np.abs(moved - last).max() < _RESTS * np.sqrt(variance):
            break
    return state


def settled(patch: SplinePatch, around: Boundaries) -> SplinePatch:
    """Return the patch moved the little way that linearised equations left."""
    for _ in range(4):
        equations = equations_of(patch, around).independent()
        if not len(equations.rows) or np.abs(equations.misfit).max() < 1e-15:
            break
        patch = _with(patch, equations.imposed(patch.controls.ravel()))
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
    own = feet.distance[feet.is_inside]
    n, m, _ = patch.controls.shape
    held = sum(
        (m if side[0] == "u" else n) * (2 if one.join is Join.TANGENT else 1) for side, one in around.items()
    )
    return float(np.sqrt((own @ own) / max(len(own) - max(n * m - held, 0), 1))), len(own)
