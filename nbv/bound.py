# SPDX-License-Identifier: MIT
"""Lower bound on the number of views that any plan with the same candidates and samples needs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from nbv.cover import check_cover, coverable_weight
from scenes.checks import FloatArray

_TOLERANCE = 1e-9


@dataclass(frozen=True, slots=True)
class LowerBound:
    """At least `views` are needed with these candidates and samples; `kind` says by which argument."""

    views: int
    kind: str

    def to_json(self) -> dict[str, Any]:
        """Return the entry of `plan.json`."""
        return {"views": self.views, "kind": self.kind}


def marginal_bound(
    matrix: csr_array, weights: FloatArray, target: float, chosen: tuple[int, ...] = ()
) -> LowerBound:
    """Bound the number of rows that cover `target` of the coverable weight, from what single rows can add.

    Coverage is submodular: k rows add to any set S at most the sum of the k largest single gains over S. So
    k must be so large that this sum reaches what S leaves to cover. Tried for every prefix S of `chosen`
    (none included); the best is returned. Each is checked by one sparse matrix-vector product.

    Examples
    --------
    >>> rows = csr_array(np.eye(5))
    >>> marginal_bound(rows, np.ones(5), 0.8)
    LowerBound(views=4, kind='marginal gains')
    """
    check_cover(matrix, weights, target)
    sees = csr_array((np.ones(len(matrix.indices)), matrix.indices, matrix.indptr), shape=matrix.shape)
    coverable = coverable_weight(matrix, weights)
    left = weights.astype(np.float64).copy()
    wanted = target * coverable - _TOLERANCE * max(coverable, 1e-300)
    most = 0
    for row in (None, *chosen):
        if row is not None:
            columns = matrix.indices[matrix.indptr[row] : matrix.indptr[row + 1]]
            wanted -= float(left[columns].sum())
            left[columns] = 0.0
        most = max(most, _rows_needed(sees @ left, wanted))
    return LowerBound(most, "marginal gains")


def _rows_needed(gains: NDArray[np.float64], wanted: float) -> int:
    """How many of the largest gains are needed to reach `wanted`."""
    if wanted <= 0:
        return 0
    reached = np.cumsum(np.sort(gains)[::-1])
    return int(np.searchsorted(reached, wanted)) + 1
