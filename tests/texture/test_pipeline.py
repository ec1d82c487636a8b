# SPDX-License-Identifier: MIT
"""Laws of `fill` and `grow`: engines agree, provenance is true, structure continues, seeds decide."""

from itertools import product
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from skimage import data

import texture
from texture import Synthesis, fill, grow
from texture.sampling.canvas import OrderName

TEXTURES = ("brick", "grass", "gravel")
ORDERS: tuple[OrderName, ...] = ("paper", "window")


def crop(name: str, size: int = 36, n_channels: int = 0) -> NDArray[np.uint8]:
    """A piece of one of scikit-image's textures; its channels are three different pieces."""
    full: NDArray[np.uint8] = getattr(data, name)()
    if not n_channels:
        return full[140 : 140 + size, 130 : 130 + size]
    pieces = [full[140 : 140 + size, 130 + k : 130 + k + size] for k in range(n_channels)]
    return np.stack(pieces, axis=2)


def square_hole(shape: tuple[int, ...], side: int = 9) -> NDArray[np.bool_]:
    mask = np.zeros(shape[:2], dtype=np.bool_)
    top, left = (shape[0] - side) // 2, (shape[1] - side) // 2
    mask[top : top + side, left : left + side] = True
    return mask


def assert_same(first: Synthesis, second: Synthesis) -> None:
    for name in ("image", "source_rows", "source_cols", "error", "confidence"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name), err_msg=name)
    assert (first.n_relaxed, first.n_seeds) == (second.n_relaxed, second.n_seeds)
    assert first.window == second.window


def assert_copied(
    result: Synthesis, sample_image: NDArray[Any], usable: NDArray[np.bool_], where: Any
) -> None:
    """Each pixel at `where` is a copy of its source, which is a sample pixel."""
    rows, columns = result.source_rows[where], result.source_cols[where]
    assert usable[rows, columns].all()
    np.testing.assert_array_equal(result.image[where], sample_image[rows, columns])


def test_the_face_is_these_names() -> None:
    assert texture.__all__ == sorted(texture.__all__)
    assert {"Synthesis", "examine", "fill", "fill_surface", "grow", "measure_distance"} <= set(
        texture.__all__
    )
    assert all(hasattr(texture, name) for name in texture.__all__)


@pytest.mark.parametrize(
    ("name", "n_channels", "order", "wrap", "seed"),
    [
        (name, n_channels, order, wrap, seed)
        for (name, n_channels, order), (wrap, seed) in zip(
            product(TEXTURES, (0, 3), ORDERS),
            [((False, False), 0), ((True, False), 1), ((False, True), 0), ((True, True), 1)] * 3,
            strict=True,
        )
    ],
)
def test_engines_give_identical_holes(
    name: str, n_channels: int, order: OrderName, wrap: tuple[bool, bool], seed: int
) -> None:
    image = crop(name, n_channels=n_channels)
    mask = np.roll(square_hole(image.shape), (12 * wrap[0], 14 * wrap[1]), axis=(0, 1))
    compiled, reference = (
        fill(image, mask, window=7, order=order, wrap=wrap, rng=seed, engine=engine)
        for engine in ("numba", "reference")
    )
    assert_same(compiled, reference)
    assert_copied(compiled, image, ~mask, mask)


@pytest.mark.parametrize(
    ("name", "n_channels", "window", "order", "wrap", "n_threads"),
    [
        ("brick", 0, 11, "paper", (False, False), 2),
        pytest.param("grass", 3, 11, "window", (False, True), 2, marks=pytest.mark.long),
        pytest.param("gravel", 0, 15, "window", (True, False), 3, marks=pytest.mark.long),
        ("brick", 3, 15, "paper", (True, True), 1),
        pytest.param("grass", 0, 23, "paper", (False, True), 2, marks=pytest.mark.long),
        pytest.param("gravel", 2, 23, "window", (False, False), 2, marks=pytest.mark.long),
    ],
)
def test_engines_agree_at_large_windows_on_any_number_of_threads(
    name: str, n_channels: int, window: int, order: OrderName, wrap: tuple[bool, bool], n_threads: int
) -> None:
    image = crop(name, 48, n_channels)
    side = 10 if window < 23 else 5
    mask = np.roll(square_hole(image.shape, side), (19 * wrap[0], 19 * wrap[1]), axis=(0, 1))
    compiled = fill(image, mask, window=window, order=order, wrap=wrap, rng=7, n_threads=n_threads)
    assert_same(compiled, fill(image, mask, window=window, order=order, wrap=wrap, rng=7, engine="reference"))


@pytest.mark.parametrize("n_threads", [1, 2])
@pytest.mark.parametrize("period", [(2, 2), (3, 5), (8, 8)])
def test_engines_break_exact_ties_alike(period: tuple[int, int], n_threads: int) -> None:
    tile = np.random.default_rng(1).integers(0, 256, period, dtype=np.uint8)
    image = np.tile(tile, (40 // period[0], 40 // period[1]))
    mask = square_hole(image.shape, 12)
    compiled = fill(image, mask, window=11, rng=2, n_threads=n_threads)
    assert_same(compiled, fill(image, mask, window=11, rng=2, engine="reference"))
    assert np.unique(compiled.source_rows[mask]).size > 12  # among many equal ones


def test_any_number_of_threads_gives_the_same_bytes() -> None:
    image = crop("brick", 96)
    mask = square_hole(image.shape, 40)
    for order in ORDERS:
        first, *others = (
            fill(image, mask, window=9, order=order, rng=3, n_threads=n_threads) for n_threads in (1, 2, 5)
        )
        for other in others:
            assert_same(first, other)


@pytest.mark.parametrize(("name", "seed"), [("brick", 0), ("grass", 1), ("gravel", 2)])
@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("wrap", [(False, False), (True, True)])
def test_engines_grow_identical_textures(
    name: str, seed: int, order: OrderName, wrap: tuple[bool, bool]
) -> None:
    sample = crop(name, 18)
    compiled, reference = (
        grow(sample, (13, 16), window=5, order=order, wrap=wrap, rng=seed, engine=engine)
        for engine in ("numba", "reference")
    )
    assert_same(compiled, reference)
    assert compiled.image.shape == (13, 16)
    assert compiled.n_seeds == 1
    assert_copied(compiled, sample, np.ones(sample.shape, dtype=np.bool_), np.s_[:, :])


@pytest.mark.parametrize("wrap", [(False, False), pytest.param((True, True), marks=pytest.mark.long)])
def test_engines_agree_on_scattered_samples_and_ragged_holes(wrap: tuple[bool, bool]) -> None:
    rng = np.random.default_rng(5)
    image = crop("gravel", 15, 2)
    mask = rng.random(image.shape[:2]) < 0.3
    known = ~mask & (rng.random(mask.shape) < 0.8)
    sample_mask = known & (rng.random(mask.shape) < 0.4)
    options: dict[str, Any] = {
        "window": 7,
        "wrap": wrap,
        "sample_mask": sample_mask,
        "known": known,
        "rng": 3,
    }
    compiled = fill(image, mask, **options)
    assert_same(compiled, fill(image, mask, **options, engine="reference"))
    assert_copied(compiled, image, sample_mask, mask)


def test_known_pixels_are_kept_and_point_at_themselves() -> None:
    image = crop("grass")
    mask = square_hole(image.shape)
    result = fill(image, mask, window=5, rng=0)
    rows, columns = np.nonzero(~mask)
    np.testing.assert_array_equal(result.image[~mask], image[~mask])
    np.testing.assert_array_equal(result.source_rows[~mask], rows)
    np.testing.assert_array_equal(result.source_cols[~mask], columns)
    assert (result.error[~mask] == 0).all()
    assert (result.error[mask] <= 1).all()


def test_what_lies_under_the_mask_does_not_matter() -> None:
    image = crop("grass")
    mask = square_hole(image.shape)
    blanked = np.where(mask, 255, image).astype(np.uint8)
    assert_same(fill(image, mask, window=5, rng=0), fill(blanked, mask, window=5, rng=0))


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("pattern", ["stripes", "checks"])
def test_a_periodic_image_is_restored_exactly(order: OrderName, pattern: str) -> None:
    rows, columns = np.indices((40, 40))
    image = np.where(((columns if pattern == "stripes" else rows + columns) // 2) % 2, 200, 30).astype(
        np.uint8
    )
    mask = square_hole(image.shape, 15)
    result = fill(np.where(mask, 0, image).astype(np.uint8), mask, window=9, order=order, rng=0)
    np.testing.assert_array_equal(result.image, image)
    assert (result.error == 0).all()


@pytest.mark.parametrize("engine", ["numba", "reference"])
def test_a_constant_image_stays_constant(engine: Any) -> None:
    image = np.full((14, 14, 3), (10, 120, 250), dtype=np.uint8)
    result = fill(
        image * ~square_hole(image.shape, 5)[..., None], square_hole(image.shape, 5), rng=0, engine=engine
    )
    np.testing.assert_array_equal(result.image, image)
    assert result.window == 7


def test_on_a_cylinder_the_pattern_closes_across_the_seam() -> None:
    columns = np.broadcast_to(np.arange(48), (20, 48))
    image = np.abs(columns % 12 - 6).astype(np.uint8) * np.uint8(40)
    mask = np.zeros(image.shape, dtype=np.bool_)
    mask[:, :5] = mask[:, -5:] = True
    assert (fill(image, mask, window=7, wrap=(False, True), rng=0).image == image).all()


def test_wrapping_is_equivariant_under_rotation_of_the_cylinder() -> None:
    # One hole pixel: nothing but the template and its candidates decide, and one best candidate exists.
    image = np.random.default_rng(0).integers(0, 256, (12, 15), dtype=np.uint8)
    image[3:8, 0:5] = image[3:8, 7:12]  # a twin, so that pixel (5, 9) and (5, 2) have equal surroundings
    for shift in range(15):
        turned = np.roll(image, shift, axis=1)
        mask = np.zeros(image.shape, dtype=np.bool_)
        mask[5, (2 + shift) % 15] = True
        result = fill(turned, mask, window=5, wrap=(False, True), rng=shift)
        assert result.source_cols[mask] == (9 + shift) % 15
        assert result.error[mask] == 0


def test_a_grown_texture_tiles_when_wrapped() -> None:
    rows, columns = np.indices((24, 24))
    sample = np.where((rows // 2 + columns // 2) % 2, 220, 20).astype(np.uint8)
    grown = grow(sample, (16, 20), window=7, wrap=(True, True), rng=0).image
    np.testing.assert_array_equal(grown, np.roll(grown, 4, axis=1))
    np.testing.assert_array_equal(grown, np.roll(grown, 4, axis=0))


def test_same_seed_same_bytes_and_another_differs() -> None:
    image = crop("gravel")
    mask = square_hole(image.shape, 12)
    first, again, other = (fill(image, mask, window=5, rng=seed) for seed in (4, np.random.default_rng(4), 5))
    assert_same(first, again)
    assert (first.image != other.image).any()
    assert (grow(image, (9, 9), window=5, rng=1).image != grow(image, (9, 9), window=5, rng=2).image).any()


def test_unseeded_runs_differ() -> None:
    sample = crop("grass", 20)
    runs = [grow(sample, (8, 8), window=3) for _ in range(6)]  # any two may begin at the same place
    assert len({run.source_rows.tobytes() + run.source_cols.tobytes() for run in runs}) > 1


def test_the_orders_differ() -> None:
    image = crop("brick")
    mask = square_hole(image.shape, 12)
    paper, window = (fill(image, mask, window=5, order=order, rng=0) for order in ORDERS)
    assert (paper.source_cols != window.source_cols).any()


def test_floats_are_matched_in_8_bits_and_copied_as_they_are() -> None:
    levels = crop("grass")
    mask = square_hole(levels.shape)
    jitter = np.random.default_rng(0).uniform(-0.4, 0.4, levels.shape)
    image = np.clip((levels + jitter) / 255, 0, 1).astype(np.float32)
    from_float, from_bytes = fill(image, mask, window=5, rng=0), fill(levels, mask, window=5, rng=0)
    assert from_float.image.dtype == np.float32
    np.testing.assert_array_equal(from_float.source_rows, from_bytes.source_rows)
    np.testing.assert_array_equal(from_float.source_cols, from_bytes.source_cols)
    assert_copied(from_float, image, ~mask, mask)


@pytest.mark.parametrize("n_channels", [1, 2, 4])
def test_any_number_of_channels_keeps_shape_and_dtype(n_channels: int) -> None:
    image = crop("grass", 20, n_channels) / 255
    result = fill(image, square_hole(image.shape, 4), window=3, rng=0)
    assert result.image.shape == image.shape
    assert result.image.dtype == np.float64
    assert grow(image, (4, 5), window=3, rng=0).image.shape == (4, 5, n_channels)


def test_grey_and_its_three_copies_give_the_same_sources() -> None:
    grey = crop("gravel")
    mask = square_hole(grey.shape)
    one = fill(grey, mask, window=5, rng=0)
    three = fill(np.repeat(grey[..., None], 3, axis=2), mask, window=5, rng=0)
    np.testing.assert_array_equal(one.source_rows, three.source_rows)
    np.testing.assert_array_equal(one.error, three.error)


def test_unknown_pixels_outside_the_mask_are_neither_read_nor_written() -> None:
    image = crop("grass") / 255
    mask = square_hole(image.shape)
    known = ~mask
    known[:6] = known[:, :4] = False
    known[18, 18] = True  # the mask wins
    unread = np.where(known & ~mask, image, np.nan)
    result, clean = (
        fill(unread, mask, known=known, window=5, rng=0),
        fill(image, mask, known=known, window=5, rng=0),
    )
    outside = ~known & ~mask
    assert np.isnan(result.image[outside]).all()
    assert (result.source_rows[outside] == -1).all()
    assert (result.source_cols[outside] == -1).all()
    assert np.isfinite(result.image[mask]).all()
    np.testing.assert_array_equal(result.source_rows, clean.source_rows)
    assert_copied(result, image, known & ~mask, mask)


def test_surroundings_outside_the_sample_still_guide_the_filling() -> None:
    image = np.tile(np.repeat(np.array([40, 210], dtype=np.uint8), 2), (24, 10))
    mask = square_hole(image.shape, 6)
    sample_mask = np.zeros(image.shape, dtype=np.bool_)
    sample_mask[:, :14] = True
    assert not (sample_mask & mask).any()
    result = fill(image * ~mask, mask, sample_mask=sample_mask, window=7, rng=0)
    np.testing.assert_array_equal(result.image, image)
    assert result.source_cols[mask].max() < 14


def test_sample_masks_limit_growth() -> None:
    sample = crop("gravel", 30)
    sample_mask = np.zeros(sample.shape)
    sample_mask[5:20, 8:25] = 7
    grown = grow(sample, (10, 10), window=5, sample_mask=sample_mask, rng=0)
    assert_copied(grown, sample, sample_mask > 0, np.s_[:, :])


def test_a_hole_that_touches_nothing_known_is_seeded() -> None:
    image = crop("gravel", 30)
    mask = np.zeros(image.shape, dtype=np.bool_)
    mask[2:8, 2:8] = mask[14:26, 14:26] = True
    known = ~mask
    known[:10, :10] = False
    result = fill(image, mask, known=known, window=5, rng=0)
    assert result.n_seeds == 1
    assert_copied(result, image, known, mask)
    assert 1 <= (result.error[2:8, 2:8] == 1).sum() <= 9
    assert (result.error[14:26, 14:26] < 1).all()
    assert_same(result, fill(image, mask, known=known, window=5, rng=0, engine="reference"))


def test_contradicting_surroundings_relax_the_threshold() -> None:
    # The sample is black, what surrounds the hole white: the error is 1, and 0.3 * 1.1**12 = 0.94 < 1.
    image = np.zeros((9, 9), dtype=np.uint8)
    image[:, 5:] = 255
    mask = np.zeros(image.shape, dtype=np.bool_)
    mask[4, 7] = True
    for engine in ("numba", "reference"):
        result = fill(image, mask, sample_mask=image == 0, window=3, rng=0, engine=engine)
        assert result.n_relaxed == 13
        assert result.image[4, 7] == 0
        assert result.error[4, 7] == 1


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (2, 2), (3, 1)])
@pytest.mark.parametrize("wrap", [(False, False), (True, True)])
def test_the_smallest_textures_grow(shape: tuple[int, int], wrap: tuple[bool, bool]) -> None:
    sample = crop("grass", 8)
    assert_copied(grow(sample, shape, window=5, wrap=wrap, rng=0), sample, sample >= 0, np.s_[:, :])


def test_one_sample_pixel_fills_everything() -> None:
    for engine in ("numba", "reference"):
        grown = grow(np.array([[77]], dtype=np.uint8), (4, 4), window=3, rng=0, engine=engine)
        assert (grown.image == 77).all()


def test_an_empty_mask_changes_nothing() -> None:
    image = crop("brick", 12)
    result = fill(image, np.zeros(image.shape), sample_mask=np.zeros(image.shape), rng=0)
    np.testing.assert_array_equal(result.image, image)
    assert (result.error == 0).all()
    np.testing.assert_array_equal(result.source_rows, np.indices(image.shape)[0])
    untouched = fill(image, np.zeros(image.shape), known=np.zeros(image.shape))
    np.testing.assert_array_equal(untouched.image, image)
    assert (untouched.source_rows == -1).all()


def test_inputs_are_not_changed_and_results_cannot_be() -> None:
    image = crop("brick", 20).copy()
    mask = square_hole(image.shape, 4)
    before = image.copy()
    result = fill(image, mask, window=3, rng=0)
    np.testing.assert_array_equal(image, before)
    for array in (result.image, result.source_rows, result.source_cols, result.error):
        assert not array.flags.writeable
    assert result.source_rows.dtype == result.source_cols.dtype == np.int32
    assert result.error.dtype == np.float32
    with pytest.raises(AttributeError):
        result.window = 5  # type: ignore[misc]


def test_progress_rises_to_the_end_and_can_cancel() -> None:
    image = crop("grass", 20)
    mask = square_hole(image.shape, 7)
    calls: list[tuple[int, int]] = []
    fill(image, mask, window=3, rng=0, progress=lambda *counts: calls.append(counts))
    filled = [n_filled for n_filled, _ in calls]
    assert filled == sorted(filled)
    assert calls[-1] == (49, 49)

    def cancel(n_filled: int, n_total: int) -> None:
        raise InterruptedError(f"{n_filled} of {n_total}")

    with pytest.raises(InterruptedError, match="of 49"):
        fill(image, mask, window=3, rng=0, progress=cancel)


def test_the_chosen_window_is_said() -> None:
    image = np.tile(np.repeat(np.array([0, 255], dtype=np.uint8), 6), (30, 4))
    assert fill(image, square_hole(image.shape, 3), rng=0).window == 19
    assert fill(image, square_hole(image.shape, 3), window=5, rng=0).window == 5
    assert grow(image, (4, 4), rng=0).window == 19
