# SPDX-License-Identifier: MIT
"""The command line: one name for one thing, help in sections, examples that run, values put right."""

import os
import re
import shlex
import subprocess
import sys
from collections import defaultdict
from importlib import metadata

import pytest
import typer.main
from typer.testing import CliRunner

from nbv.cli import COMMANDS, app
from nbv.commands.typed import OLD_NAMES
from tests.helpers.data_paths import ROOT

SCENE, SCAN = "builtin:two_occluders", "scan.npz"
NEEDED = {  # the least that a command is called with
    "check": ["design.ifc", SCAN],
    "complete": [SCAN],
    "coverage": [SCENE, "--plan", "plan.json"],
    "part": ["part.stl"],
    "plan": [SCENE],
    "register": [SCAN],
    "scan": [SCENE, "--look", "3,3,1"],
}
MOST_NAMES = 277  # over all commands: 279 before they were made one, and `part --backs --least` are new
SECTIONS = ("Input:", "Method:", "Output:", "Run:", "Examples:")


@pytest.fixture
def asked(monkeypatch):
    """Run a command line up to its work, and return the options that the work would get."""

    def options_of(*words):
        given = []

        class Work:
            def __getattr__(self, name):
                return lambda *options: given.extend(options)

        monkeypatch.setattr("nbv.cli.import_module", lambda _: Work())
        result = CliRunner().invoke(app, [str(word) for word in words])
        assert result.exit_code == 0, result.output
        return given[1]

    return options_of


def visible():
    """Name of the command, its option, and each long name of it that help shows."""
    for name, command in typer.main.get_command(app).commands.items():
        for option in command.params:
            if option.param_type_name == "option" and not option.hidden:
                yield from ((name, option, flag) for flag in option.opts if flag.startswith("--"))


def meaning(text):
    return re.split(r"[:;.(]", text)[0].strip()


def test_each_name_has_one_meaning_and_each_meaning_one_name():
    meanings, names = defaultdict(set), defaultdict(set)
    for _, option, flag in visible():
        meanings[flag].add(meaning(option.help))
        names[meaning(option.help)].add(flag)
    assert {flag: found for flag, found in meanings.items() if len(found) > 1} == {}
    assert {text: found for text, found in names.items() if len(found) > 1} == {}


def test_commands_have_no_more_names_than_before():
    assert sum(command != "review" for command, *_ in visible()) <= MOST_NAMES  # which is new


@pytest.mark.parametrize("name", COMMANDS)
def test_help_has_sections_in_order_and_ends_with_examples(name):
    lines = CliRunner().invoke(app, [name, "--help"]).stdout.splitlines()
    found = [line for line in lines if line in SECTIONS]
    assert found == [line for line in SECTIONS if line in found]
    assert found[-2:] == ["Run:", "Examples:"]
    assert not re.search(r"<(list\[)?str", "\n".join(lines))
    shown = [line.strip() for line in lines[lines.index("Examples:") + 1 :]]
    assert shown == list(COMMANDS[name].examples)


def test_every_section_is_somewhere():
    text = CliRunner().invoke(app, ["complete", "--help"]).stdout
    where = [text.index(f"\n{line}\n") for line in SECTIONS]
    assert where == sorted(where)
    assert where[0] < text.index("--poses") < where[1] < text.index("--inference") < where[2]
    assert where[2] < text.index("--export") < text.index("--json") < where[3] < text.index("--threads")


@pytest.mark.parametrize("columns", [70, 160])
def test_help_is_as_wide_as_the_terminal(columns):
    """In a process of its own: typer's runner forces a width."""
    ran = subprocess.run(
        [sys.executable, "-m", "nbv.cli", "register", "--help"], check=True, cwd=ROOT, capture_output=True,
        text=True, env=os.environ | {"COLUMNS": str(columns)},
    )  # fmt: skip
    assert 0.85 * columns < max(map(len, ran.stdout.splitlines())) <= columns


def test_help_shows_every_default():
    bare = []
    for name, option, flag in visible():
        if option.default not in (None, False) and "default: " not in option.get_help_record(context())[1]:
            bare.append((name, flag))
    assert bare == []


def context():
    return typer.main.get_command(app).make_context("unseen", [], resilient_parsing=True)


LINES = [(name, line) for name, command in COMMANDS.items() for line in command.examples]


@pytest.mark.parametrize(("name", "line"), LINES)
def test_examples_are_command_lines(name, line, asked):
    program, command, *words = shlex.split(line)
    assert (program, command) == ("unseen", name)
    assert isinstance(asked(command, *words), COMMANDS[name].options)


OLD = [(name, old, new) for name, names in OLD_NAMES.items() for old, new in names.items()]
VALUES = {
    "--mode": "bold", "--only": "walls", "--start": "poses.txt", "--plan": "plan.json", "--stations": "3",
    "--no-texture": None,
}  # fmt: skip


@pytest.mark.parametrize(("name", "old", "new"), OLD)
def test_old_names_still_work_and_are_hidden(name, old, new, asked):
    value = VALUES.get(old, "0.125")
    words = [SCAN, "--scans", SCAN] if name == "plan" else NEEDED[name]
    words = ["--scans", SCAN] if old == "--plan" else words
    by_old = asked(name, *words, old, *([] if value is None else [value]))
    assert by_old == asked(name, *words, new, *([] if value is None else [value]))
    assert by_old != asked(name, *words)
    assert old not in CliRunner().invoke(app, [name, "--help"]).stdout.split()


def test_an_old_name_takes_its_value_after_an_equals_sign_and_names_the_new_one_in_errors(asked):
    assert asked("complete", SCAN, "--mode=bold").mode == "bold"
    result = CliRunner().invoke(app, ["complete", SCAN, "--mode", "wild"])
    assert result.exit_code == 2
    assert "--inference: 'wild' is none of conservative, standard, bold" in result.stderr


@pytest.mark.parametrize("name", ["json", "out", "quiet", "seed", "threads", "max-memory", "limit"])
def test_options_that_change_nothing_are_taken_but_not_shown(name, asked):
    shown = {(command, flag) for command, _, flag in visible()}
    hidden = {command for command in COMMANDS if (command, f"--{name}") not in shown} - {"warm"}
    hidden -= {"review"} if name == "out" else set()  # its folder is its argument
    without = {"seed": {"check", "fit", "info", "register", "review"}, "threads": {"fit", "info", "part"}}
    assert hidden == without.get(name, set())
    for command in hidden:
        asked(command, *NEEDED.get(command, ["points.ply"]), f"--{name}", 2)


def test_the_version_is_told():
    result = CliRunner().invoke(app, ["--version"])
    assert (result.exit_code, result.stdout) == (0, f"unseen {metadata.version('unseen')}\n")


@pytest.mark.parametrize(
    ("name", "typed", "field", "value"),
    [
        ("scan", ["--at", "1 1 1.6"], "at", (1.0, 1.0, 1.6)),
        ("scan", ["--at", "1", "-1", "1.6"], "at", (1.0, -1.0, 1.6)),
        ("scan", ["--at=(1, 1, 1.6)"], "at", (1.0, 1.0, 1.6)),
        ("scan", ["--at", "1,1,1", "--up", "Z"], "up", "z"),
        ("scan", ["--at", "1,1,1", "--units", "feet"], "units", "ft"),
        ("scan", ["--at", "1,1,1", "--units", "FT"], "units", "ft"),
        ("scan", ["--at", "1,1,1", "--units", "Meters"], "units", "m"),
        ("scan", ["--at", "1,1,1", "--units", "inches"], "units", "in"),
        ("complete", ["--up", "-Z"], "up", "-z"),
        ("check", ["--registration-sd", "0.004"], "registration", (0.004, 0.006)),
        ("check", ["--registration-sd", "0.004", "0.01"], "registration", (0.004, 0.01)),
    ],
)
def test_values_may_be_typed_in_several_ways(name, typed, field, value, asked):
    assert getattr(asked(name, *NEEDED[name], *typed), field) == value


@pytest.mark.parametrize("typed", [["1", "1", "1.6"], ["1 1 1.6"], ["1,1,1.6"], ["1; 1; 1.6"]])
def test_the_start_of_a_plan_is_typed_with_commas_or_spaces(typed, asked):
    assert asked("plan", "--start", *typed, SCENE).site.start == (1.0, 1.0, 1.6)
    assert asked("plan", "--heights", "1", "1.6", SCENE).site.heights_m == (1.0, 1.6)


def test_what_follows_two_dashes_is_left_as_it_is(asked):
    assert asked("complete", "--", "--mode", "1").scans == ("--mode", "1")


@pytest.mark.parametrize(
    ("name", "typed", "words"),
    [
        ("scan", ["--at", "1,1"], "--at: '1,1' is not 3 finite numbers .*; write it like 1,1.5,2"),
        (
            "scan",
            ["--at", "1,1,1", "--units", "yards"],
            "--units: 'yards' is none of mm, cm, m, in, ft, us-ft",
        ),
        ("scan", ["--at", "1,1,1", "--up", "up"], "--up: 'up' is none of x, y, z"),
        ("plan", ["--spacing", "50cm"], "--spacing: '50cm' is no number; write metres, like 0.05"),
        ("plan", ["--max-incidence", "wide"], "'wide' is no number; write degrees, like 30"),
        ("plan", ["--views", "2.5"], "'2.5' is no number; write a whole number, like 3"),
        ("plan", ["--target", "99%"], "'99%' is no number; write a number, like 0.5"),
        ("check", ["--registration-sd", "1,2,3"], "both 0 or more; write it like 0.002,0.006"),
        ("check", ["--registration-sd", "-1"], "both 0 or more; write it like 0.002,0.006"),
    ],
)
def test_values_without_meaning_are_answered_with_what_to_write(name, typed, words, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    result = CliRunner().invoke(app, [name, *NEEDED[name], *typed])
    assert result.exit_code == 2
    assert re.search(words, result.stderr), result.stderr


def test_a_value_that_is_missing_is_a_usage_error():
    result = CliRunner().invoke(app, ["complete", SCAN, "--mode"])
    assert result.exit_code == 2
    assert "--inference" in result.stderr
