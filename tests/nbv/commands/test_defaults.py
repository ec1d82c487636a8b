# SPDX-License-Identifier: MIT
"""Defaults of a project: `unseen.toml` beside the work, below what is typed."""

import pytest
from typer.testing import CliRunner

from nbv.cli import app
from nbv.commands import complete as complete_module
from nbv.commands import plan as plan_module


@pytest.fixture
def asked(monkeypatch, tmp_path):
    """Run a command in a folder with such a file; what its work was asked."""
    monkeypatch.chdir(tmp_path)
    found = {}

    def keep(shared, options):
        found.update(shared=shared, options=options)

    monkeypatch.setattr(complete_module, "run_complete", keep)
    monkeypatch.setattr(plan_module, "run_plan", keep)

    def run(text, *words):
        (tmp_path / "unseen.toml").write_text(text)
        result = CliRunner().invoke(app, list(words))
        return result, found.get("shared"), found.get("options")

    return run


FILE = """
[all]
threads = 3
seed = 7
[complete]
seed = 1
up = "z"
export = ["svg", "ifc"]
backs = true
least = 0.9
origin = ["1,2,3"]
[plan]
views = 2
"""


def test_options_of_the_file_hold_where_none_is_typed(asked):
    result, shared, how = asked(FILE, "complete", "scan.npz")
    assert result.exit_code == 0, result.output
    assert (shared.threads, shared.seed) == (3, 1)  # a command's own table goes before [all]
    assert (how.up, how.exports, how.backs, how.least) == ("z", ("svg", "ifc"), True, 0.9)
    assert how.read.origins == ((1.0, 2.0, 3.0),)


def test_what_is_typed_goes_before_the_file(asked):
    words = ("complete", "scan.npz", "--up", "y", "--export", "dxf", "--threads", "1")
    _, shared, how = asked(FILE, *words)
    assert (how.up, how.exports, shared.threads, shared.seed) == ("y", ("dxf",), 1, 1)


def test_help_shows_the_defaults_of_the_project(asked):
    result, *_ = asked(FILE, "plan", "--help")
    text = " ".join(result.output.split())
    assert "Largest number of views; --method cover chooses the ones that measure most. [default: 2" in text


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("[complete]\nexports = 'svg'", "[complete] has no option 'exports'"),
        ("[completed]\nup = 'z'", "[completed] is no command"),
        ("up = 'z'", "[up] is no command"),
        ("[complete]\nup = {a = 1}", "up of [complete] is a text"),
        ("[complete", "cannot be read as TOML"),
        ("[complete]\nup = 'w'", "--up"),
        ("[all]\nthreads = 0", "--threads"),
    ],
)
def test_a_file_that_means_nothing_is_refused(asked, text, told):
    result, shared, _ = asked(text, "complete", "scan.npz")
    assert result.exit_code == 2
    assert told in result.output
    assert shared is None
