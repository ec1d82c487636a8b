# SPDX-License-Identifier: MIT
"""Unconfirmed pieces: what one frame of a sequence took for a surface, and no other one that looked there."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from completion.evidence.sight import Sight, pixel_of
from completion.merging.merged_surface import MergedSurface
from completion.merging.pieces import Piece
from completion.observe.rays import deviation_at
from completion.observe.triple import dot, minus
from completion.segmentation.regions import Region
from scenes.checks import FloatArray
from scenes.run.mapping import trim
from texture.engine.compiled import compiled

_VOTES = 5  # frames against one: what is found as often as not is missed by all with probability 1/32
_AS_NEAR = 1.1  # times as far: frames from beyond see too coarsely to have a vote
_MAJORITY = 0.5  # of a piece's points


class Unconfirmed(NamedTuple):
    """What was left out of a sequence: regions of single frames, and their pixels."""

    n_regions: int
    n_pixels: int

    @classmethod
    def of(cls, regions: Sequence[Sequence[Region]], merged: Sequence[MergedSurface]) -> Unconfirmed:
        """Count the regions, and the pixels, of all scans that are of no merged surface."""
        n_regions = sum(len(own) for own in regions) - sum(one.n_parts for one in merged)
        n_pixels = sum(one.n_pixels for own in regions for one in own) - sum(one.n_pixels for one in merged)
        return cls(n_regions, n_pixels)


def confirmed(groups: Sequence[list[Piece]], sights: Sequence[Sight], first: int) -> list[list[Piece]]:
    """Return the groups without pieces of one frame that five others did not find again.

    Far off, noise makes planes of its own, and each frame of a sequence makes other ones. A frame speaks
    against a piece if it measured where most of its points are, from as near, and nothing stood before them,
    but no piece of it is of the same surface. Pixels of what is left out are of no surface, and stay
    measured.

    Parameters
    ----------
    groups : sequence of list of Piece
        The pieces of each surface, all of them of these frames.
    sights : sequence of Sight
        Consecutive frames of a sequence.
    first : int
        Number of the first of them.
    """
    alone = [number for number, group in enumerate(groups) if len(group) == 1]
    if not alone or len(sights) <= _VOTES:
        return list(groups)
    pieces = [groups[number][0] for number in alone]
    which = np.repeat(np.arange(len(pieces)), [len(one.part.points) for one in pieces])
    points = np.concatenate([one.part.points for one in pieces])
    scale = np.array([one.part.scale for one in pieces])[which]
    own = np.array([one.pixels[0][0] - first for one in pieces])
    reach = np.empty(len(points))
    for scan in np.unique(own).tolist():
        of_scan = own[which] == scan
        reach[of_scan] = np.linalg.norm(points[of_scan] - np.array(sights[scan].eye.origin), axis=1)

    n_points, votes = np.bincount(which), np.zeros(len(pieces), np.int64)
    for number, sight in enumerate(sights):
        sees = _sees(sight, points, scale, _AS_NEAR * reach)
        share = np.bincount(which, sees, minlength=len(pieces)) / n_points
        votes += (share > _MAJORITY) & (own != number)
        trim()
    left_out = {number for number, n in zip(alone, votes.tolist(), strict=True) if n >= _VOTES}
    return [group for number, group in enumerate(groups) if number not in left_out]


@compiled
def _sees(sight: Sight, points: FloatArray, scale: FloatArray, farthest: FloatArray) -> NDArray[np.int8]:
    """Tell at which points (n, 3), known to `scale` (n,), a scan measured with nothing before them.

    From no farther than `farthest` (n,), metres.
    """
    eye, found = sight.eye, np.zeros(len(points), np.int8)
    for i in range(len(points)):
        place = points[i, 0], points[i, 1], points[i, 2]
        ray = minus(place, eye.origin)
        distance = np.sqrt(dot(ray, ray))
        if distance > farthest[i]:
            continue
        pixel = pixel_of(eye, sight.angles, place)
        if pixel < 0 or not np.isfinite(sight.ranges[pixel]):
            continue
        measured = sight.ranges[pixel]
        sigma = deviation_at(sight.noise, measured)
        allowed = eye.n_sigma * np.sqrt(sigma * sigma + scale[i] * scale[i]) + eye.registration_m
        found[i] = measured >= distance - allowed
    return found
