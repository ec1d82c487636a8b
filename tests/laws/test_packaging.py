# SPDX-License-Identifier: MIT
"""What packages the project elsewhere says the same as pyproject.toml: conda recipe, citation, container."""

import re
import tomllib

import jinja2
import pytest

from tests.helpers.data_paths import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]


def names_of(requirements):
    return {re.split(r"[ <>=\[;]", one)[0] for one in requirements}


def test_the_conda_recipe_needs_what_the_project_needs():
    def load_file_data(name, from_recipe_dir):
        assert from_recipe_dir
        return tomllib.loads((ROOT / "conda" / name).read_text("utf-8"))

    recipe = (ROOT / "conda" / "meta.yaml").read_text("utf-8")
    text = jinja2.Template(recipe).render(load_file_data=load_file_data, PYTHON="python")
    run = re.search(r"^  run:\n((?: {4}- .*\n|\s*\n)+)", text, re.MULTILINE)
    assert run, text
    needed = [line.strip()[2:] for line in run[1].splitlines() if line.strip()]
    renamed = {"py-opencv": "opencv-python-headless", "matplotlib-base": "matplotlib"}
    assert {renamed.get(name, name) for name in names_of(needed)} == {
        "python",
        *names_of(one for one in PROJECT["dependencies"] if "python_version" not in one),
    }
    assert f"version: {PROJECT['version']}\n" in text
    assert "unseen = nbv.cli:main" in text


@pytest.mark.parametrize("line", [f"version: {PROJECT['version']}", f"license: {PROJECT['license']}"])
def test_the_citation_is_of_this_version(line):
    assert line in (ROOT / "CITATION.cff").read_text("utf-8").splitlines()


def test_the_container_compiles_ahead_into_a_folder_of_everybody():
    text = (ROOT / "Dockerfile").read_text("utf-8")
    folder = re.search(r"NUMBA_CACHE_DIR=(\S+)", text)
    assert folder
    assert "unseen warm" in text
    assert 'chmod -R a+rwX "$NUMBA_CACHE_DIR"' in text
    assert "python:3.13" in text
    assert any(line.endswith(":: 3.13") for line in PROJECT["classifiers"])
