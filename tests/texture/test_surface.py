# SPDX-License-Identifier: MIT
"""Shading, plain reflectance, confidence and time budgets."""

import numpy as np
import pytest
from numpy.typing import NDArray
from skimage import data

from texture import fill, fill_surface, grow, measure_distance
from texture.reflectance import fit_shading, is_plain


def hole_in(shape: tuple[int, ...], side: int) -> NDArray[np.bool_]:
    hole = np.zeros(shape[:2], dtype=np.bool_)
    first = (shape[0] - side) // 2
    hole[first : first + side, first : first + side] = True
    return hole


def lamp(shape: tuple[int, int]) -> NDArray[np.float64]:
    rows, columns = np.indices(shape) / max(shape)
    return np.asarray(np.exp(0.4 - 0.9 * rows - 0.5 * columns + 0.3 * rows * columns))


@pytest.mark.parametrize("n_known", [6000, 400])
def test_log_quadratic_light_is_found_exactly_and_outliers_do_not_matter(n_known: int) -> None:
    light = lamp((80, 90))
    known = np.zeros(light.shape, dtype=np.bool_)
    known.ravel()[np.random.default_rng(0).choice(light.size, n_known, replace=False)] = True
    stained = 0.4 * light
    stained[::9, ::7] = 0.02
    found = fit_shading(stained, known).gain
    scale = np.exp(np.log(light)[known].mean() - np.log(found)[known].mean())
    assert np.abs(found * scale / light - 1)[known].max() < 0.01
    assert np.log(found[known]).mean() == pytest.approx(0, abs=1e-6)


def test_the_light_is_never_beyond_what_was_seen() -> None:
    known = np.zeros((60, 60), dtype=np.bool_)
    known[:, :20] = True
    light = np.exp(np.linspace(0, 3, 60) * np.ones((60, 1)))
    found = fit_shading(light / light.max(), known).gain
    assert found.max() == pytest.approx(found[known].max())


def test_light_does_not_change_beyond_the_hull_of_what_was_seen() -> None:
    known = np.zeros((60, 60), dtype=np.bool_)
    known[20:50, 10:40] = True
    known[30:40, 20:30] = False  # a hole within: there the fit goes on
    rows, columns = (index / 60 for index in np.indices(known.shape))
    light = np.exp(rows - 3 * (columns - 0.4) ** 2)
    found = fit_shading(light / light.max(), known).gain
    scale = np.exp(np.log(light)[known].mean())
    np.testing.assert_allclose(found[20:50, 10:40] * scale, light[20:50, 10:40], rtol=1e-4)
    np.testing.assert_allclose(found[25, 40:], found[25, 39], rtol=1e-6)
    np.testing.assert_allclose(found[:20, 25], found[20, 25], rtol=1e-6)


def test_light_around_a_cylinder_closes() -> None:
    angle = 2 * np.pi * np.arange(72) / 72
    light = np.exp(0.5 * np.cos(angle - 1)) * np.ones((20, 1))
    known = np.ones(light.shape, dtype=np.bool_)
    known[:, :9] = False
    found = fit_shading(0.4 * light, known, (False, True)).gain
    assert np.ptp(np.log(found / light)) < 1e-6
    turned = fit_shading(0.4 * np.roll(light, 30, axis=1), np.roll(known, 30, axis=1), (False, True)).gain
    np.testing.assert_allclose(turned, np.roll(found, 30, axis=1), rtol=1e-9)


def test_too_few_pixels_have_no_shading() -> None:
    known = np.zeros((9, 9), dtype=np.bool_)
    assert (fit_shading(np.ones((9, 9)), known).gain == 1).all()
    known[0, :5] = True
    gain = fit_shading(np.ones((9, 9)), known).gain
    assert (gain == 1).all()
    assert not gain.flags.writeable


def test_shaded_texture_keeps_its_light_in_the_hole() -> None:
    full = data.grass()[128:256, 128:256]
    shaded = np.rint(np.clip(full * lamp(full.shape) ** 2, 0, 255)).astype(np.uint8)
    hole = hole_in(shaded.shape, 48)
    apart = fill_surface(shaded, hole, window=11, rng=0)
    together = fill(shaded, hole, window=11, order="window", rng=0)

    truth = shaded[40:88, 40:88]
    off = [measure_distance(filled.image[40:88, 40:88], truth) for filled in (apart, together)]
    assert off[0] < 0.8 * off[1]
    np.testing.assert_array_equal(apart.image[~hole], shaded[~hole])
    assert apart.image.dtype == np.uint8
    assert not apart.is_plain
    assert not apart.image.flags.writeable


@pytest.mark.parametrize("n_channels", [0, 2, 3, 4])
def test_surfaces_keep_shape_and_alpha_has_no_light(n_channels: int) -> None:
    image = np.random.default_rng(0).random((24, 24) + ((n_channels,) if n_channels else ()))
    image *= 0.8 * lamp((24, 24)).reshape(24, 24, *([1] if n_channels else []))
    image = np.clip(image, 0, 1)
    if n_channels in (2, 4):
        image[..., -1] = 0.5
    hole = hole_in(image.shape, 6)
    found = fill_surface(image, hole, window=5, rng=0)
    assert found.image.shape == image.shape
    if n_channels in (2, 4):
        np.testing.assert_allclose(found.image[..., -1], 0.5, atol=1e-6)


def test_plain_reflectance_is_recognised_and_filled_by_mean_and_noise() -> None:
    rng = np.random.default_rng(0)
    image = np.clip(rng.normal(140, 6, (80, 80)), 0, 255).astype(np.uint8)
    image[3, 5] = 0  # a speck
    hole = hole_in(image.shape, 40)
    found = fill_surface(image, hole, rng=0)
    assert found.is_plain
    n = hole.sum()
    known = image[~hole].astype(float)
    assert abs(found.image[hole].mean() - known.mean()) < 4 * 6 / np.sqrt(n) + 0.5
    assert abs(found.image[hole].std() - 6) < 4 * 6 / np.sqrt(2 * n) + 0.3
    assert found.image[hole].min() > 100
    assert (found.synthesis.confidence == 1).all()


@pytest.mark.parametrize("name", ["brick", "grass", "gravel"])
def test_textures_are_not_plain(name: str) -> None:
    levels = getattr(data, name)()[128:256, 128:256, None].astype(np.int64)
    everywhere = np.ones(levels.shape[:2], dtype=np.bool_)
    assert not is_plain(levels, everywhere)
    assert is_plain(np.full_like(levels, 7), everywhere)
    rows = np.random.default_rng(0).permutation(levels.size)
    assert is_plain(levels.ravel()[rows].reshape(levels.shape), everywhere)


def test_lone_joints_on_a_plain_wall_are_structure() -> None:
    wall = np.random.default_rng(0).normal(150, 3, (90, 90, 1)).astype(np.int64)
    wall[::30] = 90
    assert not is_plain(wall, np.ones((90, 90), dtype=np.bool_))


def test_confidence_is_one_for_copies_and_falls_with_the_error() -> None:
    image = data.gravel()[128:188, 128:188]
    hole = hole_in(image.shape, 20)
    found = fill(image, hole, window=7, rng=0)
    assert (found.confidence[~hole] == 1).all()
    unrelated = 2 * float((image[~hole] / 255).var())
    np.testing.assert_allclose(found.confidence, np.clip(1 - found.error / unrelated, 0, 1), atol=1e-6)
    stripes = np.tile(np.array([20, 20, 220, 220], np.uint8), (24, 6))
    assert (fill(stripes, hole_in(stripes.shape, 8), window=7, rng=0).confidence == 1).all()
    assert grow(image, (9, 9), window=5, rng=0).confidence[4, 4] == 0


def test_a_spent_budget_returns_what_is_filled_and_says_so() -> None:
    image = data.grass()[128:188, 128:188]
    hole = hole_in(image.shape, 30)
    cut = fill(image, hole, window=7, rng=0, time_budget_s=1e-9)
    whole = fill(image, hole, window=7, rng=0, time_budget_s=1e9)
    assert not cut.is_complete
    assert whole.is_complete
    filled = cut.source_rows >= 0
    assert (hole & filled).any()
    assert (hole & ~filled).any()
    assert (cut.confidence[~filled] == 0).all()
    np.testing.assert_array_equal(cut.image[filled], whole.image[filled])
    assert not grow(image, (40, 40), window=5, rng=0, time_budget_s=1e-9).is_complete
    for wrong in (0, -1, float("nan")):
        with pytest.raises(ValueError, match="time_budget_s: expected more than 0 seconds"):
            fill(image, hole, window=7, time_budget_s=wrong)
