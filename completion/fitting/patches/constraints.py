# SPDX-License-Identifier: MIT
"""Constraints: the equations of all joins of a patch, and which of them are independent."""

from __future__ import annotations

from typing import NamedTuple, cast

import numpy as np
from scipy.linalg import qr

from completion.fitting.patches.boundary import Boundaries, Join
from completion.fitting.patches.joining import join_equations
from completion.fitting.patches.patch import SideName, SplinePatch, side_rows
from scenes.checks import BoolArray, FloatArray, IntArray
from scenes.surfaces.catalogue import Plane

_EXACT, _NEARLY = 1e-10, 1e-5
"""Independent is what is left of an equation by others: of linear ones, and of linearised ones."""


class Equations(NamedTuple):
    """Equations rows @ x[columns] = value of the controls' coordinates x, and which of them are linear."""

    columns: IntArray  # (t,) of the coordinates (3 a control) that take part
    rows: FloatArray  # (q, t)
    misfit: FloatArray  # (q,) how far they are from holding
    value: FloatArray  # (q,)
    is_linear: BoolArray  # (q,)

    def independent(self) -> Equations:
        """Return those that the others do not entail; linear ones go first."""
        kept, known = list[int](), np.zeros((self.rows.shape[1], 0))
        for linear, least in ((True, _EXACT), (False, _NEARLY)):
            some = np.flatnonzero(self.is_linear == linear)
            if not len(some):
                continue
            left = self.rows[some].T - known @ (known.T @ self.rows[some].T)
            frame, upper, order = qr(left, mode="economic", pivoting=True)
            size = np.abs(np.diag(upper))
            rank = int(np.count_nonzero(size > least * max(1.0, size.max(initial=0.0))))
            kept += some[order[:rank]].tolist()
            known = np.column_stack([known, frame[:, :rank]])
        which = np.array(kept, dtype=np.int64)
        return Equations(
            self.columns, self.rows[which], self.misfit[which], self.value[which], self.is_linear[which]
        )

    def imposed(self, x: FloatArray) -> FloatArray:
        """Return coordinates (k,) moved as little as possible to where independent equations hold."""
        if not len(self.rows):
            return x
        frame, upper = np.linalg.qr(self.rows.T)
        moved = x.copy()
        for _ in range(2):  # the second takes away what rounding left
            misfit = self.value - self.rows @ moved[self.columns]
            moved[self.columns] += frame @ np.linalg.solve(upper.T, misfit)
        return moved


def equations_of(patch: SplinePatch, boundaries: Boundaries) -> Equations:
    """Return all equations of a patch's joins, linearised where it is."""
    n, m, _ = patch.controls.shape
    controls = patch.controls.reshape(-1, 3)
    found = list[tuple[IntArray, FloatArray, FloatArray, bool]]()
    for side, boundary in boundaries.items():
        outer, inner = side_rows(side, n, m)
        along = patch.bases[1 if side[0] == "u" else 0]
        own = join_equations(boundary, controls[outer], controls[inner], along, _told(side, boundaries))
        columns = 3 * np.concatenate([outer, inner])[:, None] + np.arange(3)
        rows = np.concatenate([own.by_outer, own.by_inner], axis=1).reshape(len(own.misfit), -1)
        found.append((columns.ravel(), rows, own.misfit, isinstance(boundary.surface, Plane)))
    columns = np.unique(np.concatenate([np.zeros(0, np.int64), *(one[0] for one in found)]))
    whole = np.zeros((sum(len(one[1]) for one in found), len(columns)))
    start = 0
    for taking_part, rows, _, _ in found:
        whole[start : start + len(rows), np.searchsorted(columns, taking_part)] = rows
        start += len(rows)
    misfit = np.concatenate([np.zeros(0), *(one[2] for one in found)])
    is_linear = np.concatenate([np.zeros(0, bool), *(np.full(len(one[2]), one[3]) for one in found)])
    value = whole @ controls.ravel()[columns] - misfit
    return Equations(columns, whole, misfit, value, is_linear)


def _told(side: SideName, boundaries: Boundaries) -> tuple[bool, bool]:
    """Whether, at each end of a boundary, a plane next to it says how the boundary begins there."""
    join = boundaries[side].join
    ends = list[bool]()
    for end in ("0", "1"):
        other = boundaries.get(cast(SideName, ("v" if side[0] == "u" else "u") + end))
        if other is None or not isinstance(other.surface, Plane):
            ends.append(False)
            continue
        ends.append(other.join is Join.ORTHOGONAL or join is Join.TANGENT is other.join)
    return ends[0], ends[1]
