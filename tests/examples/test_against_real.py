# SPDX-License-Identifier: MIT
"""Simulated against real: without data it says so; with them the fitted noise agrees as the page claims."""

import importlib.util
import sys

import pytest

from tests.helpers.data_paths import ROOT, data_path, requires_data


@pytest.fixture(scope="module")
def comparison():
    name = "plot_simulated_against_real"
    spec = importlib.util.spec_from_file_location(name, ROOT / f"examples/{name}.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look it up
    spec.loader.exec_module(module)
    yield module
    del sys.modules[spec.name]


def test_without_data_it_says_what_is_missing(comparison, tmp_path, capsys):
    comparison.main(["--data", str(tmp_path), "--docs", str(tmp_path)])
    assert "skipped: there is no" in capsys.readouterr().out
    assert not list(tmp_path.iterdir())


@pytest.mark.long
@requires_data
def test_a_constant_noise_fits_pipe_and_floor(comparison, tmp_path, capsys):
    comparison.main(["--data", str(data_path("")), "--docs", str(tmp_path)])
    rows = [line for line in capsys.readouterr().out.splitlines() if line.startswith("| ")]
    table = {row.split("|")[1].strip(): [float(x) for x in row.split("|")[2:-1]] for row in rows[1:]}
    real, alike = table["real"], table["constant 2.1 mm"]
    for k in range(4):  # across and along the ray, on pipe and floor
        assert alike[k] == pytest.approx(real[k], rel=0.15)
    assert table["phase_terrestrial"][2] < 0.2 * real[2]
    assert (tmp_path / "pictures/simulated_against_real.png").is_file()
