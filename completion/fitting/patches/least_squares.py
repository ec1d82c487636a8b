# SPDX-License-Identifier: MIT
"""Least squares: normal equations of a patch's controls, cell by cell, solved under its joins."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.sparse import block_array, coo_array, csc_array, csr_array, kron
from scipy.sparse.linalg import splu

from completion.fitting.patches.basis import Basis
from completion.fitting.patches.constraints import Equations
from completion.fitting.patches.patch import SplinePatch, products
from scenes.checks import FloatArray

BESIDE = 0.05**2
"""Weight of a point's offset along the surface beside that across it; it keeps controls from sliding."""

_SAMPLED = 2  # places a span, along u and along v, at which evenness is measured


class NormalEquations(NamedTuple):
    """The quadratic form x' matrix x - 2 x' right of the controls' coordinates."""

    matrix: csc_array  # (k, k)
    right: FloatArray  # (k,)


def normal_equations(
    bases: tuple[Basis, Basis], uv: FloatArray, points: FloatArray, normals: FloatArray
) -> NormalEquations:
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
        own = values[low:high]
        wide = (own[:, :, None] * across[low:high, None]).reshape(high - low, -1)
        blocks.append(wide.T @ wide + np.kron(own.T @ own, eye))
        at.append((3 * numbers[low][:, None] + np.arange(3)).ravel())
    size, n_local = 3 * along_u.n * along_v.n, 3 * n_each
    where = np.array(at, dtype=np.int32).reshape(-1, n_local)
    row, column = np.repeat(where, n_local, axis=1).ravel(), np.tile(where, (1, n_local)).ravel()
    matrix = coo_array((np.array(blocks).ravel(), (row, column)), shape=(size, size))
    return NormalEquations(matrix.tocsc(), right.ravel())


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
    at = [(np.arange(_SAMPLED * one.spans) + 0.5) / (_SAMPLED * one.spans) for one in patch.bases]
    uv = np.stack(np.meshgrid(*at, indexing="ij"), axis=-1).reshape(-1, 2)
    normals = np.nan_to_num(patch.normals(uv))
    rows = [products(patch.bases, uv, order) for order in ((2, 0), (1, 1), (0, 2))]
    weights = np.array([1.0, 2.0, 1.0]) / len(uv)
    parts = list[list[csr_array]]()
    for a in range(3):
        share = [float(a == b) - normals[:, a] * normals[:, b] for b in range(3)]
        parts.append(
            [
                sum(w * (one.T @ (one * by[:, None])) for one, w in zip(rows, weights, strict=True))
                for by in share
            ]
        )
    stacked = block_array(parts, format="coo")
    n = patch.bases[0].n * patch.bases[1].n
    row, column = (3 * (one % n) + one // n for one in (stacked.row, stacked.col))
    return coo_array((stacked.data, (row, column)), shape=stacked.shape).tocsc()


class Bordered:
    """A quadratic form under equations, factorised."""

    def __init__(self, matrix: csc_array, equations: Equations) -> None:
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
