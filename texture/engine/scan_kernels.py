# SPDX-License-Identifier: MIT
"""The pruned scan, compiled: all candidates for one template, exactly, without measuring most positions.

Single precision only drops positions whose distance, less the largest possible rounding error, exceeds 1.1
times one that is attained; what survives is measured again in whole numbers. So the candidates and their
distances are those of `texture.sampling.sample`.
"""

from typing import NamedTuple

import numpy as np
from numba import int64
from numpy.typing import NDArray

from texture.engine.compiled import LANES, TERMS_PER_STEP, add_step, inlined
from texture.sampling.sample import FloatArray, IntArray, Sample, gaussian_weights

MISSING = np.float32(1e12)  # level where the sample has none: one difference exceeds every real distance
NO_BOUND = 1e20  # exceeds every distance within the sample, and no other
EXACT_BELOW = 2.0**24  # single precision adds whole numbers exactly as long as the sum is smaller
N_BUCKETS = 256  # terms of nearly the same expected size are not sorted further
_ROUNDING = 2.0**-23  # largest relative error of one operation in single precision, twice


class SampleArrays(NamedTuple):
    """A sample laid out for the scan: one plane a channel, rows one after the other, with a margin."""

    levels: NDArray[np.float32]  # (c * plane,), MISSING where the sample has no pixel
    costs: NDArray[np.float32]  # (plane,), 0 at centres that may be copied, MISSING elsewhere
    blocks: IntArray  # first centre of each block of LANES
    weights: IntArray  # (window, window)
    means: FloatArray  # (c,) of the levels that may be copied
    variances: FloatArray  # (c,)
    plane: int  # centres and margins of a plane
    row: int  # pixels of a row with its margins
    margin: int
    width: int  # pixels of a row without them


class Terms(NamedTuple):
    """What a distance sums, the most telling first: one term for each channel of each known pixel."""

    offsets: IntArray  # from the centre, in `SampleArrays.levels`
    values: NDArray[np.float32]
    weights: NDArray[np.float32]
    buckets: IntArray  # 0 for the most telling
    ends: IntArray  # (N_BUCKETS + 1,), where each bucket's terms end
    pixels: IntArray  # known pixels of the window, row * window + column
    colours: NDArray[np.float32]  # (n, c) of these


class Findings(NamedTuple):
    """Room for what a scan finds; n is the number of places in all blocks."""

    centres: IntArray  # (n,)
    distances: IntArray  # (n,)
    estimates: NDArray[np.float32]  # (n,) the distances in single precision
    sums: NDArray[np.float32]  # (LANES,)


def lay_out(sample: Sample) -> SampleArrays:
    """Return a sample's levels as planes, and the blocks of centres that may be copied."""
    height, width = sample.padded_usable.shape
    inner = np.s_[sample.margin : height - sample.margin, sample.margin : width - sample.margin]
    is_centre = np.zeros(sample.padded_usable.shape, dtype=np.bool_)
    is_centre[inner] = sample.usable
    places, n_channels = is_centre.size, sample.levels.shape[2]
    levels = np.full(
        n_channels * places + LANES, MISSING, dtype=np.float32
    )  # beyond the planes there is none
    planes = levels[: n_channels * places].reshape(n_channels, height, width)
    np.copyto(
        planes, np.moveaxis(sample.padded_levels, 2, 0), casting="same_kind", where=sample.padded_usable
    )
    costs = np.full(places + LANES, MISSING**2, dtype=np.float32)
    costs[:places][is_centre.ravel()], costs[places:] = 0, MISSING
    chosen = [sample.levels[..., channel][sample.usable] for channel in range(n_channels)]
    return SampleArrays(
        levels=levels,
        costs=costs,
        blocks=_list_blocks(np.flatnonzero(is_centre), LANES),
        weights=gaussian_weights(2 * sample.radius + 1),
        means=np.array([values.mean() for values in chosen]),
        variances=np.array([values.var() for values in chosen]),
        plane=height * width,
        row=width,
        margin=sample.margin,
        width=sample.usable.shape[1],
    )


def _list_blocks(centres: IntArray, size: int) -> IntArray:
    """Return where to begin the fewest runs of `size` places, none overlapping, that hold all centres."""
    starts, ordinal = [], 0
    while ordinal < centres.size:
        starts.append(centres[ordinal])
        ordinal = int(np.searchsorted(centres, centres[ordinal] + size))
    return np.array(starts, dtype=np.int64)


@inlined
def find_candidates(
    sample: SampleArrays, terms: Terms, n_known: int, guesses: IntArray, candidates: Findings
) -> tuple[int, int]:
    """Write the candidates' centres and distances, as `texture.sampling.sample.find_candidates`.

    Returns
    -------
    n_found, largest_distance : int
    """
    radius = len(sample.weights) // 2
    for reach in range(radius, 0, -1):
        n_terms, weight = _list_terms(sample, terms, n_known, reach)
        largest = weight * len(sample.means) * 255 * 255
        n_found = _scan(sample, terms, n_terms, guesses, candidates)
        if n_found > 0:
            return n_found, largest
    n_found = _measure_all(sample, terms, n_terms, candidates)
    return _keep_near(candidates, n_found), largest


@inlined
def _list_terms(sample: SampleArrays, terms: Terms, n_known: int, reach: int) -> tuple[int, int]:
    """Write the terms of known pixels at most `reach` from the centre; return how many, and their weight."""
    window, n_channels = len(sample.weights), len(sample.means)
    scale = (N_BUCKETS - 1) / np.sqrt(sample.weights.max() * (255.0**2 + sample.variances.max()))
    terms.ends[:] = 0
    n_terms, total = 0, 0
    for known in range(n_known):
        i, j = terms.pixels[known] // window - window // 2, terms.pixels[known] % window - window // 2
        if max(abs(i), abs(j)) > reach:
            continue
        weight = sample.weights[i + window // 2, j + window // 2]
        total += weight
        for channel in range(n_channels):
            away = terms.colours[known, channel] - sample.means[channel]
            telling = np.sqrt(weight * (away * away + sample.variances[channel]))
            terms.buckets[n_terms] = N_BUCKETS - 1 - int(scale * telling)
            terms.ends[terms.buckets[n_terms] + 1] += 1
            n_terms += 1
    for bucket in range(N_BUCKETS):
        terms.ends[bucket + 1] += terms.ends[bucket]
    term = 0
    for known in range(n_known):
        i, j = terms.pixels[known] // window - window // 2, terms.pixels[known] % window - window // 2
        if max(abs(i), abs(j)) > reach:
            continue
        for channel in range(n_channels):
            at = terms.ends[terms.buckets[term]]
            terms.ends[terms.buckets[term]] += 1
            terms.offsets[at] = channel * sample.plane + i * sample.row + j
            terms.values[at] = terms.colours[known, channel]
            terms.weights[at] = sample.weights[i + window // 2, j + window // 2]
            term += 1
    terms.weights[n_terms : n_terms + TERMS_PER_STEP] = 0  # they fill up the last step
    terms.values[n_terms : n_terms + TERMS_PER_STEP] = 0
    terms.offsets[n_terms : n_terms + TERMS_PER_STEP] = 0
    return n_terms, total


@inlined
def _scan(sample: SampleArrays, terms: Terms, n_terms: int, guesses: IntArray, findings: Findings) -> int:
    """Write the centres that offer all of the template and are at most 1.1 times as far as the nearest."""
    allowance = 1.1 * (1 + 3 * _ROUNDING * (n_terms + TERMS_PER_STEP))
    bound = NO_BOUND
    for guess in guesses:
        bound = min(bound, allowance * _measure(sample, terms, n_terms, guess, bound))
    addresses = (
        int64(sample.levels.ctypes.data),
        int64(terms.offsets.ctypes.data),
        int64(terms.values.ctypes.data),
        int64(terms.weights.ctypes.data),
        int64(sample.costs.ctypes.data),
        int64(findings.sums.ctypes.data),
    )
    n_found = 0
    for block in sample.blocks:
        before = addresses[4] + 4 * block
        is_near = True
        for step in range(0, n_terms, TERMS_PER_STEP):
            is_near = add_step(
                addresses[0] + 4 * block,
                addresses[1] + 8 * step,
                addresses[2] + 4 * step,
                addresses[3] + 4 * step,
                before,
                addresses[5],
                bound,
            )
            if not is_near:
                break
            before = addresses[5]
        if is_near:
            for lane in range(LANES):
                if findings.sums[lane] <= bound:
                    bound = min(bound, allowance * findings.sums[lane])
                    findings.centres[n_found], findings.estimates[n_found] = block + lane, findings.sums[lane]
                    n_found += 1
    n_near = 0
    for place in range(n_found):
        if findings.estimates[place] <= bound:
            centre = findings.centres[place]
            findings.centres[n_near] = centre
            findings.distances[n_near] = _measure_exactly(
                sample, terms, n_terms, centre, findings.estimates[place]
            )
            n_near += 1
    n_near = _keep_near(findings, n_near)
    return int(n_near)


@inlined
def _measure(sample: SampleArrays, terms: Terms, n_terms: int, centre: int, bound: float) -> float:
    """Return the distance of one centre, or what it is when it exceeds the bound."""
    total = 0.0
    for term in range(n_terms):
        difference = sample.levels[centre + terms.offsets[term]] - terms.values[term]
        total += terms.weights[term] * difference * difference
        if total > bound:
            break
    return float(total) if sample.levels[centre] != MISSING else NO_BOUND


@inlined
def _measure_exactly(
    sample: SampleArrays, terms: Terms, n_terms: int, centre: int, estimate: np.float32
) -> int:
    """Return the distance of a centre that offers all of the template, in whole numbers."""
    if estimate < EXACT_BELOW:
        return int(estimate)
    total = 0
    for term in range(n_terms):
        difference = int(sample.levels[centre + terms.offsets[term]]) - int(terms.values[term])
        total += int(terms.weights[term]) * difference * difference
    return total


@inlined
def _keep_near(findings: Findings, n_found: int) -> int:
    """Keep what is at most 1.1 times as far as the nearest; return how many."""
    nearest = findings.distances[:n_found].min() if n_found else 0
    n_near = 0
    for place in range(n_found):
        if 10 * findings.distances[place] <= 11 * nearest:
            findings.centres[n_near], findings.distances[n_near] = (
                findings.centres[place],
                findings.distances[place],
            )
            n_near += 1
    return n_near


@inlined
def _measure_all(sample: SampleArrays, terms: Terms, n_terms: int, findings: Findings) -> int:
    """Write all centres and their distances, missing counterparts as differences of 255; return how many."""
    n_found = 0
    for block in sample.blocks:
        for centre in range(block, block + LANES):
            if sample.costs[centre] == 0:
                total = 0
                for term in range(n_terms):
                    level = sample.levels[centre + terms.offsets[term]]
                    difference = 255 if level == MISSING else int(level) - int(terms.values[term])
                    total += int(terms.weights[term]) * difference * difference
                findings.centres[n_found], findings.distances[n_found] = centre, total
                n_found += 1
    return n_found
