# SPDX-License-Identifier: MIT
"""The suites behind docs/results/planning.md, made small: their tables are whole, and order the planners."""

import numpy as np
import pytest

from benchmarks.suites import bunny, object_views, online
from nbv.scanning.sensor import PinholeSensor
from tests.helpers.data_paths import requires_data


def rows(text: str) -> dict[str, list[str]]:
    """Cells of each row of the tables, by the first."""
    lines = [line for line in text.splitlines() if line.startswith("| ")]
    return {
        cells[0]: cells[1:] for line in lines if (cells := [c.strip() for c in line.strip("|").split("|")])
    }


@pytest.mark.long
@requires_data
def test_the_bunny_is_seen_better_by_who_knows_more(monkeypatch):
    monkeypatch.setattr(bunny, "N_VIEWS", 4)
    monkeypatch.setattr(bunny, "SENSOR", PinholeSensor(fov_deg=70, width=640, height=360))
    table = rows("\n".join(bunny.bunny(30, 3000, starts=2, blind=5, literature=True)))
    last = {name: float(cells[-1]) for name, cells in table.items() if name != "planner"}
    assert list(last)[:3] == ["online", "online, w_q = 0", "online:frontier"]
    assert list(last)[8] == "farthest-point"
    assert min(last[name] for name in last if name.startswith("online:")) > 25
    assert last["greedy for 60 deg"] >= last["online"] > 60
    assert last["online"] > last["random"]


@pytest.mark.long
def test_the_ablation_shows_every_weight(monkeypatch):
    monkeypatch.setattr(online, "WEIGHTS", {"w_v = 0": (0.0, 1.0)})
    table = rows("\n".join(online.ablation(1, 3)))
    assert list(table) == ["weights", "both 1", "w_v = 0"]
    assert all(len(cells) == 6 for cells in table.values())


@pytest.mark.long
def test_the_whole_suite_runs_to_its_end(monkeypatch):
    small = {"VOXELS_M": (0.2,), "NOISES": ("none",), "WEIGHTS": {"w_q = 0": (1.0, 0.0)}}
    for name, value in small.items():
        monkeypatch.setattr(online, name, value)
    table = rows("\n".join(online.online(1, 1, most=2)))
    names = ["room", "room mode, 0.1 m, noise none", "weights", "both 1", "w_q = 0"]
    assert [name for name in table if not name.startswith("bench")] == names
    assert table["weights"][0] == "within 60 deg, 1 view"


def test_the_interval_of_differences_holds_their_mean():
    text = online.interval(np.array([0.01, 0.03]), np.random.default_rng(0))
    assert text == "+2.0 (+1.0 to +3.0)"


@pytest.mark.long
def test_views_to_a_share_are_counted():
    found = online.plan(0, max_views=4, voxel_m=0.2)
    assert online.views_to(found) == pytest.approx([np.inf] * 4)
    assert "inf (inf)" in online.views_row("short", 1, max_views=3, voxel_m=0.2)


@pytest.mark.long
@requires_data
def test_online_views_around_objects_come_near_the_choice_that_knows_them():
    table = rows("\n".join(object_views.object_views("tuning", 1, 100, 2000, 2)))
    online, farthest, greedy = (float(share) for share in table["mean"][0].split(" / "))
    assert greedy >= online > farthest
