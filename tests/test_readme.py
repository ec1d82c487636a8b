# SPDX-License-Identifier: MIT
"""The README is a program: its Python blocks run, in order, and its claims about files hold."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_python_blocks_run_in_order(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    assert len(blocks) == 3
    names: dict[str, object] = {}
    for block in blocks:
        exec(compile(block, "README.md", "exec"), names)
    assert "in observed free space 0.0 m2" in capsys.readouterr().out
    assert (tmp_path / "out/readme/completed.glb").stat().st_size > 1000


@pytest.mark.parametrize("name", re.findall(r"\]\(([^)#:]+)\)", README))
def test_linked_files_exist(name):
    assert (ROOT / name).is_file()
