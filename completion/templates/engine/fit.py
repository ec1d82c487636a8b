# SPDX-License-Identifier: MIT
"""Fit of a template on one page: search, least squares, what is known of it, and whether it is there."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from completion.templates.engine.equations import Gate, equations
from completion.templates.engine.exploration import REACH, breach, explore
from completion.templates.engine.judgement import evidence, judged, knowledge, misfit
from completion.templates.engine.measured import Measured
from completion.templates.engine.refinement import refine
from completion.templates.engine.template import Given, Template, TemplateFit
from scenes.checks import FloatArray, InputError

NOTHING: Given = {}
_FOR_SQUARES = 0.3  # of the budget
_LEAST_POINTS = 8


def fit_template(
    template: Template,
    measured: Measured,
    given: Given = NOTHING,
    *,
    rng: np.random.Generator,
    budget: int = 20_000,
    starts: FloatArray | None = None,
    equal: Sequence[tuple[str, ...]] = (),
    gates: Sequence[Gate] = (),
) -> TemplateFit:
    """Fit a template to points, and weigh it against a plain surface.

    Parameters
    ----------
    template : Template
        What is fitted.
    measured : Measured
        Points, and beams where there are.
    given : mapping
        Parameters that are known: held exactly.
    rng : Generator
        Of the search.
    budget : int
        Evaluations at most, of distances to all points that a stage looks at.
    starts : (s, k) float, optional
        Parameters to begin with, among others.
    equal : sequence of tuple of str
        Parameters that are one.
    gates : sequence of Gate
        Constraints that hold within a tolerance; what obeys them beats what does not.

    Returns
    -------
    TemplateFit
        Its evidence is the log likelihood against the best plain surface, both with outliers, less what the
        parameters cost: the share of their bounds that is left to them (Laplace), and divided by what
        neighbouring residuals have in common. It is not complete where the budget, or an interrupt, ended the
        search before the best value stood still, or least squares before the same points kept their weights.
        Parameters that the points leave open have an infinite variance.

    Raises
    ------
    InputError
        Fewer than eight points; a given or equal parameter that there is not; bounds that are not finite.
    """
    points = measured.points
    if len(points) < _LEAST_POINTS:
        raise InputError(f"a template needs {_LEAST_POINTS} points, got {len(points)}")
    bounds = template.bounds(measured)
    sought = equations(template.names, bounds, given, equal)

    # 1. Search: truncated distances of some points, from anywhere.
    begun = [] if starts is None else [sought.sought(one) for one in np.atleast_2d(starts)]
    found = explore(
        template,
        measured,
        sought,
        rng=rng,
        budget=max(1, round((1 - _FOR_SQUARES) * budget)),
        begun=begun,
        gates=gates,
    )

    # 2. Least squares: all points, robust.
    def distance(z: FloatArray) -> FloatArray:
        return template.distance(points, sought.full(z))[0]

    least = 1e-9 * measured.diagonal
    size = np.abs(distance(found.place))
    near = size[size < REACH * measured.diagonal]
    sigma = max(1.4826 * float(np.median(near)) if len(near) else 0.0, least)
    refined = refine(distance, found.place, sigma, least_sigma=least, most=budget - found.evaluations)
    if breach(gates, sought.full(refined.place)) > found.violation:  # least squares knows of no gates
        refined = refine(distance, found.place, sigma, least_sigma=least, most=0)

    # 3. What is known: covariance, faces, evidence.
    known = knowledge(template, measured, sought, refined)
    nats, plain = evidence(measured, refined, known)
    wrong = misfit(measured, refined)
    status, reason = judged(template, known, nats, plain=plain, wrong=wrong, breach=found.violation)
    return TemplateFit(
        kind=template.kind,
        status=status,
        names=template.names,
        x=sought.full(refined.place),
        covariance=known.covariance,
        sides=known.sides,
        evidence=nats,
        faces=template.faces,
        assignment=known.faces,
        evaluations=found.evaluations + refined.evaluations,
        is_complete=found.is_settled and refined.is_settled,
        reason=reason,
        held=sought.held,
    )
