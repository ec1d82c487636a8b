# SPDX-License-Identifier: MIT
"""Alternatives: what else points may be: one plane, cylinder, sphere or cone, or two planes in an edge."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from completion.fitting.result import FitError
from completion.fitting.robust import fit_robust
from completion.templates.junctions.descent import LEAST_SIGMA, Descended, descend_from
from completion.templates.junctions.mixture import Mixture
from completion.templates.junctions.profiles import edge, tangent_arcs
from completion.templates.junctions.starts import N_DIRECTIONS, flat_starts
from scenes.checks import FloatArray

_ONE_ARC = np.array([True, True, True, True, False, False, True, True])
_TIED = np.column_stack([np.eye(8)[:, :4], np.array([0, 0, 0, 0, 0, 0, 1.0, 1.0])])  # of equal curvatures
_STRAIGHT = np.array([False, True, True, True, False, False, False, False])  # of no curvature
_EDGE = np.array([True, True, True, True, True, False, True])
_LEANS = np.array([[0.35], [-0.35]])
_SHARPEST = np.radians(65.0)  # from a plane: one that leans more is folded, and halves the room of outliers


class Alternative(NamedTuple):
    """Something plainer."""

    name: str
    log_likelihood: float
    n_parameters: int

    def value(self, n: int) -> float:
        """Return the log likelihood of n points less what the parameters cost (Schwarz 1978)."""
        return self.log_likelihood - 0.5 * self.n_parameters * float(np.log(n))


def one_arc(points: FloatArray, reach: float, n_directions: int = N_DIRECTIONS) -> Descended:
    """Return the one cylinder, or plane, that points (n, 3) at unit RMS are most likely on."""
    shapes = np.zeros((1, 2))
    starts = flat_starts(points, tangent_arcs, shapes, _ONE_ARC, ties=_TIED, n_directions=n_directions)
    return descend_from(starts, points, reach)[0]


def alternatives(points: FloatArray, reach: float, single: Descended) -> list[Alternative]:
    """Return what else points (n, 3) at unit RMS may be, beside the one cylinder that was fitted before."""
    flat = descend_from(flat_starts(points, tangent_arcs, np.zeros((1, 2)), _STRAIGHT)[:1], points, reach)[0]
    sharp = descend_from(flat_starts(points, edge, _LEANS, _EDGE), points, reach)
    found = [
        Alternative("a plane", flat.log_likelihood, 3),
        Alternative("one cylinder", single.log_likelihood, 5),
    ]
    open_ones = [one for one in sharp if abs(one.model.shape[0]) < _SHARPEST]
    found += [Alternative("a sharp edge", one.log_likelihood, 6) for one in open_ones[:1]]
    for kind, name, n in (("sphere", "a sphere", 4), ("cone", "a cone", 6)):
        try:
            distances = fit_robust(points, kind).surface.distance(points)
        except FitError:
            continue
        mixture = Mixture.of(distances, reach, single.mixture.sigma, LEAST_SIGMA)
        found.append(Alternative(name, float(mixture.log_densities(distances).sum()), n))
    return found
