# SPDX-License-Identifier: MIT
"""Command line: `unseen` and its commands; nothing slow is imported before a command runs."""

from __future__ import annotations

import os
from typing import Any, NamedTuple

import typer
from typer.core import TyperGroup

from nbv.commands import options
from nbv.commands.command_line import command_of

_JOBS = """Scan what can be scanned, infer what cannot, and say which is which.

  plan      how many views does a scene need, where, and what do they miss?
            unseen plan builtin:two_occluders -o out/plan
  complete  what is behind the chair? surfaces continued, textured, marked as inferred
            unseen complete scan.e57 -o out/completed
  coverage  which surface did these stations measure well enough, and why not the rest?
            unseen coverage room.glb --plan out/plan/plan.json -o out/coverage

All of it at once: unseen demo -o out/demo      All commands: unseen --help
Many of them, overnight: unseen study STUDY.toml    Tab completion: unseen --install-completion"""


class Command(NamedTuple):
    """A command: its options, the function that does the work ("module:function"), and its help."""

    options: type
    work: str
    short: str
    long: str
    without: tuple[str, ...] = ()  # options of `Shared` that it does not have


COMMANDS = {
    "demo": Command(
        options.DemoOptions,
        "demo:run_demo",
        "All of it on a built-in room: plan, scan, complete, report.",
        "Plan, scan, complete, texture and report on a built-in room with two occluders.",
    ),
    "scan": Command(
        options.ScanOptions,
        "scan:run_scan",
        "One simulated scan of a scene.",
        "Take a simulated scan of a scene, or one per pose: -o FILE.npz, .ply, .pcd, .ptx, .e57, .las ...",
    ),
    "plan": Command(
        options.PlanOptions,
        "plan:run_plan",
        "Where to scan from, and how much that measures.",
        "Plan views of a scene, or the next station after scans: plan.json, coverage.json, report.html.",
    ),
    "coverage": Command(
        options.CoverageOptions,
        "coverage:run_coverage",
        "Which surface was measured well enough, and why not.",
        "Report which surface was measured well enough: coverage.json, .csv, .ply and report.html.",
    ),
    "study": Command(
        options.StudyOptions,
        "study:run_study_file",
        "Scenes x sensors x requirements x planners x seeds.",
        "Plan scenes x sensors x requirements x planners x seeds; run again to continue.",
    ),
    "complete": Command(
        options.CompleteOptions,
        "complete:run_complete",
        "Continue surfaces behind their occluders.",
        "Continue surfaces behind occluders: completed.glb, .ply files, decisions.csv, report.html.",
    ),
    "texture": Command(
        options.TextureOptions,
        "texture:run_texture",
        "Fill a hole in an image, or grow a texture.",
        "Fill a hole in an image, or grow a texture from it, by Efros-Leung sampling.",
    ),
    "fit": Command(
        options.FitOptions,
        "fit:run_fit",
        "Fit a surface to points, with its uncertainty.",
        "Fit a surface to points: JSON with parameters and standard deviations on stdout, in metres.\n\n"
        "A patch is a free-form surface, connected, tangent or orthogonal to those of --between FILE.",
    ),
    "part": Command(
        options.PartOptions,
        "part:run_part",
        "Surfaces of a part, and the relations between them.",
        "Divide a part into planes, spheres, cylinders, cones and tori: part.json, part.ply, report.html.\n\n"
        "Relations between them (parallel, coaxial, equal radii) are inferred, tested and imposed: "
        "relations.json.",
    ),
    "feature": Command(
        options.FeatureCommandOptions,
        "feature:run_feature",
        "Doorways, rows of holes, junctions, stairs: fitted whole.",
        "Find objects by their known form: features.json, features.ply, report.html.\n\n"
        "Each is fitted whole to its visible fragments and accepted or refused with a reason; unseen "
        "sides are marked. An interrupt keeps the best results so far.",
    ),
    "register": Command(
        options.RegisterOptions,
        "register:run_register",
        "Poses of scans, without initial poses.",
        "Find the relative poses of scans: registration.json, posed/, report.html.\n\n"
        "A pose is reported only if no alternative fits nearly as well; otherwise the report shows all "
        "possible poses.",
    ),
    "info": Command(
        options.InfoOptions,
        "info:run_info",
        "Contents of a scene, a scan or another file.",
        "Describe a file or an output folder, with warnings; -o FILE.json writes the description.",
    ),
    "warm": Command(
        options.WarmOptions,
        "warm:run_warm",
        "Compile all inner loops now, as for a container image.",
        "Compile all inner loops and store them, so that no later command has to; see NUMBA_CACHE_DIR.",
        without=("out", "seed", "max_memory", "limits"),
    ),
}


class _Commands(TyperGroup):
    """Commands with flags that are False when not given; to read None as a flag typer loads pydantic."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        for option in self.get_params(ctx):
            if getattr(option, "is_flag", False) and option.default is None:
                option.default = False
        return super().parse_args(ctx, args)


app = typer.Typer(
    name="unseen",
    cls=_Commands,
    help="Scan what can be scanned, infer what cannot, and say which is which.",
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)


@app.callback(invoke_without_command=True)
def _jobs(context: typer.Context) -> None:
    if context.invoked_subcommand is None:
        typer.echo(_JOBS)


for _name, _command in COMMANDS.items():
    app.command(_name, short_help=_command.short, help=_command.long)(
        command_of(_name, _command.options, f"nbv.commands.{_command.work}", _command.without)
    )


def main() -> None:
    """Run `unseen`."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # threads are ours; each of its own reserves memory
    app()


if __name__ == "__main__":
    main()
