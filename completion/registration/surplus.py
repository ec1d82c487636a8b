# SPDX-License-Identifier: MIT
"""Surplus: what agrees of two scans beyond the three planes that any pose can bring together.

The corner of a room fits that of any other one: three planes settle the six numbers of a pose, and that they
agree says nothing of whether the scans share anything. What else agrees does.
"""

from __future__ import annotations

import numpy as np

from completion.registration.agreement import AGREES, ask_facets
from completion.registration.candidates.motions import inverse
from completion.registration.candidates.station_view import StationView
from scenes.checks import FloatArray, IntArray

_N_FREE = 3  # planes that a pose can bring together
_ALIKE, _SAME_M = np.cos(np.radians(15.0)), 0.08  # of facets of one plane
_N_SEEDS = 30  # facets whose planes are tried


def surplus_of(a: StationView, b: StationView, motion: FloatArray, within_m: float) -> float:
    """Return what agrees of scans, b moved by `motion` (3, 4) to a, beyond three planes, 0 to 2.

    It is a share of the facets of either scan's sample, summed over both.
    """
    return _share(b, a, motion, within_m) + _share(a, b, inverse(motion), within_m)


def _share(own: StationView, other: StationView, motion: FloatArray, within_m: float) -> float:
    told = ask_facets(own.facets, own.sample, motion, other.sight, other.facets, within_m)
    left = own.sample[told == AGREES]
    for _ in range(_N_FREE):
        left = _without_largest(own.facets.normal[left], own.facets.centre[left], left)
    return len(left) / max(len(own.sample), 1)


def _without_largest(normals: FloatArray, places: FloatArray, facets: IntArray) -> IntArray:
    """The facets (m,) that do not lie in the plane in which most of them lie."""
    if not len(facets):
        return facets
    seeds = slice(None, None, max(1, len(facets) // _N_SEEDS))
    height = np.einsum("ij,ij->i", places[seeds], normals[seeds])
    together = normals @ normals[seeds].T > _ALIKE
    together &= np.abs(places @ normals[seeds].T - height) < _SAME_M
    return np.asarray(facets[~together[:, together.sum(axis=0).argmax()]])
