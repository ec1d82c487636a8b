# SPDX-License-Identifier: MIT
"""The candidate rule against a brute-force check in plain Python, and the compiled scan against both."""

import sys
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from texture import fill
from texture.engine import kernels, scan_kernels
from texture.engine.kernels import view
from texture.engine.passes import can_compile
from texture.engine.scan_kernels import lay_out
from texture.sampling.arguments import LARGEST_WINDOW
from texture.sampling.canvas import Canvas
from texture.sampling.randomness import Purpose, pick, random_words
from texture.sampling.sample import (
    IntArray,
    MatchingPlaces,
    PixelTemplate,
    Sample,
    find_candidates,
    gaussian_weights,
    measure_distances,
    scan_exhaustively,
)

NO_SOURCES = np.full((3, 3), -1)


def draw_case(
    seed: int, window: int, n_channels: int, wrap: tuple[bool, bool], share_usable: float = 0.9
) -> tuple[PixelTemplate, Sample]:
    """A random sample, and a template that is half a noisy copy of a piece of it."""
    rng = np.random.default_rng(seed)
    shape = (int(rng.integers(1, 13)), int(rng.integers(1, 13)))
    levels = rng.integers(0, 4, (*shape, n_channels)) * 60
    usable = rng.random(shape) < share_usable
    usable[rng.integers(shape[0]), rng.integers(shape[1])] = True
    shifts = np.arange(window) - window // 2
    piece = levels[(shifts + rng.integers(shape[0]))[:, None] % shape[0], (shifts + 3) % shape[1]]
    known = rng.random((window, window)) < rng.uniform(0.1, 0.9)
    known[window // 2, window // 2] = False
    known[window // 2, window // 2 - 1] = True
    template = PixelTemplate(np.clip(piece + rng.integers(-9, 10, piece.shape), 0, 255), known)
    return template, Sample(levels, usable, wrap, window // 2)


def find_compiled(template: PixelTemplate, sample: Sample, sources: IntArray | None = None) -> MatchingPlaces:
    """The compiled engine's candidates, with the continuations of the neighbours' `sources` as guesses."""
    if sources is None:
        sources = np.random.default_rng(0).integers(-1, sample.usable.size, (3, 3))
    arrays = lay_out(sample)
    known = np.flatnonzero(template.known)
    canvas = Canvas.empty(sample.usable.shape, sample.levels.shape[2], sample.wrap, len(template.known))
    terms, found = kernels.make_terms(view(canvas)), kernels.make_findings(arrays)
    terms.pixels[: known.size] = known
    terms.colours[: known.size] = template.levels.reshape(template.known.size, -1)[known]
    rows, columns = np.divmod(sources, arrays.width)
    shifts = np.indices((3, 3)) - 1
    guesses = (rows - shifts[0] + arrays.margin) * arrays.row + columns - shifts[1] + arrays.margin
    n_found, largest = scan_kernels.find_candidates(arrays, terms, known.size, guesses[sources >= 0], found)
    rows, columns = np.divmod(found.centres[:n_found], arrays.row)
    positions = (rows - arrays.margin) * arrays.width + columns - arrays.margin
    return MatchingPlaces(positions, found.distances[:n_found], largest)


FINDERS = (find_compiled, find_candidates)


def find_by_hand(template: PixelTemplate, sample: Sample) -> dict[int, int]:
    """The definition, pixel by pixel: {position: distance} of all positions within 1.1 of the best."""
    (height, width), window = sample.usable.shape, template.known.shape[0]
    weights, usable = gaussian_weights(window).tolist(), sample.usable.tolist()
    levels, colours = sample.levels.tolist(), template.levels.tolist()
    known = np.argwhere(template.known).tolist()
    distances = {}
    for row, column in np.argwhere(sample.usable).tolist():
        distance = 0
        for i, j in known:
            there = [row + i - window // 2, column + j - window // 2]
            for axis, size in enumerate((height, width)):
                if sample.wrap[axis]:
                    there[axis] %= size
            if not (0 <= there[0] < height and 0 <= there[1] < width and usable[there[0]][there[1]]):
                break
            pairs = zip(levels[there[0]][there[1]], colours[i][j], strict=True)
            distance += weights[i][j] * sum((one - other) ** 2 for one, other in pairs)
        else:
            distances[row * width + column] = distance
    best = min(distances.values(), default=0)
    return {position: d for position, d in distances.items() if Fraction(d) <= Fraction(11, 10) * best}


@settings(max_examples=15, deadline=None, derandomize=True)
@given(
    seed=st.integers(0, 2**32 - 1),
    window=st.sampled_from([3, 5, 7]),
    n_channels=st.integers(1, 4),
    wrap=st.tuples(st.booleans(), st.booleans()),
)
def test_both_engines_follow_the_rule(
    seed: int, window: int, n_channels: int, wrap: tuple[bool, bool]
) -> None:
    template, sample = draw_case(seed, window, n_channels, wrap)
    expected = find_by_hand(template, sample)
    scales = set()
    if not expected:
        return
    for find in FINDERS:
        candidates = find(template, sample)
        assert candidates.positions.tolist() == sorted(expected)
        assert (
            dict(zip(candidates.positions.tolist(), candidates.distances.tolist(), strict=True)) == expected
        )
        scales.add(candidates.largest_distance)
    known_weight = int(gaussian_weights(window)[template.known].sum())
    assert scales == {known_weight * n_channels * 255**2}


@settings(max_examples=40, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**32 - 1), window=st.sampled_from([3, 5, 7]), wraps=st.booleans())
def test_engines_fall_back_alike_on_scattered_samples(seed: int, window: int, wraps: bool) -> None:
    template, sample = draw_case(seed, window, 2, (wraps, wraps), share_usable=0.2)
    first, second = (find(template, sample) for find in FINDERS)
    np.testing.assert_array_equal(first.positions, second.positions)
    np.testing.assert_array_equal(first.distances, second.distances)
    assert first.largest_distance == second.largest_distance
    assert first.positions.size > 0
    assert first.distances.max() <= first.largest_distance


def test_the_template_narrows_until_a_place_offers_all_of_it() -> None:
    # A 3 x 3 sample cannot hold the 5 x 5 surroundings, but its centre holds the inner 3 x 3.
    levels = np.arange(9).reshape(3, 3, 1) * 20
    sample = Sample(levels, np.ones((3, 3), dtype=np.bool_), (False, False), 2)
    known = np.ones((5, 5), dtype=np.bool_)
    known[2, 2] = False
    template = PixelTemplate(np.zeros((5, 5, 1), dtype=np.int64), known)
    assert not scan_exhaustively(template, sample).positions.size
    for find in FINDERS:
        candidates = find(template, sample)
        assert candidates.positions.tolist() == [4]
        assert candidates.largest_distance == (gaussian_weights(5)[1:4, 1:4].sum() - 16383) * 255**2


def test_a_missing_counterpart_finally_counts_as_the_largest_difference() -> None:
    # Two lone pixels: no neighbour of either can be compared, so both are as bad as can be.
    usable = np.zeros((3, 5), dtype=np.bool_)
    usable[1, 1] = usable[1, 3] = True
    sample = Sample(np.full((3, 5, 1), 100), usable, (False, False), 1)
    known = np.zeros((3, 3), dtype=np.bool_)
    known[0, 1] = known[1, 0] = True
    template = PixelTemplate(np.full((3, 3, 1), 100), known)
    for find in FINDERS:
        candidates = find(template, sample)
        assert candidates.positions.tolist() == [6, 8]
        assert candidates.distances.tolist() == [candidates.largest_distance] * 2


def test_missing_weights_are_those_outside() -> None:
    sample = Sample(np.zeros((2, 2, 1), dtype=np.int64), np.ones((2, 2), dtype=np.bool_), (False, True), 1)
    known = np.zeros((3, 3), dtype=np.bool_)
    known[0, 1] = known[1, 2] = True
    distances, missing = measure_distances(PixelTemplate(np.full((3, 3, 1), 2), known), sample)
    assert missing.tolist() == [1683, 1683, 0, 0]
    assert distances.tolist() == [1683 * 4, 1683 * 4, 1683 * 8, 1683 * 8]


def test_the_pick_is_uniform_among_all_candidates() -> None:
    # In a constant image every position competes equally; the choices of 600 seeds spread evenly over them.
    image = np.full((5, 6), 90, dtype=np.uint8)
    mask = np.zeros(image.shape, dtype=np.bool_)
    mask[2, 5] = True
    picked = np.zeros(image.shape)
    n_seeds = 600
    for seed in range(n_seeds):
        result = fill(image, mask, window=3, rng=seed)
        picked[result.source_rows[2, 5], result.source_cols[2, 5]] += 1
    # Template-adaptive: the five known neighbours reach one row up and down and one column to the left, of
    # which none may be the hole itself. Column 5 has the hole among its neighbours, but for rows 0, 4: edges.
    expected = np.zeros(image.shape, dtype=np.bool_)
    expected[1:4, 1:5] = True
    np.testing.assert_array_equal(picked > 0, expected)
    mean = n_seeds / expected.sum()
    assert np.abs(picked[expected] - mean).max() < 5 * np.sqrt(mean)


def test_a_difference_outside_the_sample_exceeds_any_distance_inside_and_never_overflows() -> None:
    n_terms = LARGEST_WINDOW**2 * 4
    largest = int(gaussian_weights(LARGEST_WINDOW).sum()) * 4 * 255**2
    assert 1.1 * largest < scan_kernels.NO_BOUND < (float(scan_kernels.MISSING) - 255) ** 2 * 0.99
    assert n_terms * (2**14 - 1) * float(scan_kernels.MISSING) ** 2 < np.finfo(np.float32).max
    assert 11 * largest < 2**63


def test_single_precision_errs_less_than_the_scan_allows() -> None:
    # Sums of positive terms: each of n + 2 roundings adds at most 2**-24 of the sum.
    rng = np.random.default_rng(0)
    for n_terms in (80, 5000):
        weights, differences = rng.integers(1, 2**14, n_terms), rng.integers(-255, 256, n_terms)
        exact = int((weights * differences**2).sum())
        single = np.float32(0)
        for weight, difference in zip(
            weights.astype(np.float32), differences.astype(np.float32), strict=True
        ):
            single += weight * difference * difference
        assert abs(float(single) - exact) <= (n_terms + 2) * 2.0**-24 * exact


def test_guesses_only_save_work() -> None:
    template, sample = draw_case(3, 5, 1, (False, True))
    for sources in (NO_SOURCES, np.zeros((3, 3), dtype=np.int64), None):
        candidates = find_compiled(template, sample, sources)
        assert candidates.positions.tolist() == sorted(find_by_hand(template, sample))


def test_compiled_picks_are_the_references() -> None:
    words = random_words(5, Purpose.PICK, 0, np.arange(200))
    for n_choices in (1, 2, 7, 2**20 + 1, 2**31 - 1):
        for word in [*words, np.uint64(0), np.uint64(2**64 - 1)]:
            assert kernels.pick_one(word, n_choices) == pick(word, n_choices)


def test_without_numba_the_reference_serves(monkeypatch: pytest.MonkeyPatch) -> None:
    image = np.random.default_rng(0).integers(0, 256, (9, 9), dtype=np.uint8)
    hole = np.zeros(image.shape, dtype=np.bool_)
    hole[4, 4:6] = True
    expected = fill(image, hole, window=3, rng=0).image
    for missing in ("absent", "disabled"):
        with monkeypatch.context() as patch:
            if missing == "absent":
                patch.setitem(sys.modules, "numba", None)
            else:
                patch.setattr("numba.config.DISABLE_JIT", 1)
            patch.setattr(kernels, "prepare_engine", lambda *_: pytest.fail("compiled"))
            can_compile.cache_clear()
            assert not can_compile()
            np.testing.assert_array_equal(fill(image, hole, window=3, rng=0).image, expected)
        can_compile.cache_clear()
    assert can_compile()
