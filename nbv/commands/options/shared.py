# SPDX-License-Identifier: MIT
"""Options that several commands have, each declared once: name, help text, section, default and limits.

`nbv.cli` makes the commands from the dataclasses of this package; a command's work takes its dataclass.
Nothing slow is imported here. The words of a help text before its first colon, semicolon or full stop are the
option's meaning, the same in all commands.
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from nbv.commands.options.parsing import parse_bytes, parse_limits
from scenes.run.option import NOT_NEGATIVE, NumberRange, argument, choices, each, group, numbers, option

if TYPE_CHECKING:
    from scenes.io.scan_request import ScanRequest

Axis = Literal["x", "y", "z"]
SignedAxis = Literal["auto", "x", "y", "z", "-x", "-y", "-z"]
Units = Literal["mm", "cm", "m", "in", "ft", "us-ft"]
AUTO_OFF = ("auto", "off")
SCENE_HELP = "A mesh file, or builtin:NAME."
SCAN_HELP = "Files or RGB-D folders; PATH#k for one scan."

INFER_HELP = "Also complete the scans and use the inferred surface"
POSE_HELP = "Standard deviation of a pose"
INFERENCE_HELP = "How far surfaces are continued"

input_option = partial(option, section="input")
output_option = partial(option, section="output")
run_option = partial(option, section="run")

# Each dataclass takes a copy: a field belongs to one
SENSOR = input_option(
    "--sensor", "A sensor profile by name, or a TOML file.", "generic60", metavar="NAME|FILE"
)
NOISE = option(
    "--noise", "Noise model: none, gaussian-2mm, nguyen2012, ..., or profile, the sensor's own.", "none",
    metavar="NAME",
)  # fmt: skip
UP = input_option("--up", "Up axis of the file.", None, shown="z; y of GLB and glTF")
SCAN_UP = input_option("--up", "Up axis of the file; auto: estimated and reported.", "auto")
UNITS = input_option("--units", "Length unit of the file; `us-ft` is the US survey foot.", "m")
LEAST = option(
    "--least", "Smallest probability of a symmetry from which surface is inferred, with --backs.", 0.8,
    metavar="P", limits=NumberRange(least=0.5, most=1.0),
)  # fmt: skip
SCHEDULER = run_option(
    "--scheduler", "Address of a dask.distributed scheduler, or local:N for N processes here.", None,
    metavar="ADDRESS", shown="this process",
)  # fmt: skip
PART = run_option(
    "--part", "Every Nth scan or case from the Ith alone; a run without it then finishes.", None,
    metavar="I/N", shown="all",
)  # fmt: skip


@dataclass(frozen=True, kw_only=True, slots=True)
class Shared:
    """Options that every command has.

    `out` is the folder or file to write, the command's default when not given; `max_memory` is in bytes;
    `limits` hold sizes that files may have where these are not the defaults, by name
    (`scenes.io.checks.limits`).
    """

    out: Path | None = output_option(
        "--out -o", "Folder or file to write.", None, metavar="PATH", shown=False
    )
    as_json: bool = output_option("--json", "Print one JSON object on stdout, nothing else there.", False)
    quiet: bool = output_option("--quiet -q", "Print nothing.", False)
    seed: int = run_option("--seed", "Seed of all random numbers.", 0, limits=NOT_NEGATIVE)
    threads: int | None = run_option(
        "--threads", "Number of threads; results do not depend on it.", None, shown="all cores",
        limits=NumberRange(least=1),
    )  # fmt: skip
    max_memory: int | None = run_option(
        "--max-memory", "Memory limit, like 2GB; results do not depend on it.", None, metavar="SIZE",
        shown="no limit", parse=parse_bytes,
    )  # fmt: skip
    limits: Mapping[str, int] = field(
        default_factory=dict,
        metadata=run_option(
            "--limit", "Largest size of the contents of a file, like faces=200M; repeat it.", None,
            metavar="NAME=NUMBER", shown="see docs/guides/bad-input.md", is_repeated=True, parse=parse_limits,
        ).metadata,
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True, slots=True)
class ReadOptions:
    """How scans are read from their files."""

    origins: tuple[tuple[float, ...], ...] = input_option(
        "--origin", "Scanner's position in the file's units: for mere points; repeat it for each file.", (),
        metavar="X,Y,Z", shown="from the files", is_repeated=True, parse=each(numbers(3)),
    )  # fmt: skip
    intrinsics: tuple[float, ...] | None = input_option(
        "--intrinsics", "Intrinsics of depth images, pixels.", None, metavar="FX,FY,CX,CY",
        shown="from the files", parse=numbers(4),
    )  # fmt: skip
    depth_scale: float | None = input_option(
        "--depth-scale", "Depth values per unit.", None, shown="from the files"
    )
    poses: str | None = input_option(
        "--poses", "Poses, world from sensor, one per scan: a trajectory or a list of matrices.", None,
        metavar="FILE", shown="from the files",
    )  # fmt: skip
    trajectory: str | None = input_option(
        "--trajectory", "Times and places of a moving scanner: for points with times.", None, metavar="FILE",
        shown=False,
    )  # fmt: skip

    def request(self, paths: tuple[str, ...], units: Units, up: SignedAxis = "z") -> ScanRequest:
        """Return the scans of files, in the units and with the up axis that they have."""
        from scenes.io.scan_request import ScanRequest

        return ScanRequest(
            paths, self.intrinsics, self.depth_scale, self.poses, units=units, origins=self.origins,
            up=up, trajectory=self.trajectory,
        )  # fmt: skip


def before_option(what: str, *, shown: str | bool = False) -> Any:
    """Return the option that names an earlier result."""
    return input_option(
        "--before", f"An earlier result to compare with: {what}.", None, metavar="FILE", shown=shown
    )


def sigma_option(of: str, shown: str) -> Any:
    """Return the option that states how noisy the input is, `of` which kind of deviation."""
    return option(
        "--sigma", f"Standard deviation of the noise: {of}.", None, metavar="M", shown=shown,
        limits=NOT_NEGATIVE,
    )  # fmt: skip


def register_option(more: str = "scans that cannot be placed are left out") -> Any:
    """Return the option to register scans before anything else."""
    return option("--register", f"Register the scans first; {more}.", False)


def relations_option(example: str) -> Any:
    """Return the option for relations between surfaces."""
    return option(
        "--relations", f"Relations between surfaces ({example}): auto infers them, off does not, a FILE "
        "states and forbids some.", "auto", metavar="auto|off|FILE",
    )  # fmt: skip


def without_option(example: str) -> Any:
    """Return the option to leave out what has a name."""
    return option(
        "--without", f"Leave out objects with this name: {example}; repeat it.", (), metavar="PATTERN",
        shown=False, is_repeated=True,
    )  # fmt: skip


def export_option(what: str, known: tuple[str, ...]) -> Any:
    """Return the option for files of other formats."""
    return output_option(
        "--export", f"Also write a file of this format: {what}; repeat it.", (), metavar="|".join(known),
        shown=False, is_repeated=True, parse=choices(known),
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True, slots=True)
class NoOptions:
    """A command without options of its own."""


@dataclass(frozen=True, kw_only=True, slots=True)
class InfoOptions:
    """A file to describe."""

    file: str = argument("FILE", "Any file, or an output folder.")
    up: Axis | None = copy(UP)
    units: Units = copy(UNITS)
    read: ReadOptions = group(ReadOptions, ("origins", "poses"))
