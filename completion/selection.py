# SPDX-License-Identifier: MIT
"""Selection: which shape the evidence is for, with ratios, and "undecidable" as an answer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from completion.fitting_result import FitError, SurfaceFit

LEAST_RATIO = 20.0  # "strong" evidence (Kass & Raftery 1995)
_ROUNDING = 1e-12
_CUT = 4.685


@dataclass(frozen=True, slots=True, eq=False)
class Selection:
    """The shapes tried, best first.

    Attributes
    ----------
    shape : str or None
        The shape that the evidence is for; None where it is undecidable.
    fits : dict of str to SurfaceFit
        Every shape that could be fitted.
    bic : dict of str to float
        Bayesian information criterion of each, on Euclidean residuals; less is better.
    evidence : dict of str to float
        How many times more probable the best shape is than each (Bayes factor by BIC); 1 for the best.
    failures : dict of str to str
        Why a shape could not be fitted.
    """

    shape: str | None
    fits: dict[str, SurfaceFit]
    bic: dict[str, float]
    evidence: dict[str, float]
    failures: dict[str, str]

    def summary(self) -> str:
        """One line: the shapes with their evidence ratios."""
        ratios = ", ".join(f"{shape} 1 : {ratio:.3g}" for shape, ratio in list(self.evidence.items())[1:])
        best = next(iter(self.evidence))
        verdict = self.shape or f"undecidable, {best} first"
        return f"{verdict}; evidence against others: {ratios or 'none could be fitted'}"


def weigh(
    fits: dict[str, SurfaceFit], residuals: dict[str, np.ndarray], failures: dict[str, str], extent: float
) -> Selection:
    """Weigh fits to the same points by BIC.

    Without outliers, BIC = n log(mean r^2) + k log n. Where a fit was robust, residuals are cut at 4.685
    times the least scale among the fits, and BIC = sum min(r / s, 4.685)^2 + k log n. Residuals below
    rounding (1e-12 of `extent`, metres) count as rounding, so that the simplest exact shape wins.

    Raises
    ------
    FitError
        No shape could be fitted with a degree of freedom to spare.
    """
    tried = {shape: fit for shape, fit in fits.items() if fit.degrees_of_freedom > 0}
    if not tried:
        reasons = "; ".join(f"{shape}: {why}" for shape, why in failures.items())
        raise FitError(f"no shape can be fitted with a degree of freedom to spare ({reasons})")
    floor = _ROUNDING * extent
    robust = any(fit.inliers is not None for fit in tried.values())
    scale = max(min(_scale(fit, robust, tried) for fit in tried.values()), floor)
    bic = {}
    for shape, fit in tried.items():
        n = len(residuals[shape])
        if robust:
            misfit = float(np.sum(np.minimum(np.abs(residuals[shape]) / scale, _CUT) ** 2))
        else:
            misfit = n * float(np.log(max(np.mean(residuals[shape] ** 2), floor**2)))
        bic[shape] = misfit + len(fit.covariance) * float(np.log(n))
    order = sorted(bic, key=lambda shape: bic[shape])
    least = bic[order[0]]
    evidence = {shape: float(np.exp(min((bic[shape] - least) / 2, 700.0))) for shape in order}
    decided = len(order) == 1 or evidence[order[1]] >= LEAST_RATIO
    ranked = {shape: tried[shape] for shape in order}
    return Selection(order[0] if decided else None, ranked, {s: bic[s] for s in order}, evidence, failures)


def _scale(fit: SurfaceFit, robust: bool, tried: dict[str, SurfaceFit]) -> float:
    """The scale a fit proposes; robust fits to few of the points propose none."""
    most = max(other.n for other in tried.values())
    return fit.rms if not robust or fit.n >= 0.5 * most else np.inf
