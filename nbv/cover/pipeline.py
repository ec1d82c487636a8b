# SPDX-License-Identifier: MIT
"""The offline planner: few views that see enough of a known scene, with a proof of how few suffice."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nbv.cover.dual import find_certificate, reduce_instance, solve_exactly
from nbv.cover.instance import Cover, CoverInstance, LowerBound
from nbv.cover.swap_search import Progress, by_gain, choose_greedily, drop_redundant, polish
from nbv.cover.within import most_covered
from scenes.checks import InputError, Value

_DUAL, _EXACT = "dual of the linear relaxation, checked exactly", "branch and bound (HiGHS)"


@dataclass(frozen=True, slots=True, kw_only=True)
class CoverOptions(Value):
    """Budgets of the offline planner.

    Parameters
    ----------
    polish_steps : int
        Swaps to try at most; 100,000 take some 15 s with 4,000 undominated candidates that each see a tenth.
    time_budget_s : float, optional
        Seconds after which the polish ends; what it finds then depends on the machine.
    exact_entries : int
        Reduced instances with at most so many entries are given to branch and bound too.
    exact_nodes : int
        Nodes of its search tree.

    Raises
    ------
    InputError
        Negative budgets.
    """

    polish_steps: int = 100_000
    time_budget_s: float | None = None
    exact_entries: int = 20_000
    exact_nodes: int = 200

    def __post_init__(self) -> None:
        if min(self.polish_steps, self.exact_entries, self.exact_nodes, self.time_budget_s or 0.0) < 0:
            raise InputError("the budgets of a cover must not be negative")


def find_cover(
    instance: CoverInstance,
    options: CoverOptions | None = None,
    *,
    n_most: int | None = None,
    relaxed: Cover | None = None,
    rng: np.random.Generator | int | None = None,
    progress: Progress | None = None,
) -> Cover:
    """Choose few candidates that meet `instance`, and prove how many any choice must have.

    The instance is reduced, exactly; lazy greedy choice and reverse deletion give a first cover; the linear
    relaxation yields multipliers that prove a lower bound; a swap search makes the cover smaller until it is
    as small as the bound or the budget is spent; branch and bound settles what is small enough for it.

    Parameters
    ----------
    instance : CoverInstance
        Which candidate sees which sample, and what is wanted.
    options : CoverOptions, optional
        Budgets.
    n_most : int, optional
        Choose no more than so many: those that cover most, by `nbv.cover.within`.
    relaxed : Cover, optional
        Of an instance with the same and more candidates: its bound holds here, and none is sought anew.
    rng : Generator, int or None
        Drives the swap search.
    progress : callable, optional
        Called with (stage, done, total).

    Raises
    ------
    InputError
        n_most below 1.

    Examples
    --------
    >>> from scipy.sparse import csr_array
    >>> rows = csr_array(np.array([[0, 1, 1, 1, 1, 0], [1, 1, 1, 0, 0, 0], [0, 0, 0, 1, 1, 1]]))
    >>> cover = find_cover(CoverInstance(rows, np.ones(6)))
    >>> sorted(cover.chosen), cover.bound.views
    ([1, 2], 2)
    """
    if n_most is not None and n_most < 1:
        raise InputError(f"a cover needs at least one view, got {n_most}")
    options = options or CoverOptions()
    reduction = reduce_instance(instance)
    reduced = reduction.instance
    chosen = drop_redundant(reduced, choose_greedily(reduced, progress=progress))
    if progress is not None:
        progress("bound", 0, 1)
    if relaxed is None:
        certificate = find_certificate(reduction, instance.weights, len(chosen))
        bound = LowerBound(certificate.bound(instance), _DUAL)
    else:
        certificate, bound = relaxed.certificate, relaxed.bound
    polished = polish(
        reduced,
        chosen,
        options.polish_steps,
        enough=bound.views,
        time_budget_s=options.time_budget_s,
        rng=rng,
        progress=progress,
    )
    smallest = polished.chosen
    may_settle = relaxed is None and reduced.matrix.nnz <= options.exact_entries
    if len(smallest) > bound.views and may_settle:
        exact = solve_exactly(reduced, options.exact_nodes)
        if exact is not None:
            smallest, bound = min(smallest, exact, key=len), LowerBound(len(exact), _EXACT)
    complete = [int(reduction.candidates[c]) for c in smallest]
    if n_most is not None and len(complete) > n_most:
        greedy = by_gain(instance, complete)[:n_most]
        fewer = max(greedy, most_covered(instance, n_most, rng), key=instance.covered_weight)
        return Cover(
            chosen=tuple(by_gain(instance, fewer)),
            is_complete=False,
            bound=bound,
            certificate=certificate,
            steps=polished.steps,
            was_cut_short=polished.was_cut_short,
        )
    ordered = by_gain(instance, complete)
    return Cover(
        chosen=tuple(ordered),
        is_complete=True,
        bound=bound,
        certificate=certificate,
        steps=polished.steps,
        was_cut_short=polished.was_cut_short,
    )
