# SPDX-License-Identifier: MIT
"""Borders: the fits of faces without the points that may be on the face beside.

Where two faces meet smoothly, as a fillet and its plane do, their surfaces differ by less than k sigma over a
width of sqrt(2 r k sigma), r being the fillet's radius. Which face a point there is given to depends on its
error, and what a fit makes of points that were chosen by their errors is biased: radii of fillets came out
3.6 standard deviations high.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from completion.fitting.result import SurfaceFit
from completion.parts.division.adjusting import N_PARAMETERS
from completion.parts.division.faces import fitted_face
from completion.parts.division.limits import APART, LEAST_INSIDE
from completion.parts.division.neighbourhoods import Neighbourhoods
from scenes.checks import BoolArray, FloatArray, IntArray

_LEAST_LINKS = 3  # between points of two faces that touch


def fits_inside(
    about: Neighbourhoods,
    points: FloatArray,
    fits: Sequence[SurfaceFit],
    labels: IntArray,
    kept: IntArray,
) -> tuple[SurfaceFit, ...]:
    """The fits to the points (n, 3) of each label (n,) again, without borders to the faces beside.

    A point is left out if its foot on the face's own surface is within `limits.APART` tolerances of a surface
    beside: the foot, unlike the point, does not depend on the error by which the point found its face. A
    face that would keep less than `limits.LEAST_INSIDE` of its points keeps its fit.

    Parameters
    ----------
    about : Neighbourhoods
        Which of the points `kept` (m,) are beside one another.
    """
    beside = _faces_beside(about, labels[kept], len(fits))
    inside = list(fits)
    for number, fit in enumerate(fits):
        members = points[labels == number + 1]
        clear = _clear_of(members, fit, [fits[other] for other in beside[number]], about.tolerance_m)
        least = max(LEAST_INSIDE * len(members), N_PARAMETERS[fit.surface.kind] + 2)
        if clear.all() or np.count_nonzero(clear) < least:
            continue
        again = fitted_face(members[clear], fit.surface, about.noise_m)
        inside[number] = fit if again is None else again
    return tuple(inside)


def _faces_beside(about: Neighbourhoods, labels: IntArray, n: int) -> list[list[int]]:
    """The places, from 0, of the faces that touch each of n faces."""
    rows = np.repeat(labels, np.diff(about.links.indptr))
    others = labels[about.links.indices]
    touch = (rows > 0) & (others > 0) & (rows != others)
    pairs, count = np.unique(np.column_stack([rows, others])[touch] - 1, axis=0, return_counts=True)
    beside: list[list[int]] = [[] for _ in range(n)]
    for first, other in pairs[count >= _LEAST_LINKS]:
        beside[first].append(int(other))
    return beside


def _clear_of(
    points: FloatArray, fit: SurfaceFit, others: Sequence[SurfaceFit], tolerance_m: float
) -> BoolArray:
    """Which points (n, 3) of a face are where its surface and none of the others' are alike."""
    clear = np.ones(len(points), dtype=np.bool_)
    foot = points - fit.surface.distance(points)[:, None] * fit.surface.normal(points)
    for other in others:
        apart = np.abs(other.surface.distance(foot)) > APART * tolerance_m
        if np.count_nonzero(apart) >= LEAST_INSIDE * len(points):  # else both are pieces of one surface
            clear &= apart
    return clear
