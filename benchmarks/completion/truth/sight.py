# SPDX-License-Identifier: MIT
"""Sight: which places the scans see, miss or look through, by noise-free rays to the places themselves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from scenes.checks import FloatArray, InputError
from scenes.rays.raycast import RayCaster
from scenes.scan.range_image import RangeImage

_MAX_TOLERANCE_M = 0.1


class Sight(IntEnum):
    """What the scans know of a place, weakest first; the strongest word of all scans counts."""

    OUT = 0  # in no scan's view
    HIDDEN = 1  # in the view of some and blocked in all of them
    VISIBLE = 2  # a ray ends there
    FREE = 3  # a ray goes through


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """What the scans know of n places.

    Attributes
    ----------
    sight : (n,) int8
        A `Sight` for each.
    blocker : (n,) int32
        For hidden places the face of the true mesh that hides it from the first scan that has it in view,
        -1 for others.
    """

    sight: NDArray[np.int8]
    blocker: NDArray[np.int32]


def sight_of(
    points: FloatArray,
    scans: Sequence[RangeImage],
    caster: RayCaster,
    tolerance_m: float,
    normals: FloatArray,
) -> Sighting:
    """Look at places from all scans.

    Parameters
    ----------
    points : (n, 3) float
        World coordinates, metres.
    scans : sequence of RangeImage
        Their poses and projections count.
    caster : RayCaster
        The true mesh.
    tolerance_m : float
        How far across the surface the true one may lie for the place to be seen; along the ray it is this
        over the cosine of the incidence angle, at most 10 cm.
    normals : (n, 3) float
        Unit normals of the surface there.

    Notes
    -----
    A ray to the place that goes through makes it free only if the beam of the pixel that it falls into, as
    `truth` has it, goes through as well; else no beam has been there, and the place is hidden.
    """
    sight, blocker = np.full(len(points), Sight.OUT, np.int8), np.full(len(points), -1, np.int32)
    for scan in scans:
        pixels = scan.pixels(points)
        inside = np.flatnonzero(np.isfinite(pixels).all(axis=1))
        if not len(inside):
            continue
        ray = points[inside] - scan.origin
        distance = np.linalg.norm(ray, axis=1)
        cosine = np.abs(np.einsum("ij,ij->i", ray, normals[inside])) / np.maximum(distance, 1e-12)
        tolerance = np.minimum(tolerance_m / np.maximum(cosine, 1e-3), _MAX_TOLERANCE_M)
        hits = caster.first_hit(scan.origin[None], ray)
        behind = distance - hits.ranges  # positive where something stands before the place
        row, column = np.rint(pixels[inside]).astype(np.int64).T
        beam_passes = noise_free_ranges(scan)[row, column] > distance + tolerance
        word = np.full(len(inside), Sight.VISIBLE, np.int8)
        word[behind > tolerance] = Sight.HIDDEN
        word[behind < -tolerance] = Sight.HIDDEN
        word[(behind < -tolerance) & beam_passes] = Sight.FREE
        first = (sight[inside] == Sight.OUT) & (word == Sight.HIDDEN)
        blocker[inside[first]] = hits.face[first]
        sight[inside] = np.maximum(sight[inside], word)
    blocker[sight != Sight.HIDDEN] = -1
    return Sighting(sight, blocker)


def noise_free_ranges(scan: RangeImage) -> FloatArray:
    """True ranges (rows, columns) of a simulated scan, inf where its rays met nothing.

    Raises
    ------
    InputError
        A scan without truth.
    """
    if scan.truth is None:
        raise InputError(f"scan {scan.name!r} has no truth channels; evaluation needs simulated scans")
    return scan.truth.ranges
