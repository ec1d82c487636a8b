# SPDX-License-Identifier: MIT
"""Options: every documented option is there with its default, and each is declared once for all callers."""

from dataclasses import fields

import pytest
import typer.main
from typer.testing import CliRunner

from completion.export.decisions import TOLERANCE_M
from completion.observe.user_options import UserOptions
from completion.options import CompletionOptions
from nbv.cli import COMMANDS, app
from nbv.commands.complete import completion_options
from nbv.commands.options.scans import CompleteOptions
from nbv.cover.pipeline import CoverOptions
from nbv.run.plan_options import RequirementOptions, SearchOptions
from nbv.study.spec import PlannerEntry, RequirementEntry
from nbv.visibility.requirement import Requirement
from scenes.checks import InputError

SHARED = "out seed=0 json quiet threads max-memory limit"
DOCUMENTED = {
    "review": "port=0 open=yes sensor=generic60",
    "demo": "",
    "scan": "at look poses sensor=generic60 noise=none returns no-truth format part scheduler up units=m "
    "trajectory rate position-sd=0.0 angle-sd=0.0 clock=0.0",
    "plan": "method=nbv sensor=generic60 max-incidence=60.0 max-range min-density max-sd "
    "registration-sd=0.0 averaging-radius=0.0 k=1 target=0.99 views mode rooms=all without "
    "outdoors all-round heights spacing clearance=0.3 start several-heights candidates scans "
    "intrinsics depth-scale poses origin before region keep-out noise=none polish-steps=100000 "
    "time-budget overlap infer scheduler trajectory up units=m budget set-up=3.0 scan-time "
    "walking-speed=1.0",
    "coverage": "plan scans register intrinsics depth-scale poses origin sensor=generic60 "
    "max-incidence=60.0 max-range min-density max-sd registration-sd=0.0 averaging-radius=0.0 k=1 "
    "mode rooms=all without outdoors all-round heights spacing "
    "clearance=0.3 inference=standard trajectory up units=m",
    "check": "tolerance registration-sd align=yes only without false-alarms=0.05 no-return=unknown infer "
    "next sensor=generic60 loa before bcf=3.0 sigma register origin intrinsics depth-scale poses trajectory "
    "units=m design-units up",
    "study": "part scheduler",
    "complete": "inference=standard sigma projector inferred-sd=0.02 flatness min-area kinds "
    "registration-sd=0.005 keep-poses register resolution origin edits relations=auto features=auto "
    "flatten backs least=0.8 texture=auto export export-units=m rely=0.01 observed=auto scheduler intrinsics "
    "depth-scale poses trajectory units=m up=auto",
    "texture": "mask grow window order=paper surface",
    "fit": "shape=auto metric=euclidean robust rays origin radius axis between export units=m",
    "part": "relations=auto sigma ignore-labels preferred=tell backs least=0.8 flatten export units=m",
    "feature": "find given evaluations=200000 origin intrinsics depth-scale poses trajectory units=m up=auto",
    "register": "upright poses check level=0.01 origin intrinsics depth-scale units=m up=auto",
    "info": "up units=m intrinsics depth-scale trajectory",
    "warm": "",
}
"""Options of the commands before they were declared once, with the defaults that help showed."""


@pytest.mark.parametrize("name", DOCUMENTED)
def test_every_documented_option_is_there_with_its_default(name):
    command = typer.main.get_command(app).commands[name]
    options = {flag: entry for entry in command.params for flag in entry.opts if flag.startswith("--")}
    shared = {"warm": "json quiet threads", "review": SHARED.replace("out ", "")}.get(name, SHARED)
    documented = f"{DOCUMENTED[name]} {shared}".split()
    for text in documented:
        flag, _, default = text.partition("=")
        assert options[f"--{flag}"].help, flag
        if default:
            assert str(options[f"--{flag}"].default) == default, flag
    assert set(options) == {f"--{text.partition('=')[0]}" for text in documented}


def test_every_command_is_documented_here():
    assert set(COMMANDS) == set(DOCUMENTED)


def test_a_python_call_takes_the_defaults_of_the_command_line():
    asked = completion_options(CompleteOptions(scans=("scan.npz",)))
    assert asked == CompletionOptions(features=asked.features)
    assert CompleteOptions(scans=()).tolerance_m == TOLERANCE_M
    assert SearchOptions().polish_steps == CoverOptions().polish_steps


def test_a_study_takes_the_declared_options_and_defaults():
    for kind, entry in (
        (RequirementOptions, RequirementEntry()),
        (SearchOptions, PlannerEntry(method="nbv")),
    ):
        for declared in fields(kind):
            if declared.name not in ("method", "polish_steps", "time_budget_s"):
                assert getattr(entry, declared.name) == declared.default
    assert RequirementEntry(k=2).requirement() == Requirement(k=2)


def test_declared_limits_hold_on_the_command_line_and_in_python(tmp_path):
    for name in ("sigma_m", "max_sd_m", "min_area_m2", "registration_m"):
        with pytest.raises(InputError, match=f"{name} must be 0 or more, got -1"):
            UserOptions(**{name: -1})
        flag = next(entry for entry in fields(UserOptions) if entry.name == name).metadata["option"].flags
        result = CliRunner().invoke(app, ["complete", "scan.npz", flag, "-1", "-o", str(tmp_path)])
        assert result.exit_code == 2
        assert "greater than or equal to 0" in result.stderr
