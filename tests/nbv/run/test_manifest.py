# SPDX-License-Identifier: MIT
"""Manifests: what they record, and where they go."""

import hashlib
import json
from pathlib import Path

from nbv.run.manifest import (
    Inputs,
    Stopwatch,
    manifest_path,
    read_inputs,
    sha256_of,
    version_of,
    write_manifest,
)


def test_sha256_is_that_of_the_standard_library(tmp_path):
    file = tmp_path / "a.bin"
    file.write_bytes(b"unseen" * 300_000)
    assert sha256_of(file) == hashlib.sha256(b"unseen" * 300_000).hexdigest()


def test_inputs_are_files_folders_numbered_scans_and_names(tmp_path):
    (tmp_path / "folder" / "depth").mkdir(parents=True)
    (tmp_path / "folder" / "depth" / "1.png").write_bytes(b"1")
    (tmp_path / "scan.e57").write_bytes(b"22")
    records = read_inputs(
        [str(tmp_path / "scan.e57#2"), str(tmp_path / "folder"), "builtin:office", "generic60"]
    ).records
    assert records[0]["bytes"] == 2
    assert records[0]["sha256"] == hashlib.sha256(b"22").hexdigest()
    assert [file["name"] for file in records[1]["files"]] == ["depth/1.png"]
    assert records[2:] == ({"input": "builtin:office"}, {"input": "generic60"})


def test_manifest_goes_into_a_folder_and_beside_a_file():
    assert manifest_path(Path("out"), is_folder=True) == Path("out/manifest.json")
    assert manifest_path(Path("out/a.npz"), is_folder=False) == Path("out/a.npz.manifest.json")


def test_manifest_holds_all_that_is_promised(tmp_path):
    output = tmp_path / "result.txt"
    output.write_text("x")
    watch = Stopwatch()
    watch.enter("load")
    watch.enter("work")
    write_manifest(
        tmp_path / "manifest.json",
        command="scan",
        seed=7,
        inputs=read_inputs(["builtin:two_occluders"]),
        options={"sensor": "generic60"},
        threads=2,
        outputs={"parts/result.txt": output},
        times=watch.record(),
    )
    held = json.loads((tmp_path / "manifest.json").read_text())
    assert held["command"] == "scan"
    assert held["seed"] == 7
    assert held["threads"] == 2
    assert held["options"] == {"sensor": "generic60"}
    assert held["outputs"] == [{"name": "parts/result.txt", "bytes": 1, "sha256": sha256_of(output)}]
    assert {"unseen", "python", "numpy", "embreex"} <= set(held["versions"])
    assert set(held["times"]) == {"started", "finished", "seconds", "stages_s"}
    assert set(held["times"]["stages_s"]) == {"load", "work"}


def test_threads_default_to_the_cores(tmp_path):
    write_manifest(
        tmp_path / "m.json",
        command="x",
        seed=0,
        inputs=Inputs(),
        options={},
        threads=None,
        outputs={},
        times={},
    )
    assert json.loads((tmp_path / "m.json").read_text())["threads"] >= 1


def test_a_stage_that_comes_again_adds_up():
    watch = Stopwatch()
    for stage in ("a", "b", "a"):
        watch.enter(stage)
    assert list(watch.record()["stages_s"]) == ["a", "b"]


def test_what_is_not_installed_has_no_version():
    assert version_of("no-such-distribution-1234") == "unknown"


def test_inputs_are_named_without_their_folders_and_hashed(tmp_path):
    one, folder = tmp_path / "one.ply", tmp_path / "frames"
    one.write_bytes(b"ply")
    folder.mkdir()
    (folder / "b.png").write_bytes(b"b")
    given = [str(one), f"{one}#2", str(folder), "builtin:office", "generic60"]
    found = read_inputs(given).digests()
    assert [name for name, _ in found] == ["one.ply", "one.ply#2", "frames/"]
    assert found[0][1] == found[1][1] == hashlib.sha256(b"ply").hexdigest()
    (folder / "b.png").write_bytes(b"c")
    assert read_inputs(given).digests()[2] != found[2]
