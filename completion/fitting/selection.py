# SPDX-License-Identifier: MIT
"""Selection: which shape the evidence is for, with ratios, and "undecidable" as an answer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import numpy as np

from completion.fitting.euclidean import fit_euclidean
from completion.fitting.kinds import KINDS
from completion.fitting.limits import LEAST_RATIO, ROUNDING, TUKEY
from completion.fitting.result import FitError, SurfaceFit
from completion.fitting.robust import fit_robust
from completion.fitting.shape import Shape
from scenes.checks import Value, check_points

_N_STEPS = 100  # a shape that is not found in so many is not this one


@dataclass(frozen=True, slots=True, eq=False)
class Selection(Value):
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

    shape: Shape | None
    fits: dict[str, SurfaceFit]
    bic: dict[str, float]
    evidence: dict[str, float]
    failures: dict[str, str]

    def decide(self) -> Shape:
        """The shape that the evidence is for; raises FitError, with the ratios, where it is for none."""
        if self.shape is None:
            raise FitError(f"{self.summary()}; name the shape")
        return self.shape

    decided = decide  # earlier name

    def summary(self) -> str:
        """One line: the shapes with their evidence ratios."""
        ratios = ", ".join(f"{shape} 1 : {ratio:.3g}" for shape, ratio in list(self.evidence.items())[1:])
        best = next(iter(self.evidence))
        verdict = self.shape or f"undecidable, {best} first"
        return f"{verdict}; evidence against others: {ratios or 'none could be fitted'}"


def select(points: object, *, robust: bool = False) -> Selection:
    """Fit every shape to points (n, 3) and weigh the evidence; see `Selection`.

    Residuals count as independent; where they are not (a wall that bends a little), the ratios overstate.

    Parameters
    ----------
    points : (n, 3) float
        Metres.
    robust : bool
        Whether many of them may belong to something else.

    Raises
    ------
    InputError
        Points of another shape, or not finite.
    """
    cloud = check_points("points", points)
    fits: dict[str, SurfaceFit] = {}
    failures: dict[str, str] = {}
    for shape in KINDS:
        try:
            fits[shape] = (
                fit_robust(cloud, shape) if robust else fit_euclidean(cloud, shape, n_steps=_N_STEPS)
            )
        except FitError as error:
            failures[shape] = str(error)
    residuals = {shape: fit.surface.distance(cloud) for shape, fit in fits.items()}
    size = np.abs(cloud).max(initial=0.0)
    spread = np.abs(cloud - cloud[:1]).max(initial=0.0)
    extent = float(spread + 1e-3 * size)  # rounding grows with the distance from the origin
    return weigh(fits, residuals, failures, extent)


def weigh(
    fits: dict[str, SurfaceFit], residuals: dict[str, np.ndarray], failures: dict[str, str], extent: float
) -> Selection:
    """Weigh fits to the same points by BIC.

    Without outliers, BIC = n log(mean r^2) + k log n. Where a fit was robust, residuals are cut at 4.685
    times the least scale among the fits, and BIC = sum min(r / s, 4.685)^2 + k log n. Residuals below
    rounding (1e-12 of `extent`, metres) count as rounding, so that the simplest exact shape wins. A torus
    bends to every other shape in a limit: it is chosen where it is clearly the best, and leaves no other in
    doubt.

    Raises
    ------
    FitError
        No shape could be fitted with a degree of freedom to spare.
    """
    tried = {shape: fit for shape, fit in fits.items() if fit.degrees_of_freedom > 0}
    if not tried:
        reasons = "; ".join(f"{shape}: {why}" for shape, why in failures.items())
        raise FitError(f"no shape can be fitted with a degree of freedom to spare ({reasons})")
    floor = ROUNDING * extent
    robust = any(fit.inliers is not None for fit in tried.values())
    scale = max(min(_scale(fit, robust, tried) for fit in tried.values()), floor)
    bic = {}
    for shape, fit in tried.items():
        n = len(residuals[shape])
        if robust:
            misfit = float(np.sum(np.minimum(np.abs(residuals[shape]) / scale, TUKEY) ** 2))
        else:
            misfit = n * float(np.log(max(np.mean(residuals[shape] ** 2), floor**2)))
        bic[shape] = misfit + len(fit.covariance) * float(np.log(n))
    evidence = _ratios(bic)
    if next(iter(evidence)) == "torus" and len(bic) > 1 and list(evidence.values())[1] < LEAST_RATIO:
        del bic["torus"]  # it bends to every other in a limit, so doubt is for the other
        failures = failures | {"torus": f"evidence for it is below {LEAST_RATIO:g} : 1"}
        evidence = _ratios(bic)
    order = list(evidence)
    rivals = [shape for shape in order[1:] if shape != "torus"]
    decided = not rivals or evidence[rivals[0]] >= LEAST_RATIO
    ranked = {shape: tried[shape] for shape in order}
    return Selection(
        cast("Shape", order[0]) if decided else None, ranked, {s: bic[s] for s in order}, evidence, failures
    )


def _ratios(bic: dict[str, float]) -> dict[str, float]:
    """How many times more probable the best shape is than each, best first."""
    order = sorted(bic, key=lambda shape: bic[shape])
    return {shape: float(np.exp(min((bic[shape] - bic[order[0]]) / 2, 700.0))) for shape in order}


def _scale(fit: SurfaceFit, robust: bool, tried: dict[str, SurfaceFit]) -> float:
    """The scale a fit proposes; robust fits to few of the points propose none."""
    most = max(other.n for other in tried.values())
    return fit.rms if not robust or fit.n >= 0.5 * most else np.inf
