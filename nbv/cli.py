# SPDX-License-Identifier: MIT
"""Command line: `unseen`, its commands made from dataclasses of options (`scenes.run.option`).

Nothing slow is imported before a command runs.
"""

from __future__ import annotations

import io
import math
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import MISSING, Field, fields
from importlib import import_module
from inspect import Parameter, Signature
from pathlib import Path
from typing import Annotated, Any, NamedTuple, get_type_hints

import typer
from typer.core import TyperCommand, TyperGroup

from nbv.commands.defaults import project_defaults
from nbv.commands.options import planning, scans, shapes, shared
from nbv.commands.options.shared import Shared
from nbv.commands.typed import OLD_NAMES, Typed, put_right
from scenes.run.option import Option


def command_of(name: str, command: Command) -> Callable[..., None]:
    """Return the typer command of a dataclass of options.

    It makes that and `Shared` of what was typed, asks the options' `check` where there is one, imports the
    module of the work and calls the function with both.
    """
    kind, without = command.options, command.without

    def run(**typed: Any) -> None:
        try:
            common = _build_options(Shared, typed, without)
            options = _build_options(kind, typed)
        except ValueError as error:  # an InputError: options that no work can take
            raise typer.BadParameter(str(error)) from None
        check = getattr(options, "check", None)
        if check is not None:
            check()
        module, function = command.work.split(":")
        getattr(import_module(f"nbv.commands.{module}"), function)(common, options)

    parameters = [
        _parameter(entry, hint, hidden=key in command.idle)
        for key, (entry, hint) in command.entries().items()
    ]
    parameters.sort(key=lambda parameter: parameter.default is not Parameter.empty)
    run.__name__ = name
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    run.__annotations__["return"] = None
    run.__signature__ = Signature(parameters)  # type: ignore[attr-defined]  # functions may have one: PEP 362
    return run


def _entries(kind: type, without: tuple[str, ...] = ()) -> Iterator[tuple[str, tuple[Field[Any], Any]]]:
    """Yield the options of a dataclass and of the groups in it: name, field and type."""
    hints = get_type_hints(kind)
    for entry in fields(kind):
        if "group" in entry.metadata:
            yield from _entries(entry.metadata["group"], entry.metadata["without"])
        elif "option" in entry.metadata and entry.name not in without:
            yield entry.name, (entry, hints[entry.name])


def _parameter(entry: Field[Any], hint: Any, *, hidden: bool) -> Parameter:
    """Return a function's parameter that typer takes for the option of a field."""
    declared: Option = entry.metadata["option"]
    default = None if entry.default is MISSING else entry.default
    is_required = entry.default is MISSING and entry.default_factory is MISSING
    if declared.is_negated:
        default = False
    elif declared.is_repeated:
        hint = list[str] if is_required else list[str] | None
        default = None
    elif declared.parse is not None:
        hint = str if is_required or isinstance(default, str) else str | None
        default = default if isinstance(default, str) else None
    more: dict[str, Any] = {"help": declared.help, "show_default": declared.shown, "hidden": hidden}
    metavar = declared.metavar or ("N" if Typed.of(declared, hint).number else None)
    if metavar is not None:
        more["metavar"] = metavar
    limits = declared.limits
    if limits.above is None:
        more |= {"min": limits.least, "max": limits.most}
    flags = declared.flags.split()
    info = typer.Option(*flags, **more) if flags else typer.Argument(**more)
    return Parameter(
        entry.name,
        Parameter.POSITIONAL_OR_KEYWORD,
        default=Parameter.empty if is_required else default,
        annotation=Annotated[hint, info],
    )


def _build_options(kind: type, typed: Mapping[str, Any], without: tuple[str, ...] = ()) -> Any:
    """Return a dataclass of options from what was typed; a text without meaning is a usage error."""
    values: dict[str, Any] = {}
    for entry in fields(kind):
        if "group" in entry.metadata:
            values[entry.name] = _build_options(entry.metadata["group"], typed, entry.metadata["without"])
        elif "option" in entry.metadata and entry.name not in without and typed[entry.name] is not None:
            values[entry.name] = _value(entry.metadata["option"], typed[entry.name])
    return kind(**values)


def _value(declared: Option, typed: Any) -> Any:
    """Return the value of an option from what was typed."""
    if declared.is_negated:
        return not typed
    if isinstance(typed, float) and not math.isfinite(typed):
        unit = " of metres" if declared.metavar == "M" else ""
        raise typer.BadParameter(f"{declared.flags} is a finite number{unit}, got {typed:g}")
    if declared.parse is None:
        return tuple(typed) if declared.is_repeated else typed
    try:
        return declared.parse(typed)
    except ValueError as error:
        hint = declared.flags.split()[0] if declared.flags else declared.metavar
        raise typer.BadParameter(str(error), param_hint=hint) from None


_SECTIONS = ("arguments", "input", "method", "output", "run")
_JOBS = """Scan what can be scanned, infer what cannot, and say which is which.

  plan      how many views does a scene need, where, and what do they miss?
            unseen plan builtin:two_occluders -o out/plan
  complete  what is behind the chair? surfaces continued, textured, marked as inferred
            unseen complete scan.e57 -o out/completed
  coverage  which surface did these stations measure well enough, and why not the rest?
            unseen coverage room.glb --plan out/plan/plan.json -o out/coverage
  check     is it built as designed? within tolerance, deviating, missing, or hidden, and by what
            unseen check house.ifc s1.e57 s2.e57 --tolerance 0.010 -o out/check

All of it at once: unseen demo -o out/demo      All commands: unseen --help
Many of them, overnight: unseen study STUDY.toml    Tab completion: unseen --install-completion"""


class Command(NamedTuple):
    """A command: its options, the function that does the work ("module:function"), its help and examples.

    It does not have the options of `Shared` that it is `without`; those that are `idle` change nothing in
    it: they are taken, but help does not show them.
    """

    options: type
    work: str
    short: str
    long: str
    examples: tuple[str, ...]
    without: tuple[str, ...] = ()
    idle: tuple[str, ...] = ()

    def entries(self) -> dict[str, tuple[Field[Any], Any]]:
        """Return its options by the names of their fields: field and type."""
        return {**dict(_entries(self.options)), **dict(_entries(Shared, self.without))}

    def typed(self) -> dict[str, Typed]:
        """Return how the values of its options are typed, by the options' names."""
        return {
            flag: Typed.of(entry.metadata["option"], hint)
            for entry, hint in self.entries().values()
            if hint is not bool
            for flag in entry.metadata["option"].flags.split()
        }


COMMANDS = {
    "demo": Command(
        shared.NoOptions,
        "demo:run_demo",
        "All commands on a built-in room: plan, scan, complete, report.",
        "Plan, scan, complete, texture and report on a built-in room with two occluders.",
        ("unseen demo -o out/demo",),
    ),
    "scan": Command(
        planning.ScanOptions,
        "scan:run_scan",
        "One simulated scan of a scene.",
        "Take a simulated scan of a scene, or one per pose: -o FILE.npz, .ply, .pcd, .ptx, .e57, .las ...",
        (
            "unseen scan builtin:chair_before_wall --at 0.4,-1.7,1.2 --look 0,0.8,0.7 -o scan.npz",
            "unseen scan hall.glb --poses plan.json --sensor leica_p40 --noise profile -o scans.e57",
        ),
    ),
    "plan": Command(
        planning.PlanOptions,
        "plan:run_plan",
        "Where to scan from, and how much that measures.",
        "Plan views of a scene, or the next station after scans: plan.json, coverage.json, report.html.",
        (
            "unseen plan hall.glb --sensor panorama --method cover -o out/plan",
            "unseen plan hall.glb --method cover --budget 2h --start 4.2,1.5",
            "unseen plan --scans s1.e57 --scans s2.e57 --views 2 -o out/next",
        ),
    ),
    "coverage": Command(
        planning.CoverageOptions,
        "coverage:run_coverage",
        "Which surface was measured well enough, and why not.",
        "Report which surface was measured well enough: coverage.json, .csv, .ply and report.html.",
        (
            "unseen coverage hall.glb --plan out/plan/plan.json -o out/coverage",
            "unseen coverage --scans s1.e57 --scans s2.e57 --min-density 400 --k 2",
        ),
    ),
    "check": Command(
        scans.CheckCommandOptions,
        "check:run_check",
        "Is each element of a design there, and within tolerance?",
        "Check scans against a design: check.json, elements.csv, issues.bcf, design.glb, report.html.\n\n"
        "Each element is within its tolerance, deviates, is missing, hidden (by what, from where), not seen "
        "or undecided; each deviation has its 95 % interval.",
        (
            "unseen check house.ifc s1.e57 s2.e57 --tolerance 0.010 -o out/check",
            'unseen check house.ifc s1.e57 --tolerance 0.010 --tolerance "IfcDoor*=0.005" --only "IfcDoor*"',
        ),
        idle=("seed",),
    ),
    "study": Command(
        planning.StudyOptions,
        "study:run_study_file",
        "Compare planners over scenes, sensors, requirements and seeds.",
        "Plan each combination of scenes, sensors, requirements, planners and seeds; run again to continue.",
        (
            "unseen study STUDY.toml -o out/study",
            "unseen study STUDY.toml --part 3/16 -o out/study",
        ),
    ),
    "complete": Command(
        scans.CompleteOptions,
        "complete:run_complete",
        "Continue surfaces behind their occluders.",
        "Continue surfaces behind occluders: completed.glb, .ply files, decisions.csv, report.html.",
        (
            "unseen complete scan.e57 -o out/completed",
            "unseen complete s1.e57 s2.e57 --register --export ifc --rely 0.005",
            "unseen complete scan.npz --inference conservative --texture off",
        ),
    ),
    "review": Command(
        scans.ReviewOptions,
        "review:run_review",
        "Correct a completion on a page that shows what follows.",
        "Serve a page on this machine to correct a finished completion: say what you know, see what follows "
        "from it, take it or not, save.",
        ("unseen review out/completed",),
        without=("out",),
        idle=("seed",),
    ),
    "texture": Command(
        scans.TextureOptions,
        "texture:run_texture",
        "Fill a hole in an image, or grow a texture.",
        "Fill a hole in an image, or grow a texture from it, by Efros-Leung sampling.",
        (
            "unseen texture wall.png --mask hole.png -o filled.png",
            "unseen texture brick.png --grow 256x256 -o bricks.png",
        ),
    ),
    "fit": Command(
        shapes.FitOptions,
        "fit:run_fit",
        "Fit a surface to points, with its uncertainty.",
        "Fit a surface to points: JSON with parameters and standard deviations on stdout, in metres.\n\n"
        "A patch is a free-form surface, connected, tangent or orthogonal to those of --between FILE.",
        (
            "unseen fit pipe.ply --shape cylinder --robust",
            "unseen fit scan.e57#2 --rays --radius 0.0725",
        ),
        idle=("seed", "threads"),
    ),
    "part": Command(
        shapes.PartOptions,
        "part:run_part",
        "Surfaces of a part, and the relations between them.",
        "Divide a part into planes, spheres, cylinders, cones and tori: part.json, part.ply, report.html.\n\n"
        "Relations between them (parallel, coaxial, equal radii) are inferred, tested and imposed: "
        "relations.json. --backs infers sides that no scan saw: backs.ply.",
        ("unseen part bracket.stl --units mm --export step -o out/bracket",),
        idle=("threads",),
    ),
    "feature": Command(
        shapes.FeatureCommandOptions,
        "feature:run_feature",
        "Doorways, rows of holes, junctions, stairs: fitted whole.",
        "Find objects by their known form: features.json, features.ply, report.html.\n\n"
        "Each is fitted whole to its visible fragments and accepted or refused with a reason; unseen "
        "sides are marked. An interrupt keeps the best results so far.",
        ("unseen feature scan.e57 --find doorway --find window -o out/features",),
    ),
    "register": Command(
        scans.RegisterOptions,
        "register:run_register",
        "Poses of scans, without initial poses.",
        "Find the relative poses of scans: registration.json, posed/, report.html.\n\n"
        "A pose is reported only if no alternative fits nearly as well; otherwise the report shows all "
        "possible poses.",
        (
            "unseen register s1.e57 s2.e57 s3.e57 -o out/registered",
            "unseen register s1.e57 s2.e57 --check",
        ),
        idle=("seed",),
    ),
    "info": Command(
        shared.InfoOptions,
        "info:run_info",
        "Contents of a scene, a scan or another file.",
        "Describe a file or an output folder, with warnings; -o FILE.json writes the description.",
        (
            "unseen info scan.e57",
            "unseen info out/plan --json",
        ),
        idle=("seed", "threads"),
    ),
    "warm": Command(
        shared.NoOptions,
        "warm:run_warm",
        "Compile all inner loops now, as for a container image.",
        "Compile all inner loops and store them, so that no later command has to; see NUMBA_CACHE_DIR.",
        ("unseen warm --threads 2",),
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

    def format_epilog(self, ctx: Any, formatter: Any) -> None:  # noqa: ARG002  # as typer calls it
        _write_examples(formatter, [command.examples[0] for command in COMMANDS.values()])


def _write_examples(formatter: Any, lines: Sequence[str]) -> None:
    with formatter.section("Examples"):
        for line in lines:
            formatter.write(f"{'':{formatter.current_indent}}{line}\n")


class _Command(TyperCommand):
    """A command whose help has sections and ends with examples, and which says what to write."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        try:
            args = put_right(args, self._made_of.typed(), OLD_NAMES.get(self.name or ""))
        except typer.BadParameter as error:
            error.ctx = ctx
            raise
        return super().parse_args(ctx, args)

    @property
    def _made_of(self) -> Command:
        return COMMANDS[self.name or ""]

    def format_options(self, ctx: Any, formatter: Any) -> None:
        entries = self._made_of.entries()
        rows: dict[str, list[tuple[str, str]]] = {name: [] for name in _SECTIONS}
        for parameter in self.get_params(ctx):
            row = parameter.get_help_record(ctx)
            declared = entries[parameter.name][0].metadata["option"] if parameter.name in entries else None
            if row is None:
                continue
            if declared is not None and not declared.flags:
                rows["arguments"].append((parameter.metavar or "", row[1]))
            else:
                rows["run" if declared is None else declared.section].append(row)
        for name, held in rows.items():
            if held:
                with formatter.section(name.capitalize()):
                    formatter.write_dl(held)

    def format_epilog(self, ctx: Any, formatter: Any) -> None:  # noqa: ARG002  # as typer calls it
        _write_examples(formatter, self._made_of.examples)


app = typer.Typer(
    name="unseen",
    cls=_Commands,
    help="Scan what can be scanned, infer what cannot, and say which is which.",
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": sys.maxsize},
)


def _print_version(is_asked_for: bool) -> None:  # as typer calls it
    if is_asked_for:
        from nbv.run.manifest import version_of

        typer.echo(f"unseen {version_of('unseen')}")
        raise typer.Exit


@app.callback(invoke_without_command=True)
def _jobs(
    context: typer.Context,
    *,
    _version: Annotated[
        bool, typer.Option("--version", help="Print the version.", callback=_print_version, is_eager=True)
    ] = False,
) -> None:
    if context.invoked_subcommand is None:
        typer.echo(_JOBS)
    else:
        context.default_map = project_defaults(Path.cwd(), _option_names(context.command))


def _option_names(commands: Any) -> dict[str, dict[str, str]]:
    """For each command the parameters of its options by their long names."""
    return {
        name: {
            flag.removeprefix("--"): parameter.name
            for parameter in command.params
            for flag in parameter.opts
            if flag.startswith("--")
        }
        for name, command in commands.commands.items()
    }


for _name, _command in COMMANDS.items():
    app.command(_name, cls=_Command, short_help=_command.short, help=_command.long)(
        command_of(_name, _command)
    )


def main() -> None:
    """Run `unseen`."""
    for stream in (sys.stdout, sys.stderr):  # names may hold what the encoding of a pipe cannot
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # threads are ours; each of its own reserves memory
    app()


if __name__ == "__main__":
    main()
