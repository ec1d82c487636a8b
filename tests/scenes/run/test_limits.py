# SPDX-License-Identifier: MIT
"""Limits: in force for a block, by name, on the command line as in Python; their errors name the cure."""

import threading
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from nbv.cli import app
from nbv.run.workers import _Bounds, _on_worker
from scenes.checks import InputError
from scenes.io.checks.documents import parse_json, parse_toml, read_json, read_text
from scenes.io.checks.guard import check_file
from scenes.io.checks.image import check_image
from scenes.io.checks.limits import (
    LIMIT_NAMES,
    ReadLimits,
    check_limit,
    check_unpacked,
    current_limits,
    limits,
)
from scenes.io.clouds.npz import open_arrays
from scenes.io.scene_files import load_scene
from scenes.rays.raycast import RayCaster
from scenes.run.memory import memory_limit, planned_bytes
from tests.robustness.bad_files import meshes
from tests.robustness.bad_files.documents import picture


def test_limits_are_in_force_for_a_block_and_nest() -> None:
    usual = current_limits()
    with limits(faces=10) as outer, limits(points=20):
        assert (current_limits().faces, current_limits().points) == (10, 20)
        assert current_limits().non_defaults() == {"faces": 10, "points": 20}
        seen: list[ReadLimits] = []
        thread = threading.Thread(target=lambda: seen.append(current_limits()))
        thread.start()
        thread.join()
        assert seen == [usual]
        assert outer.non_defaults() == {"faces": 10}
    assert current_limits() == usual == ReadLimits()


@pytest.mark.parametrize("changes", [{"noses": 3}, {"faces": 0}, {"faces": 1.5}, {"faces": True}])
def test_limits_that_are_none_are_refused(changes: dict[str, int]) -> None:
    with pytest.raises(InputError, match="limit"), limits(**changes):
        pass
    assert current_limits() == ReadLimits()


def test_errors_name_limit_number_and_cure() -> None:
    with limits(faces=10):
        check_limit("faces", 10, "its faces")
        with pytest.raises(
            InputError, match=r"its faces: 11 exceed the limit faces=10; .* --limit faces=11 \(in"
        ):
            check_limit("faces", 11, "its faces")
    check_unpacked(64 << 20, 1, "it")
    check_unpacked(200 << 20, 1 << 20, "it")
    with pytest.raises(
        InputError, match="unpacked bytes of it for each packed one: 201 exceed the limit ratio"
    ):
        check_unpacked(201 << 20, 1 << 20, "it")


@pytest.mark.parametrize("name", LIMIT_NAMES)
def test_every_limit_changes_a_result(tmp_path: Path, name: str) -> None:
    write = {
        "json_bytes": lambda: read_json(wrote(tmp_path / "a.json", b'{"a": 1}'), dict),
        "toml_bytes": lambda: read_text(wrote(tmp_path / "a.toml", b"a = 1"), "toml_bytes"),
        "unpacked_bytes": lambda: opened(tmp_path),
        "entries": lambda: opened(tmp_path),
        "pixels": lambda: check_image(picture()),
        "texels": lambda: load_scene(textured(tmp_path)),
        "ratio": lambda: check_unpacked(80 << 20, 2, "it"),
    }.get(name, lambda: load_scene(meshes.write_glb(tmp_path, meshes.SIDE, meshes.FACES)))
    with limits(ratio=100_000_000):
        write()
        with limits(**{name: 1}), pytest.raises(InputError, match=f"exceed the limit {name}=1"):
            write()


def wrote(path: Path, data: bytes) -> Path:
    path.write_bytes(data)
    return path


def opened(folder: Path) -> None:
    np.savez(folder / "a.npz", a=np.zeros(3), b=np.zeros(3))
    with open_arrays(folder / "a.npz") as arrays:
        assert arrays.files == ("a", "b")


def textured(folder: Path) -> Path:
    (folder / "t.png").write_bytes(picture())
    (folder / "m.mtl").write_text("newmtl m\nmap_Kd t.png\n")
    return wrote(folder / "a.obj", meshes.TEXTURED.format("m.mtl").encode())


def run(*words: object) -> tuple[int, str]:
    done = CliRunner().invoke(app, [str(word) for word in words])
    return done.exit_code, done.stderr


def test_the_command_line_sets_limits(tmp_path: Path) -> None:
    path = meshes.write_glb(tmp_path, meshes.SIDE, meshes.FACES)
    assert run("info", path) == (0, "")
    code, said = run("info", path, "--limit", "faces=3")
    assert (code, len(said.splitlines())) == (1, 1)
    assert "its faces as placed: 4 exceed the limit faces=3; if you trust the file" in said
    assert (
        run("info", path, "--limit", "faces=3", "--limit", "faces=1K", "--limit", "file_bytes=1MiB")[0] == 0
    )
    for words in ("noses=3", "faces", "faces=none", "faces=0", "faces=-1"):
        code, said = run("info", path, "--limit", words)
        assert code == 2, said


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"a": NaN}', "it holds NaN; write null"),
        ('{"a": -Infinity}', "it holds -Infinity"),
        ('{"a": 1e999}', "holds the number 1e999, which is too large"),
        ('{"a": ' + "9" * 19 + "}", "holds an integer of 19 digits"),
        ('{"a": "\\ud800"}', r"holds \\ud800, which is half a letter"),
        ("[" * 100_000, "nested too deeply"),
        ("[1]", "is JSON, but not an object .*: it is a list"),
        ("null", "it is null"),
        ("5", "it is the int '5'"),
        ("{", "is no valid JSON"),
    ],
)
def test_json_that_cannot_be_used_is_refused(text: str, message: str) -> None:
    for given in (text, text.encode()):
        with pytest.raises(InputError, match=message):
            parse_json(given, dict)


def test_json_that_can_be_used_is_read() -> None:
    assert parse_json('{"a": [1, 2.5e300, "\\ud83d\\ude00", null]}', dict) == {"a": [1, 2.5e300, "😀", None]}
    assert parse_json("[123456789012345678]", list) == [123456789012345678]


@pytest.mark.parametrize("text", ["a = ", "a = " + "[" * 100_000, "a = " + "9" * 5000, "a = 1\na = 2"])
def test_toml_that_cannot_be_used_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="TOML"):
        parse_toml(text)


def test_what_is_no_file_is_refused(tmp_path: Path) -> None:
    import os

    os.mkfifo(tmp_path / "pipe")
    for path, message in (
        (tmp_path / "pipe", "is a pipe or device"),
        (Path("/dev/zero"), "is a pipe or device"),
        (tmp_path / ("x" * 300), "cannot be read: File name too long"),
        (tmp_path / "none" / "x", "no such file"),
        (tmp_path, "is a folder"),
    ):
        with pytest.raises(InputError, match=message):
            check_file(path)


def test_arrays_are_held_against_their_archive(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", points=np.zeros((2, 3)))
    with open_arrays(tmp_path / "a.npz") as arrays:
        assert arrays["points"].shape == (2, 3)
        with pytest.raises(InputError, match="has no 'normals'; it holds points"):
            arrays["normals"]


def test_places_far_from_the_origin_lose_nothing_in_ray_casting() -> None:
    """A scene at UTM's 5,400 km: ranges as near the origin, to float64's own rounding there."""
    rng = np.random.default_rng(0)
    ways = rng.normal(size=(500, 3))
    far = np.array([4.5e5, 5.4e6, 100.0])
    eye = np.array([[2.0, 1.5, 1.0]])
    near_hits = RayCaster(meshes.SIDE, meshes.FACES).first_hit(eye, ways)
    far_hits = RayCaster(meshes.SIDE + far, meshes.FACES).first_hit(eye + far, ways)
    np.testing.assert_array_equal(near_hits.face, far_hits.face)
    hit = near_hits.hit
    assert hit.sum() > 100
    rounding = 64 * np.spacing(far.max())  # of coordinates, through a few dozen operations
    np.testing.assert_allclose(far_hits.ranges[hit], near_hits.ranges[hit], atol=rounding * 10, rtol=0)


def test_workers_elsewhere_have_the_limits_of_here() -> None:
    def work(_item: None, _n_threads: int | None) -> tuple[int, int | None]:
        return current_limits().faces, planned_bytes()

    with limits(faces=5), memory_limit(10**9):
        bounds = _Bounds.here()
    assert _on_worker(work, None, 1, bounds) == (5, 10**9)
    assert current_limits() == ReadLimits()
    assert planned_bytes() is None
