# SPDX-License-Identifier: MIT
"""Figures that README and the first steps quote agree with each other and with what the commands print."""

import re

import pytest
from typer.testing import CliRunner

from nbv.cli import app
from tests.helpers.data_paths import ROOT, data_path, requires_data

README, FIRST_STEPS = ROOT / "README.md", ROOT / "docs" / "first-steps.md"
_DEMO = re.compile(
    r"^(?:the scanner alone: |\d+ of these scans: |inferred .* of the true surface).*$", re.MULTILINE
)
_PUMP = re.compile(r"^(?:measured  |inferred  |unknown  |inferred where ).*$", re.MULTILINE)


def quotes(page, pattern):
    """Lines of a page that repeat what a command prints."""
    return pattern.findall(page.read_text("utf-8"))


def printed(*words):
    """What a command prints, run in this process."""
    result = CliRunner().invoke(app, [*words, "--threads", "1"])
    assert result.exit_code == 0, result.stderr
    return result.stdout


def test_both_pages_quote_the_same_demo():
    assert len(quotes(README, _DEMO)) == 3
    assert quotes(README, _DEMO) == quotes(FIRST_STEPS, _DEMO)


def test_the_prose_repeats_the_figures_of_the_demo():
    lines = " ".join(quotes(FIRST_STEPS, _DEMO))
    prose = FIRST_STEPS.read_text("utf-8").partition("Read the three lines")[2].partition("##")[0]
    for figure in re.findall(r"needs (\d+) views|(\d+\.\d) %", prose):
        assert re.search(rf"\b{re.escape(figure[0] or figure[1])}\b", lines), figure


@pytest.mark.long
def test_the_demo_prints_what_the_pages_quote(tmp_path):
    lines = printed("demo", "-o", str(tmp_path / "demo")).splitlines()
    assert [line for line in lines if _DEMO.match(line)] == quotes(README, _DEMO)


@pytest.mark.long
@requires_data
def test_the_pump_is_completed_as_the_first_steps_say(tmp_path):
    scan = str(data_path("range/e57/pumpA.e57"))
    lines = printed("complete", scan, "--texture", "off", "-o", str(tmp_path / "pump")).splitlines()
    assert [line for line in lines if _PUMP.match(line)] == quotes(FIRST_STEPS, _PUMP)
