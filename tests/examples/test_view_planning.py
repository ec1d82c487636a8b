# SPDX-License-Identifier: MIT
"""The study of docs/results/planning.md: its plans meet all samples, its page shows every picture."""

import importlib.util

import numpy as np
import pytest
from PIL import Image

from nbv.visibility.requirement import Requirement
from nbv.visibility.samples import sample_surface
from nbv.visibility.visibility import visible_from_positions
from tests.helpers.data_paths import ROOT


@pytest.fixture(scope="module")
def study():
    spec = importlib.util.spec_from_file_location(
        "plot_view_planning", ROOT / "examples/plot_view_planning.py"
    )
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_grown_plans_lie_between_bound_and_number_of_samples(study):
    scene = study.room_with(3)
    assert sum(name.startswith("box") for name in scene.surface_names) == 18
    candidates = study.candidates_of(scene, study.CONE, 1.2)
    views, bound = study.grown_plan(scene, candidates, study.CONE, 0.3, 70, 300)
    assert 5 < bound <= views < 40


def test_what_chosen_poses_meet_is_what_the_instance_says(study):
    scene = study.room_with(1)
    candidates = study.candidates_of(scene, study.CONE, 1.5)
    samples = sample_surface(scene.mesh, 0.3)
    limits = Requirement(max_incidence_deg=70).limits(study.CONE)
    seen = visible_from_positions(scene.ray_caster(1), candidates.positions, samples, limits)
    everything = np.arange(len(samples))
    instance = study.instance_of(seen.tocsc(), everything, candidates, samples.points, study.CONE)
    chosen = [5, 170, 333]
    met = study.met_by(chosen, seen, candidates, samples.points, study.CONE)
    assert met.tolist() == np.flatnonzero(instance.times_seen(chosen)).tolist()


def test_pictures_are_drawn_and_the_page_shows_them(study, tmp_path, capsys):
    study.drawn(tmp_path, "patches", "Title", "cm", [(20.0, 23, 20), (10.0, 28, 22)], xscale="log")
    assert "| 10 | 28 | 22 |" in capsys.readouterr().out
    with Image.open(tmp_path / "view_planning_patches.png") as picture:
        assert picture.size[0] > 700


def test_the_largest_number_has_room_above_it(study, tmp_path, monkeypatch):
    figures = []
    monkeypatch.setattr(study.plt, "close", figures.append)
    study.drawn(tmp_path, "spacing", "Title", "m", [(0.5, 23, 20), (1.0, 24, 22)])
    monkeypatch.undo()
    (axes,) = figures[0].axes
    assert axes.get_ylim() == pytest.approx((0, 1.1 * 24))
    study.plt.close(figures[0])


def test_the_page_shows_every_picture():
    page = (ROOT / "docs/results/planning.md").read_text("utf-8")
    for name in ("patches", "spacing", "occluders"):
        assert f"](../pictures/view_planning_{name}.png)" in page
        assert (ROOT / f"docs/pictures/view_planning_{name}.png").is_file()
