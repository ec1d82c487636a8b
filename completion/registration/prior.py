# SPDX-License-Identifier: MIT
"""Settling: the small motions of scans that bring their facets together, and how well they are known."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from completion.evidence.sight import ScanSight
from completion.registration import limits
from completion.registration.facets import Meetings, ScanFacets, meet
from scenes.checks import FloatArray

Pair = tuple[int, int]
"""A scan, and another one whose facets are held against it."""


class FacetLinks(NamedTuple):
    """How offsets (n,) of facets that met change by small motions of both scans."""

    by_owner: FloatArray  # (n, 6) growth by turn and shift of the scan whose facets they are
    other: FloatArray  # (n, 6) decline by those of the scan that they met
    offset: FloatArray  # (n,) metres
    deviation: FloatArray  # (n,) expected error of each, metres
    places: FloatArray  # (n, 3) of the facets, metres


@dataclass(frozen=True, slots=True, eq=False)
class PoseCorrections:
    """Motions of n scans that bring their facets together.

    Attributes
    ----------
    motions : (n, 4, 4) float
        Of each scan, working frame.
    vectors : (n, 6) float
        The same as turns about `pivots`, radians, and shifts, metres.
    covariance : (6 n, 6 n) float
        Of the vectors.
    pivots : (n, 3) float
        The middle of each scan's facets, metres.
    shifts : (n,) float
        Root mean square by which each motion shifts the scan's facets along their normals, metres.
    """

    motions: FloatArray
    vectors: FloatArray
    covariance: FloatArray
    pivots: FloatArray
    shifts: FloatArray

    def shift_between(self, pair: Pair, links: FacetLinks) -> tuple[FloatArray, FloatArray]:
        """How far the motions shift the facets of a pair apart (n,), metres, and the variances of that.

        The links are those of the poses as given.
        """
        (i, j), n = pair, len(links.offset)
        chosen = np.r_[6 * j : 6 * j + 6, 6 * i : 6 * i + 6]
        both = np.concatenate([links.by_owner, -links.other], axis=1).reshape(n, 12)
        variance = np.einsum("ij,jk,ik->i", both, self.covariance[np.ix_(chosen, chosen)], both)
        apart = self.motions[j] - self.motions[i]
        shift = links.places @ apart[:3, :3].T + apart[:3, 3]
        return np.einsum("ij,ij->i", shift, links.by_owner[:, 3:]), np.maximum(variance, 0.0)


def settle(
    facets: Sequence[ScanFacets],
    sights: Sequence[ScanSight],
    pairs: Sequence[Pair],
    known: Mapping[int, FloatArray] | None = None,
) -> PoseCorrections:
    """Bring the facets of scans together by point-to-plane least squares over all pairs at once.

    Offsets are weighted by their variance, and by a function of their robust spread in the pair that falls
    again (Geman & McClure 1987), so that what moved between two scans has no say. Each scan's motion has a
    normal prior whose scale is learned with it (MacKay 1992): scans that fit stay where they are, the one
    that does not moves, and directions in which facets tell nothing keep their pose. Facets of a pair tell
    as much as twenty independent ones at most, since what bends a wall is common to neighbours.

    Parameters
    ----------
    facets, sights : sequences
        Of each of n scans.
    pairs : sequence of (int, int)
        Which scans' facets (the second) are held against which scan (the first).
    known : mapping, optional
        Motions (4, 4) of scans that are settled already.
    """
    held = dict(known or {})
    n = len(facets)
    pivots = np.array([_middle(facet, sight) for facet, sight in zip(facets, sights, strict=True)])
    moments = np.array([_moment(facet, pivot) for facet, pivot in zip(facets, pivots, strict=True)])
    reach = np.sqrt(np.maximum(np.trace(moments[:, :3, :3], axis1=1, axis2=2), limits.LEAST_SCALE_M))
    vectors: FloatArray = np.zeros((n, 6))
    covariance: FloatArray = np.zeros((6 * n, 6 * n))
    scale: FloatArray = np.full(n, limits.FIRST_M)
    scale[[*held]] = limits.KNOWN_M
    motions: FloatArray = np.array([held.get(k, np.eye(4)) for k in range(n)])
    for _ in range(limits.N_ROUNDS_PRIOR):
        matrix, vector = _equations(link_all(facets, sights, pairs, motions, pivots), n)
        vector += matrix @ vectors.ravel()
        before = vectors
        for _ in range(limits.N_PRIORS):
            prior = np.repeat(1.0 / np.square(np.stack([scale / reach, scale], axis=1)), 3, axis=1).ravel()
            covariance = np.asarray(np.linalg.inv(matrix + np.diag(prior)), dtype=np.float64)
            vectors = (covariance @ vector).reshape(n, 6)
            learned = _scales(moments, vectors, covariance)
            learned[[*held]] = limits.KNOWN_M
            if np.allclose(learned, scale, rtol=0.05):
                break
            scale = learned
        motions = np.asarray([held.get(k, _motion(vectors[k], pivots[k])) for k in range(n)])
        if _shifts(moments, vectors - before).max() < limits.STILL_PRIOR_M:
            break
    return PoseCorrections(motions, vectors, covariance, pivots, _shifts(moments, vectors))


def link_all(
    facets: Sequence[ScanFacets],
    sights: Sequence[ScanSight],
    pairs: Sequence[Pair],
    motions: FloatArray,
    pivots: FloatArray,
) -> Iterator[tuple[Pair, FacetLinks]]:
    """Yield the links of each pair of n scans, moved by `motions` (n, 4, 4); `pivots` (n, 3), metres."""
    for pair, met in meet_all(facets, sights, pairs, motions):
        yield pair, link(pair, met, facets, motions, pivots)


def meet_all(
    facets: Sequence[ScanFacets], sights: Sequence[ScanSight], pairs: Sequence[Pair], motions: FloatArray
) -> Iterator[tuple[Pair, Meetings]]:
    """Yield what the facets of each pair's second scan meet in its first, moved by `motions` (n, 4, 4)."""
    back = np.linalg.inv(motions)
    for i, j in pairs:
        motion = np.ascontiguousarray((back[i] @ motions[j])[:3])
        yield (i, j), meet(facets[j], motion, sights[i], facets[i], 1)


def link(
    pair: Pair, meetings: Meetings, facets: Sequence[ScanFacets], motions: FloatArray, pivots: FloatArray
) -> FacetLinks:
    """Return how the offsets of a pair change with its scans' `motions` (n, 4, 4) about `pivots` (n, 3)."""
    met, (i, j) = meetings.met, pair
    places = facets[j].centre[met] @ motions[j, :3, :3].T + motions[j, :3, 3]
    normals = meetings.normal[met] @ motions[i, :3, :3].T
    by_second, other = (_by_motion(places, normals, pivots[k]) for k in (j, i))
    return FacetLinks(by_second, other, meetings.offset[met], meetings.deviation[met], places)


def _by_motion(places: FloatArray, normals: FloatArray, pivot: FloatArray) -> FloatArray:
    """How heights (n,) of places (n, 3) along normals grow by turn about the pivot and shift (n, 6)."""
    arm, growth = places - pivot, np.empty((len(places), 6))
    for axis in range(3):
        first, second = (axis + 1) % 3, (axis + 2) % 3
        growth[:, axis] = arm[:, first] * normals[:, second] - arm[:, second] * normals[:, first]
    growth[:, 3:] = normals
    return growth


def _equations(links: Iterable[tuple[Pair, FacetLinks]], n: int) -> tuple[FloatArray, FloatArray]:
    """Normal equations (6 n, 6 n), (6 n,) of the pairs that tell anything."""
    matrix, vector = np.zeros((6 * n, 6 * n)), np.zeros(6 * n)
    for (i, j), scan_links in links:
        if len(scan_links.offset) < limits.LEAST_MEETINGS:
            continue
        weight = _weights(scan_links)[:, None]
        here, there = slice(6 * i, 6 * i + 6), slice(6 * j, 6 * j + 6)
        weighted, other = weight * scan_links.by_owner, weight * scan_links.other
        matrix[there, there] += weighted.T @ scan_links.by_owner
        matrix[here, here] += other.T @ scan_links.other
        matrix[there, here] -= weighted.T @ scan_links.other
        matrix[here, there] -= other.T @ scan_links.by_owner
        vector[there] -= weighted.T @ scan_links.offset
        vector[here] += other.T @ scan_links.offset
    return matrix, vector


def _weights(links: FacetLinks) -> FloatArray:
    """Inverse variances (n,) of offsets, 1 / metres squared, robust, of all as of some independent ones."""
    ratio = links.offset / links.deviation
    spread = max(1.0, 1.4826 * float(np.median(np.abs(ratio))))
    robust = np.square(1.0 / (1.0 + np.square(ratio / (limits.ROBUST_PRIOR * spread))))
    share = min(1.0, limits.INDEPENDENT / len(ratio))
    return np.asarray(share * robust / np.square(spread * links.deviation))


def _moment(facets: ScanFacets, pivot: FloatArray) -> FloatArray:
    """Mean (6, 6) of what a motion does to heights along the normals of facets; zeros without any."""
    by_motion = _by_motion(facets.centre, facets.normal, pivot)
    return np.asarray(by_motion.T @ by_motion / max(len(by_motion), 1))


def _shifts(moments: FloatArray, vectors: FloatArray) -> FloatArray:
    """Root mean square (n,) by which motions (n, 6) shift facets along their normals, metres."""
    return np.asarray(np.sqrt(np.einsum("ni,nij,nj->n", vectors, moments, vectors)))


def _scales(moments: FloatArray, vectors: FloatArray, covariance: FloatArray) -> FloatArray:
    """The same, as expected from the motions and their covariance."""
    n = len(vectors)
    members = covariance.reshape(n, 6, n, 6)[np.arange(n), :, np.arange(n)]
    square = np.square(_shifts(moments, vectors)) + np.einsum("nij,nji->n", moments, members)
    return np.asarray(np.sqrt(np.clip(square, limits.LEAST_SCALE_M**2, limits.MOST_SCALE_M**2)))


def _motion(vector: FloatArray, pivot: FloatArray) -> FloatArray:
    """The motion (4, 4) of a turn about the pivot and a shift (6,)."""
    motion = np.eye(4)
    motion[:3, :3] = Rotation.from_rotvec(vector[:3]).as_matrix()
    motion[:3, 3] = pivot + vector[3:] - motion[:3, :3] @ pivot
    return motion


def _middle(facets: ScanFacets, sight: ScanSight) -> FloatArray:
    """The mean (3,) of a scan's facets; its sensor's place without any."""
    return facets.centre.mean(axis=0) if len(facets.centre) else np.array(sight.eye.origin)
