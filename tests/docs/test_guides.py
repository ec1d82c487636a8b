# SPDX-License-Identifier: MIT
"""README and guides are programs: their blocks run, their command lines parse, their TOML is accepted."""

import ast
import re
import shlex
import tomllib

import pytest
import typer

from nbv.cli import app
from nbv.commands.defaults import project_defaults
from nbv.scanning.sensor_profile import load_sensor
from nbv.study.spec import read_study
from tests.helpers.data_paths import ROOT
from tests.helpers.long_cases import first_in_gate

PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")])


def name_of(page):
    """Its path from the root, for ids of tests."""
    return page.relative_to(ROOT).as_posix()


def blocks_of(page, language):
    """The fenced blocks of a language, in order."""
    return re.findall(rf"^```{language}\n(.*?)^```", page.read_text("utf-8"), re.MULTILINE | re.DOTALL)


NOT_RUN = {
    "cluster": "it needs a scheduler",
    "studies": "it reads a study file of the reader's",
}
"""Pages whose Python is not run, with the reason."""

LONG = {
    "benchmark",
    "check",
    "planning",
    "part-dimensions",
    "parts",
    "decisions",
    "features",
    "registration",
    "drawings",
    "own-templates",
    "flattening",
}
"""Guides whose programs take seconds each; the gate looks up the names that they import."""

PROGRAMS = [page for page in PAGES if blocks_of(page, "python") and page.stem not in NOT_RUN]
QUICK = sorted(PROGRAMS, key=lambda page: page.stem in LONG)
N_QUICK = len(PROGRAMS) - len([page for page in PROGRAMS if page.stem in LONG])
WITH_TOML = [page for page in PAGES if blocks_of(page, "toml") and page.stem != "studies"]
"""Its files are beside the study of the page; tests/nbv/study reads it."""


def commands_of(page):
    """Every whole command line: in blocks of shell or of no language, and in tables."""
    text = page.read_text("utf-8")
    fenced = re.findall(r"^```(?:sh|console)?\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    lines = [line for block in fenced for line in block.splitlines()]
    lines += re.findall(r"^\|.*?`(unseen [^`]* -o [^`]*)`", text, re.MULTILINE)
    typed = [line.removeprefix("$ ").removeprefix(".venv/bin/") for line in lines]
    return [line for line in typed if line.startswith("unseen ")]


@pytest.mark.parametrize("page", PROGRAMS, ids=name_of)
def test_python_blocks_import_what_there_is(page):
    for block in blocks_of(page, "python"):
        imports = [node for node in ast.parse(block).body if isinstance(node, ast.Import | ast.ImportFrom)]
        exec(compile(ast.Module(imports, []), page.name, "exec"), {})


@pytest.mark.parametrize("page", first_in_gate(N_QUICK, QUICK), ids=name_of)
def test_python_blocks_run_in_order(page, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for block in blocks_of(page, "python"):
        exec(compile(block, page.name, "exec"), names)
    if page.name == "README.md":
        assert "in observed free space 0.0 m2" in capsys.readouterr().out
        assert (tmp_path / "out/readme/completed.glb").stat().st_size > 1000


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_command_lines_parse(page):
    commands = typer.main.get_command(app).commands
    for line in commands_of(page):
        _, *words = shlex.split(line, comments=True)
        if not words or words[0].isupper() or words[0].startswith("-"):
            continue  # `unseen` and `unseen --help`
        assert words[0] in commands, line
        try:
            commands[words[0]].make_context(words[0], words[1:])
        except typer.BadParameter.__base__ as error:  # the parser's own class has no public name
            pytest.fail(f"{line}: {error.format_message()}")


def test_wrong_command_lines_are_found(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("```sh\nunseen plan a.glb --methd nbv\n```\n| x | `unseen info a.glb -o b` |\n", "utf-8")
    assert commands_of(page) == ["unseen plan a.glb --methd nbv", "unseen info a.glb -o b"]
    with pytest.raises(pytest.fail.Exception, match="--methd"):
        test_command_lines_parse(page)


NAMES = {name: {flag: flag for flag in ("threads", "up", "export")} for name in ("complete", "plan")}


@pytest.mark.parametrize("page", WITH_TOML, ids=name_of)
def test_toml_is_accepted(page, tmp_path):
    for number, block in enumerate(blocks_of(page, "toml")):
        file = tmp_path / f"{number}.toml"
        file.write_text(block, "utf-8")
        if block.startswith("[project."):
            offered = tomllib.loads(block)["project"]["entry-points"]
            assert set(offered) == {"unseen.readers", "unseen.sensors"}
        elif block.startswith("[all]"):
            (tmp_path / "unseen.toml").write_text(block, "utf-8")
            assert project_defaults(tmp_path, NAMES)["complete"]
        elif block.startswith(("kind", "like")):
            assert load_sensor(file).max_range_m > 0
        else:
            assert read_study(file).scenes
