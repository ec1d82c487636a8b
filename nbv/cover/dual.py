# SPDX-License-Identifier: MIT
"""Dual: the multipliers of the linear relaxation, by HiGHS."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import block_array, csr_array, eye_array

from nbv.cover.certificate import Certificate
from nbv.cover.instance import CoverInstance
from nbv.cover.reduction import Reduction
from scenes.checks import FloatArray

_HAIR = 1e-12  # by which multipliers are scaled below feasibility, against rounding


def find_certificate(reduction: Reduction, n_samples: int) -> Certificate:
    """Return the best certificate that the linear relaxation gives, for the original's `n_samples` samples.

    Samples that were merged or dropped get no multiplier: those kept stand for them. Where HiGHS fails, the
    certificate proves nothing (0).
    """
    instance = reduction.instance
    multipliers, price = np.zeros(n_samples), 0.0
    if instance.n_samples:
        solved = linprog(**relaxation(instance), method="highs-ds")
        if solved.x is not None:
            marginals = -solved.ineqlin.marginals
            multipliers[reduction.samples] = _feasible(instance, marginals[: instance.n_samples])
            price = 0.0 if instance.is_full else max(float(marginals[-1]), 0.0) / _scale(instance)
    return Certificate.rounded(multipliers, price)


def _feasible(instance: CoverInstance, multipliers: FloatArray) -> FloatArray:
    """Scale multipliers (n,) so that no candidate sees more than 1, where samples must be seen once."""
    kept: FloatArray = np.clip(multipliers, 0.0, 1.0)
    if instance.fold == 1:
        kept /= max(1.0, float((instance.matrix.astype(np.float64) @ kept).max()) * (1 + _HAIR))
    return kept


def relaxation(instance: CoverInstance) -> dict[str, Any]:
    """Return the relaxed cover as arguments of `linprog`.

    Of candidate c the share x_c is chosen, and of sample i the share z_i covered (all of it in full cover):
    smallest sum of x, where the x that see i sum to fold * z_i or more, and the z hold the wanted weight.
    """
    m, n = instance.matrix.shape
    seen_by = csr_array(instance.matrix.T).astype(np.float64)
    if instance.is_full:
        limits = np.full(n, -float(instance.fold))
        return {"c": np.ones(m), "A_ub": -seen_by, "b_ub": limits, "bounds": (0, 1)}
    weights = instance.weights / _scale(instance)
    rows = [[-seen_by, instance.fold * eye_array(n)], [None, csr_array(-weights[None])]]
    limits = np.append(np.zeros(n), -instance.target * weights.sum())
    cost = np.append(np.ones(m), np.zeros(n))
    return {"c": cost, "A_ub": block_array(rows, format="csr"), "b_ub": limits, "bounds": (0, 1)}


def _scale(instance: CoverInstance) -> float:
    """Return the weight that counts as one."""
    return float(instance.weights.mean())
