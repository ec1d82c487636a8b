# SPDX-License-Identifier: MIT
"""File names of another encoding than the system's, and pipes that cannot hold all letters."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from nbv.cli import app
from scenes.io.scan_files import read_scan, write_scan
from scenes.run.atomic import encodable, json_text
from tests.helpers.long_cases import first_in_gate
from tests.helpers.scan_examples import PROJECTIONS, example_scan

LATIN_1 = os.fsdecode(b"gr\xf6\xdfe")  # as of a ZIP archive from Windows


def folder_takes_any_bytes(folder: Path) -> bool:
    try:
        (folder / LATIN_1).mkdir()
    except OSError:
        return False
    return True


@pytest.mark.parametrize("suffix", [".e57", ".npz", ".las", ".ply", ".pcd"])
def test_scans_of_latin_1_names_are_read_described_and_written(tmp_path: Path, suffix: str) -> None:
    if not folder_takes_any_bytes(tmp_path):
        pytest.skip("the file system takes no names but UTF-8")
    file, out = tmp_path / f"{LATIN_1}{suffix}", tmp_path / "described.json"
    write_scan(example_scan(PROJECTIONS["pinhole"]).with_facts(name=LATIN_1), file)
    back = tmp_path / f"back{suffix}"
    write_scan(read_scan(file), back)
    assert read_scan(back).shape == read_scan(file).shape
    ran = CliRunner().invoke(app, ["info", str(file), "-o", str(out), "--json"])
    assert (ran.exit_code, ran.exception) == (0, None)
    assert json.loads(out.read_text("utf-8"))["path"] == str(file)
    assert json.loads(Path(f"{out}.manifest.json").read_text("utf-8"))["inputs"][0]["input"] == str(file)


def test_half_letters_survive_in_json() -> None:
    text = json_text({LATIN_1: [LATIN_1, "扫描"]}, indent=None)
    assert json.loads(text.encode("utf-8")) == {LATIN_1: [LATIN_1, "扫描"]}
    assert encodable("扫描") == "扫描"


@pytest.mark.parametrize(
    ("name", "encoding"),
    first_in_gate(2, [("扫描", "cp1252"), (LATIN_1, "utf-8"), ("扫描", "utf-8"), (LATIN_1, "cp1252")]),
)
def test_names_are_printed_to_pipes_of_any_encoding(tmp_path: Path, name: str, encoding: str) -> None:
    if not folder_takes_any_bytes(tmp_path):
        pytest.skip("the file system takes no names but UTF-8")
    write_scan(example_scan(PROJECTIONS["pinhole"]), tmp_path / f"{name}.npz")
    for file, code in ((f"{name}.npz", 0), (f"{name}.xyz", 1)):
        ran = subprocess.run(
            [sys.executable, "-m", "nbv.cli", "info", str(tmp_path / file)],
            capture_output=True,
            env=os.environ | {"PYTHONIOENCODING": encoding},
            check=False,
        )
        text = (ran.stdout + ran.stderr).decode(encoding)
        assert (ran.returncode, "Traceback" in text) == (code, False)
        assert name.encode(encoding, "backslashreplace").decode(encoding) in text
