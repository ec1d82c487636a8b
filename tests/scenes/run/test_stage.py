# SPDX-License-Identifier: MIT
"""Stage: outputs appear together or not at all, whatever stops the run and whenever."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from scenes.checks import InputError
from scenes.run.atomic import Stage, hold_lock, settle

OLD = {"a.txt": "old a", "b.txt": "old b", "manifest.json": "old"}
NEW = {"a.txt": "new a", "plots/c.txt": "new c", "manifest.json": "new"}


def contents(folder: Path) -> dict[str, str]:
    files = (file for file in folder.rglob("*") if file.is_file())
    return {file.relative_to(folder).as_posix(): file.read_text() for file in files}


def filled(folder: Path, files: dict[str, str] = OLD) -> Path:
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    return folder


def commit(folder: Path) -> None:
    with Stage(folder) as stage:
        for name, text in NEW.items():
            stage.path(name).write_text(text)
        assert contents(folder).items() >= OLD.items()
        stage.commit()


def test_what_is_committed_replaces_what_has_its_name_and_leaves_the_rest(tmp_path):
    commit(filled(tmp_path))
    assert contents(tmp_path) == {**OLD, **NEW}


def test_what_is_not_committed_leaves_no_trace(tmp_path):
    filled(tmp_path)
    with Stage(tmp_path) as stage:
        stage.path("a.txt").write_text("new")
    assert contents(tmp_path) == OLD
    assert sorted(os.listdir(tmp_path)) == sorted(OLD)


@pytest.mark.parametrize("n_steps", range(5))
def test_a_run_that_is_stopped_in_its_commit_is_settled_by_the_next(tmp_path, monkeypatch, n_steps):
    """Whether it is stopped before the decision, at it or after one or two files."""
    filled(tmp_path)
    left, steps = [n_steps], {name: getattr(Path, name) for name in ("rename", "replace")}

    def stopping(name):
        def step(self, target):
            if self.name.startswith(".unseen") or ".unseen" in str(self):
                if not left[0]:
                    os._exit(9)
                left[0] -= 1
            return steps[name](self, target)

        return step

    child = os.fork()
    if child == 0:
        for name in steps:
            setattr(Path, name, stopping(name))
        commit(tmp_path)
        os._exit(0)
    _, status = os.waitpid(child, 0)
    assert os.waitstatus_to_exitcode(status) == (9 if n_steps < 4 else 0)
    seen = contents(tmp_path)
    if n_steps < 4:
        assert seen["manifest.json"] == "old"  # the seal comes last
    settle(tmp_path)
    assert contents(tmp_path) == (OLD if n_steps == 0 else {**OLD, **NEW})
    assert not [name for name in os.listdir(tmp_path) if name.startswith(".")]


def test_a_folder_in_the_place_of_a_file_is_refused_before_anything_changes(tmp_path):
    filled(tmp_path)
    (tmp_path / "plots" / "c.txt").mkdir(parents=True)
    with pytest.raises(InputError, match=r"c\.txt: is a folder, where a file is to be written"):
        commit(tmp_path)
    assert contents(tmp_path) == OLD


def test_a_file_in_the_place_of_a_folder_is_refused_before_anything_changes(tmp_path):
    filled(tmp_path, {**OLD, "plots": "a file"})
    with pytest.raises(InputError, match="plots: is a file, where a folder is to be made"):
        commit(tmp_path)
    assert contents(tmp_path) == {**OLD, "plots": "a file"}


def test_a_stage_whose_name_is_a_link_is_not_followed(tmp_path):
    elsewhere, folder = filled(tmp_path / "elsewhere"), tmp_path / "out"
    folder.mkdir()
    for name in (".unseen-staged", ".unseen-decided"):
        (folder / name).symlink_to(elsewhere, target_is_directory=True)
    settle(folder)
    assert contents(elsewhere) == OLD
    with pytest.raises(InputError, match="cannot write"):
        commit(folder)


def test_a_folder_that_cannot_be_written_is_named(tmp_path):
    with pytest.raises(InputError, match="none: cannot write"), Stage(tmp_path / "none"):
        pass


def test_files_of_one_folder_have_stages_and_locks_of_their_own(tmp_path):
    with hold_lock(tmp_path, "a.txt"), Stage(tmp_path, "a.txt") as a:
        with hold_lock(tmp_path, "b.txt"), Stage(tmp_path, "b.txt") as b:
            a.path("a.txt").write_text("a")
            b.path("b.txt").write_text("b")
            b.commit()
        assert contents(tmp_path).get("b.txt") == "b"
        a.commit()
    assert contents(tmp_path) == {"a.txt": "a", "b.txt": "b"}


def test_a_lock_is_waited_for_as_long_as_a_killed_run_needs_to_be_gone(tmp_path):
    code = (
        "import sys, time; from pathlib import Path; from scenes.run.atomic import hold_lock\n"
        "with hold_lock(Path(sys.argv[1])): print('held', flush=True); time.sleep(0.5)"
    )
    command = [sys.executable, "-c", code, str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "held\n"
        with pytest.raises(InputError, match="another run writes there"), hold_lock(tmp_path, wait_s=0.0):
            pass
        with hold_lock(tmp_path):
            pass
    assert other.returncode == 0
