# SPDX-License-Identifier: MIT
"""Journal: a run that was cut off goes on where it was, to the same end."""

import hashlib
import json
from functools import cache

import numpy as np
import pytest

from completion.pipeline import complete
from nbv.cover.pipeline import CoverOptions
from nbv.online.planner import PlannerOptions
from nbv.plan.planning import plan_views
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor, View
from nbv.visibility.samples import sample_surface
from nbv.visibility.viewpoints import Candidates
from scenes.checks import InputError
from scenes.pose import Pose
from scenes.run.journal import NO_JOURNAL, FileJournal
from scenes.world.builtin import builtin_scene

ROOM = builtin_scene("two_occluders")
SENSOR = PinholeSensor(fov_deg=70, width=60, height=60)
SAMPLES = sample_surface(ROOM.mesh, 0.25)


class CutOffError(Exception):
    """What ends a run in the middle."""


class CutOff(FileJournal):
    """A journal whose run is cut off when it is about to do so many steps."""

    def __init__(self, folder, n_steps):
        super().__init__(folder, "key")
        self.left = n_steps

    def step(self, name, work):
        def counted():
            if self.left == 0:
                raise CutOffError(name)
            self.left -= 1
            return work()

        return super().step(name, counted)


def planned(journal, **how):
    options = PlannerOptions(voxel_m=0.2)
    return plan_views(
        ROOM, SENSOR, samples=SAMPLES, options=options, noise="gaussian-2mm", rng=3, journal=journal,
        budgets=CoverOptions(polish_steps=200), **how,
    ).to_json()  # fmt: skip


def explored(journal):
    return planned(journal, views=5)


def explored_with_completion(journal):
    return planned(journal, views=3, infer=True)


def covered(journal):
    corners = np.array([[x, y, 1.5] for x in (1.0, 3.0, 5.0) for y in (0.7, 4.3)])
    around = np.radians(np.arange(0, 360, 30.0))
    directions = np.stack([np.cos(around), np.sin(around), np.full(12, -0.3)], axis=1)
    return planned(journal, method="cover", target=0.9, candidates=Candidates(corners, directions))


def completed(journal):
    """A digest of all that a completion of two scans writes."""
    folder = journal.folder.parent / "out" if isinstance(journal, FileJournal) else None
    poses = [Pose.looking_at((5.0, 1.5, 1.4), (2.0, 2.0, 0.6)), Pose.looking_at((1.0, 4.4, 1.5), (3, 2, 0.6))]
    scans = [scan_scene(ROOM, View(pose, SENSOR), rng=0, noise="gaussian-2mm") for pose in poses]
    found = complete(scans, rng=0, n_threads=1, journal=journal)
    arrays = [found.hypothesised.vertices, *(one.image for one in found.textures if one is not None)]
    digest = hashlib.sha256(b"".join(array.tobytes() for array in arrays)).hexdigest()
    if folder is not None:
        found.save(folder)
        assert json.loads((folder / "completion.json").read_text())["surfaces"]
    return digest


@cache
def undisturbed(run):
    return run(NO_JOURNAL)


@pytest.mark.parametrize(
    ("run", "cut_at"),
    [
        (explored, 4),
        pytest.param(explored_with_completion, 2, marks=pytest.mark.long),
        (covered, 1),
        (covered, 2),
        pytest.param(completed, 2, marks=pytest.mark.long),
        (completed, 7),
        pytest.param(completed, 12, marks=pytest.mark.long),
    ],
)
def test_a_run_that_was_cut_off_ends_as_an_undisturbed_one(tmp_path, run, cut_at):
    whole = undisturbed(run)
    with pytest.raises(CutOffError):
        run(CutOff(tmp_path / "journal", cut_at))
    n_kept = len(list((tmp_path / "journal").glob("*.npz")))
    assert n_kept == cut_at
    assert run(FileJournal(tmp_path / "journal", "key")) == whole
    assert run(CutOff(tmp_path / "journal", 0)) == whole  # all is known now


def test_a_journal_of_something_else_or_with_damage_is_not_believed(tmp_path):
    folder = tmp_path / "journal"
    journal = FileJournal(folder, "one")
    assert [journal.step("a", lambda: 1.5), journal.step("a", lambda: 2.5)] == [1.5, 1.5]
    assert FileJournal(folder, "one").step("a", lambda: 2.5) == 1.5
    file = folder / "a.npz"
    file.write_bytes(file.read_bytes()[:40])
    assert journal.step("a", lambda: 3.5) == 3.5
    assert FileJournal(folder, "other").step("a", lambda: None) is None
    assert len(list(folder.iterdir())) == 2
    other = FileJournal(folder, "other")
    assert [other.part("b").step("a", lambda: 1), other.step("a", lambda: 2)] == [1, None]
    assert other.part("b").step("a", lambda: 3) == 1
    (folder / "key.json").write_text("[]")
    assert FileJournal(folder, "other").step("a", lambda: 4.5) == 4.5
    journal.forget()
    assert not folder.exists()


def test_a_journal_needs_a_folder_that_can_be_made_and_is_there(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot make this folder"):
        FileJournal(tmp_path / "file" / "journal", "key")
    journal = FileJournal(tmp_path / "journal", "key")
    journal.forget()
    with pytest.raises(InputError, match="no folder"):
        journal.step("a", lambda: 1)
