# SPDX-License-Identifier: MIT
"""Journal: an exploration that was cut off goes on where it was, to the same end."""

import numpy as np
import pytest

from nbv import planner
from nbv.journal import FileJournal
from nbv.plan import Plan
from nbv.planner import PlannerOptions
from nbv.planning import plan_views
from nbv.samples import sample_surface
from nbv.scanning.sensor import PinholeSensor
from scenes.builtin import builtin_scene
from scenes.checks import InputError

ROOM = builtin_scene("two_occluders")
SENSOR = PinholeSensor(fov_deg=70, width=60, height=60)
SAMPLES = sample_surface(ROOM.mesh, 0.25)


def explored(journal, *, infer=False, views=7) -> Plan:
    options = PlannerOptions(voxel_m=0.2)
    return plan_views(
        ROOM, SENSOR, samples=SAMPLES, options=options, views=views, infer=infer, noise="gaussian-2mm", rng=3,
        journal=journal,
    )  # fmt: skip


class CutOffError(Exception):
    """What ends a run in the middle."""


@pytest.mark.parametrize(("infer", "views", "cut_at"), [(False, 7, 4), (True, 3, 2)])
def test_an_exploration_that_was_cut_off_ends_as_an_undisturbed_one(
    tmp_path, monkeypatch, infer, views, cut_at
):
    whole = explored(None, infer=infer, views=views).to_json()
    choose, counted = planner.next_view, []

    def cut_off(*given):
        counted.append(1)
        if len(counted) == cut_at:
            raise CutOffError
        return choose(*given)

    monkeypatch.setattr(planner, "next_view", cut_off)
    with pytest.raises(CutOffError):
        explored(FileJournal(tmp_path / "journal", "key"), infer=infer, views=views)
    assert len(list((tmp_path / "journal").glob("view-*.npz"))) == cut_at - 1
    assert explored(FileJournal(tmp_path / "journal", "key"), infer=infer, views=views).to_json() == whole
    assert len(counted) == views
    assert explored(FileJournal(tmp_path / "journal", "key"), infer=infer, views=views).to_json() == whole
    assert len(counted) == views


def test_a_journal_of_something_else_or_with_damage_is_not_believed(tmp_path):
    folder = tmp_path / "journal"
    whole = explored(FileJournal(folder, "one")).to_json()
    files = sorted(folder.glob("view-*.npz"))
    files[2].write_bytes(files[2].read_bytes()[:200])
    assert FileJournal(folder, "one").remembered(3) is None
    assert FileJournal(folder, "one").remembered(2) is not None
    assert explored(FileJournal(folder, "one")).to_json() == whole
    other = FileJournal(folder, "other")
    assert other.remembered(1) is None
    assert len(list(folder.iterdir())) == 1
    (folder / "key.json").write_text("[]")
    assert FileJournal(folder, "other").remembered(1) is None
    other.forget()
    assert not folder.exists()


def test_a_journal_needs_a_folder_that_can_be_made(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot make this folder"):
        FileJournal(tmp_path / "file" / "journal", "key")


def test_what_is_remembered_is_what_was_chosen(tmp_path):
    journal = FileJournal(tmp_path / "journal", "key")
    explored(journal)
    best = journal.remembered(1)
    assert best.gain_m2 > 0
    assert best.sees.offsets.shape == (len(best.sees.worth_m2), 3)
    assert np.isclose(np.linalg.det(best.pose.rotation), 1)
    with pytest.raises(InputError, match="no folder"):
        FileJournal.remember(_elsewhere(journal), 1, best)


def _elsewhere(journal):
    journal.forget()
    return journal
