# SPDX-License-Identifier: MIT
"""Errors of shares: against the truth, whatever the shape of what is counted."""

import numpy as np
import pytest

from nbv.coverage.coverage import share_error
from nbv.visibility.samples import SurfaceSamples, sample_surface
from scenes.mesh.labelled_mesh import LabelledMesh


def sheets(n: int, fine: int) -> LabelledMesh:
    """n square sheets of a metre, each of 2 * fine**2 triangles."""
    ticks = np.linspace(0, 1, fine + 1)
    x, y = np.meshgrid(ticks, ticks, indexing="ij")
    grid = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    row = (np.arange(fine)[:, None] * (fine + 1) + np.arange(fine)).ravel()
    cell = np.stack([row, row + 1, row + fine + 2, row + fine + 1], axis=1)
    faces = np.concatenate([cell[:, [0, 1, 2]], cell[:, [0, 2, 3]]])
    vertices = np.concatenate([grid + [0, 0, k] for k in range(n)])
    return LabelledMesh(vertices, np.concatenate([faces + k * len(grid) for k in range(n)]))


def deviations(mesh: LabelledMesh, period: float, n_trials: int) -> np.ndarray:
    """Deviations of the share of stripes, 0.3 of the area, in error bars; each trial turns and moves them."""
    samples, rng, found = sample_surface(mesh, 0.05), np.random.default_rng(1), []
    sheet = np.rint(samples.points[:, 2]).astype(int)
    for _ in range(n_trials):
        angle, shift = rng.uniform(0, 2 * np.pi, sheet.max() + 1), rng.random(sheet.max() + 1)
        cos, sin = np.cos(angle)[sheet], np.sin(angle)[sheet]
        u = cos * samples.points[:, 0] - sin * samples.points[:, 1] + shift[sheet]
        where = u % period < 0.3 * period
        share = samples.areas[where].sum() / samples.total_m2
        found.append((share - 0.3) / share_error(samples, where))
    return np.array(found)


@pytest.mark.parametrize("fine", [1, 40])
@pytest.mark.parametrize("period", [0.01, 0.2])
def test_error_bars_hold_for_coarse_and_fine_patterns(fine, period):
    off = deviations(sheets(9, fine), period, 60)
    assert np.abs(off).max() < 4
    assert 0.4 < np.sqrt(np.mean(off**2)) < 1.3  # neither too short nor much too long


def test_shares_of_a_part_have_errors_of_the_part():
    samples = sample_surface(sheets(2, 1), 0.02)
    where, lower = samples.points[:, 0] % 0.1 < 0.05, samples.points[:, 2] < 0.5
    half = share_error(samples, where, lower)
    assert half == pytest.approx(share_error(samples.some(lower), where[lower]))
    assert 1.1 < half / share_error(samples, where) < 1.8  # of half the samples


def test_no_error_bar_is_shorter_than_one_sample():
    samples = sample_surface(sheets(1, 1), 0.1)
    everything = np.ones(len(samples), bool)
    assert share_error(samples, everything) == pytest.approx(1 / len(samples))
    assert share_error(samples, everything, ~everything) == 0


def test_samples_of_no_area_do_not_count():
    samples = sample_surface(sheets(2, 1), 0.05)
    where, lower = samples.points[:, 0] < 0.31, samples.points[:, 2] < 0.5
    apart = SurfaceSamples(
        samples.points,
        samples.normals,
        np.where(lower, samples.areas, 0),
        samples.face,
        samples.surface,
        pair=samples.pair,
    )
    assert share_error(apart, where) == pytest.approx(share_error(samples, where, lower))
