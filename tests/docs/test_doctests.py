# SPDX-License-Identifier: MIT
"""Examples in docstrings are right."""

import doctest
import importlib

import pytest

from tests.helpers.data_paths import ROOT

PACKAGES = ("scenes", "texture", "completion", "nbv", "benchmarks")
FILES = sorted(
    file
    for package in PACKAGES
    for file in (ROOT / package).rglob("*.py")
    if ">>> " in file.read_text(encoding="utf-8")
)


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.relative_to(ROOT).as_posix())
def test_examples_give_what_they_show(file, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    name = ".".join(file.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
    found = doctest.testmod(importlib.import_module(name))
    assert found.attempted
    assert not found.failed
