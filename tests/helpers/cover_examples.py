# SPDX-License-Identifier: MIT
"""Cover instances for tests, and slow references: plain greedy choice, exhaustive search."""

from itertools import combinations

import numpy as np
from scipy.sparse import csr_array

from nbv.cover.instance import CoverInstance


def random_instance(
    seed: int,
    shape: tuple[int, int] = (40, 60),
    density: float = 0.1,
    *,
    target: float = 1.0,
    fold: int = 1,
    whole: bool = False,
) -> CoverInstance:
    """Return an instance with random entries and weights, whole numbers where `whole`."""
    rng = np.random.default_rng(seed)
    matrix = csr_array(rng.uniform(size=shape) < density).astype(float)
    weights = rng.integers(1, 9, shape[1]).astype(float) if whole else rng.uniform(0.1, 1.0, shape[1])
    return CoverInstance(matrix, weights, target, fold)


def planted_instance(seed: int, n_planted: int = 7, n_noise: int = 50) -> CoverInstance:
    """Return an instance whose optimum are the candidates 25, 26, ...: they part the samples among them."""
    rng = np.random.default_rng(seed)
    n = 10 * n_planted
    planted = np.zeros((n_planted, n))
    planted[np.arange(n) // 10, np.arange(n)] = 1
    noise = np.zeros((n_noise, n))
    noise[np.repeat(np.arange(n_noise), 4), rng.integers(0, n, 4 * n_noise)] = 1
    return CoverInstance(csr_array(np.vstack([noise[:25], planted, noise[25:]])), np.ones(n))


def meets(instance: CoverInstance, chosen: tuple[int, ...] | list[int]) -> bool:
    """Tell whether the chosen meet the instance, from the dense matrix."""
    times = (instance.matrix.toarray() != 0)[list(chosen)].sum(axis=0)
    can = (instance.matrix.toarray() != 0).sum(axis=0) >= instance.fold
    total = instance.weights[can].sum()
    return bool(instance.weights[can & (times >= instance.fold)].sum() >= (instance.target - 1e-9) * total)


def optimum(instance: CoverInstance) -> int:
    """Return the size of the smallest choice, by trying all."""
    m = instance.n_candidates
    return next(k for k in range(m + 1) if any(meets(instance, some) for some in combinations(range(m), k)))


def plain_greedy(instance: CoverInstance) -> list[int]:
    """Return greedy choice, all gains counted in each step; the first of equals."""
    dense = instance.matrix.toarray() != 0
    can = dense.sum(axis=0) >= instance.fold
    chosen: list[int] = []
    while not meets(instance, chosen):
        open_ones = can & (dense[chosen].sum(axis=0) < instance.fold)
        gains = dense @ (instance.weights * open_ones)
        gains[chosen] = 0.0
        chosen.append(int(np.argmax(gains)))
    return chosen
