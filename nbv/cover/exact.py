# SPDX-License-Identifier: MIT
"""Exact cover of small instances, by branch and bound (HiGHS)."""

from __future__ import annotations

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, milp

from nbv.cover.dual import relaxation
from nbv.cover.instance import CoverInstance


def solve_exactly(instance: CoverInstance, n_nodes: int) -> tuple[int, ...] | None:
    """Return a smallest choice that meets the instance; None when `n_nodes` nodes do not settle it.

    Parameters
    ----------
    instance : CoverInstance
        Reduced: all of its samples coverable.
    n_nodes : int
        Nodes of the search tree to look at.
    """
    if not instance.n_samples:
        return ()
    model = relaxation(instance)
    solved = milp(
        model["c"],
        constraints=LinearConstraint(model["A_ub"], ub=model["b_ub"]),
        bounds=Bounds(0, 1),
        integrality=np.ones(len(model["c"])),
        options={"node_limit": n_nodes},
    )
    if solved.status != 0:
        return None
    chosen = tuple(int(c) for c in np.flatnonzero(solved.x[: instance.n_candidates] > 0.5))
    return chosen if instance.is_met_by(instance.times_seen(chosen)) else None
