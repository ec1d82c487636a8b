# SPDX-License-Identifier: MIT
"""Coordinates that files round to steps: an error that all points of a plane share."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from completion import complete
from scenes.inclination import Up
from scenes.io.clouds.text import decimal_step
from scenes.io.point_files import read_points
from scenes.io.scan_request import GivenScans, ScanRequest, read_request
from tests.helpers.completion_examples import PLAIN
from tests.helpers.data_paths import data_path, requires_data

ROUNDED = "reported/las_quantised_1cm/q1_las_1cm.las"
SIDES = {"room width": (5.0043, 4.0036), "room height": (2.7046,)}
ORIGIN = (2.9, 1.3, 1.5)
STEP_M = 0.01


def intervals(given: GivenScans) -> dict[str, list[tuple[float, float]]]:
    completion = complete(given.scans, replace(PLAIN, up=Up.along("z")))
    found: dict[str, list[tuple[float, float]]] = {}
    for dimension in completion.decisions().dimensions:
        found.setdefault(dimension.kind, []).append((dimension.low, dimension.high))
    return found


@cache
def rounded_cloud() -> np.ndarray:
    return read_points(data_path(ROUNDED)).points


@requires_data
@pytest.mark.parametrize("form", ["las", "xyz"])
def test_no_interval_is_narrower_than_the_step(tmp_path: Path, form: str) -> None:
    path = data_path(ROUNDED)
    if form == "xyz":
        path = tmp_path / "a.xyz"
        np.savetxt(path, rounded_cloud(), fmt="%.2f")
    given = read_request(ScanRequest((str(path),), origins=(ORIGIN,)))
    (doubt,) = [text for text in given.doubts if "steps" in text]
    assert "coordinates are rounded to steps of 10 mm" in doubt
    assert given.scans[0].step_m == pytest.approx(STEP_M)
    found = intervals(given)
    for kind, truth in SIDES.items():
        assert len(found[kind]) == len(truth)
        for (low, high), side in zip(found[kind], truth, strict=True):
            assert low < side < high
            assert STEP_M <= high - low <= 4 * STEP_M


@pytest.mark.parametrize(("n_decimals", "step"), [(0, 1.0), (1, 0.1), (2, 0.01), (3, 0.001), (9, 0.0)])
def test_the_step_of_text_is_that_of_its_decimals(tmp_path: Path, n_decimals: int, step: float) -> None:
    points = np.random.default_rng(0).uniform(4e5, 4e5 + 10, (500, 3))
    np.savetxt(tmp_path / "a.xyz", points, fmt=f"%.{n_decimals}f")
    assert decimal_step(points.round(n_decimals)) == pytest.approx(step)
    cloud = read_points(tmp_path / "a.xyz", "ft")
    assert cloud.step_m == pytest.approx(0.3048 * step)
    assert [text for text in cloud.warnings if "steps" in text] == list(cloud.warnings)
    assert len(cloud.warnings) == (step > 0.004)
