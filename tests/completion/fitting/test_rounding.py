# SPDX-License-Identifier: MIT
"""Intervals of planes whose points a file rounded to steps, by Monte Carlo."""

import numpy as np
import pytest

from completion.fitting.pipeline import fit
from completion.fitting.rounding import allow_for_rounding

STEP_M = 0.01
N_PLANES = 120


def held(rise: float, *, is_askew: bool) -> tuple[float, float]:
    """Shares of 95 % intervals of planes at five places that hold the truth, without and with steps."""
    rng = np.random.default_rng(1)
    u, v = (grid.ravel() for grid in np.meshgrid(np.linspace(-1, 1, 30), np.linspace(-1, 1, 30)))
    at = np.array([[0.0, 0], [1, 1], [-1, 1], [1, -1], [-1, -1]])
    without, allowed = [], []
    for _ in range(N_PLANES):
        height, slope = rng.uniform(0, STEP_M), rise * STEP_M / 2 * rng.uniform(-1, 1, 2)
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0] if is_askew else np.eye(3)
        points = np.column_stack([u, v, height + slope[0] * u + slope[1] * v]) @ turn.T
        truth = np.column_stack([at, height + at @ slope]) @ turn.T
        rounded = STEP_M * np.round((points + rng.normal(0, 1e-4, points.shape)) / STEP_M)
        plane = fit(rounded, "plane")
        error = np.abs(plane.surface.distance(truth))
        without.append(error < 1.96 * plane.standard_deviation(truth))
        allowed.append(error < 1.96 * allow_for_rounding(plane, rounded, STEP_M).standard_deviation(truth))
    return float(np.mean(without)), float(np.mean(allowed))


@pytest.mark.parametrize(("rise", "is_askew"), [(0.0, False), (1.0, False), (2.0, False), (0.0, True)])
def test_intervals_hold_the_truth(rise: float, is_askew: bool) -> None:
    without, allowed = held(rise, is_askew=is_askew)
    assert allowed >= 0.95
    if not is_askew:
        assert without < 0.95


def test_what_is_held_exactly_stays_so() -> None:
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-1, 1, (500, 2)), np.zeros(500)])
    turned = 2 * np.pi * rng.random(500)
    round_about = np.column_stack([0.3 * np.cos(turned), 0.3 * np.sin(turned), points[:, 0]])
    cylinder = allow_for_rounding(fit(round_about, "cylinder", radius=0.3), round_about, STEP_M)
    assert cylinder.parameter_deviations()["radius"] == 0.0
    assert cylinder.parameter_deviations()["point"] > STEP_M / np.sqrt(12)
    plane = fit(points, "plane")
    assert allow_for_rounding(plane, points, 0.0) is plane
