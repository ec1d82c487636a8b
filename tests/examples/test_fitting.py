# SPDX-License-Identifier: MIT
"""The study of metrics: it runs with few trials, writes table and picture, and its own fits are right."""

import importlib.util
import sys

import numpy as np
import pytest
from PIL import Image

from scenes.surfaces.catalogue import Cylinder
from tests.helpers.data_paths import ROOT


@pytest.fixture(scope="module")
def study():
    spec = importlib.util.spec_from_file_location(
        "plot_fitting_metrics", ROOT / "examples/plot_fitting_metrics.py"
    )
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # worker processes and dataclasses look it up
    spec.loader.exec_module(module)
    yield module
    del sys.modules[spec.name]


class InProcess:
    """A pool that works in this process; `map` is all the study needs."""

    def __init__(self, *_arguments, **_named):
        pass

    def __enter__(self):
        return self

    def __exit__(self, *_error):
        return None

    def map(self, function, arguments, **_chunks):
        return [function(one) for one in arguments]


@pytest.mark.long
def test_the_study_runs_with_few_trials(study, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(study, "ProcessPoolExecutor", InProcess)
    monkeypatch.setattr(study, "N_POINTS", 2000)
    monkeypatch.setattr(study.os, "environ", {})
    study.main(["--trials", "3", "--docs", str(tmp_path)])
    text = (tmp_path / "results/fitting-metrics.md").read_text()
    assert text.startswith("<!-- Written by `python examples/plot_fitting_metrics.py --trials 3`")
    rows = [line for line in text.splitlines() if line.startswith("| ") and " / 0." in line]
    assert len(rows) == 14
    assert [line.count("|") for line in rows] == [9] * 7 + [13] * 7
    assert "not elliptic" in text
    with Image.open(tmp_path / "pictures/fitting_metrics.png") as picture:
        assert picture.size[0] > 900
    assert "3 clouds, 90 deg, sigma 0.1 mm, 30 % outliers: median |dR| 0.0" in text
    assert len(capsys.readouterr().out.splitlines()) == 15


def test_samples_lie_on_the_cylinder_with_the_noise_that_is_said(study):
    radial = study.sample(90, 0.5, "radial", np.random.default_rng(1))
    ray = study.sample(90, 0.5, "ray", np.random.default_rng(1))
    truth = Cylinder(study.SHIFT, study.POSE[:, 2], study.RADIUS)
    n = len(radial)
    assert truth.distance(radial).std() == pytest.approx(0.5, rel=4 / np.sqrt(2 * n))
    mean_square = 0.5 + np.sin(np.pi / 2) / np.pi  # of the cosine of incidence over a quarter turn
    assert truth.distance(ray).std() == pytest.approx(0.5 * np.sqrt(mean_square), rel=4 / np.sqrt(2 * n))


def test_the_circular_algebraic_fit_is_exact_without_noise_and_biased_with_it(study):
    start = Cylinder(study.SHIFT + study.POSE[:, 0], study.POSE[:, 2], study.RADIUS + 1)
    exact = study.sample(60, 0.0, "radial", np.random.default_rng(2))
    assert study.circular_algebraic(exact, start) == pytest.approx(study.RADIUS, rel=1e-9)
    noisy = study.sample(30, 0.5, "radial", np.random.default_rng(2))
    assert study.circular_algebraic(noisy, start) == pytest.approx(36.4, abs=1.5)
