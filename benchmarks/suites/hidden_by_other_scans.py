# SPDX-License-Identifier: MIT
"""Real scans: one frame completed alone, scored by what registered frames saw behind its occluders.

With `--pictures FOLDER` a picture of every frame: blue is right, orange wrong, yellow unknown, grey not
counted.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from PIL import Image

from benchmarks.cases.frames import DATA
from benchmarks.cases.rooms import hypothesis_of
from benchmarks.metrics.inferred import sample
from benchmarks.metrics.other_scans import BUFFERS_M, HiddenScore, score_by_others
from benchmarks.run import head, row, suite
from completion import CompletionOptions, complete
from completion.observe.user_options import Mode
from scenes import RangeImage, read_scan
from scenes.scan.colour import unit_colour

MODES: tuple[Mode, ...] = ("conservative", "standard", "bold")
SHOWN = {1: (0, 114, 178), -1: (213, 94, 0), 0: (240, 228, 66), 2: (150, 150, 150)}


@dataclass(frozen=True)
class DataSet:
    """Posed frames of one place, each of which is completed alone and scored by the others."""

    name: str
    n_frames: int
    intrinsics: tuple[float, float, float, float] | None = None
    depth_scale: float | None = None

    def scan(self, number: int) -> RangeImage:
        """Read one frame."""
        options: dict[str, Any] = {"intrinsics": self.intrinsics, "depth_scale": self.depth_scale}
        given = {key: value for key, value in options.items() if value is not None}
        return read_scan(DATA / "range" / f"{self.name}#{number}", **given)


SETS = (
    DataSet("icl_nuim", 5, (481.2, -480.0, 319.5, 239.5), 5000.0),
    DataSet("align3d_sample1", 6),
    DataSet("open3d_redwood", 5),
)


def score_frame(data: DataSet, frame: int, mode: Mode) -> tuple[HiddenScore, Image.Image]:
    """Complete a frame alone and score it; with a picture of what is right, wrong and unknown."""
    scan = data.scan(frame)
    others = [data.scan(number) for number in range(1, data.n_frames + 1) if number != frame]
    completed = complete(scan, CompletionOptions(mode=mode, texture=False), rng=0)
    samples = sample(hypothesis_of(completed, [scan]), 0.01)
    result = score_by_others([scan], others, samples)
    shown = np.full((*scan.shape, 3), 255, np.uint8)
    if scan.colour is not None:
        shown = (unit_colour(scan.colour) * 127 + 128).astype(np.uint8)
    pixels = scan.pixels(samples.points)
    inside = np.isfinite(pixels).all(axis=1)
    line, column = np.rint(pixels[inside]).astype(np.int64).T
    for state, colour in SHOWN.items():
        here = result.state[inside] == state
        shown[line[here], column[here]] = colour
    return result, Image.fromarray(shown)


def score_row(data: DataSet, frame: int, mode: Mode, result: HiddenScore) -> str:
    """A row of the table."""
    verdict = " decides nothing" if not result.unknown_share <= 0.7 else ""
    return row(
        f"{data.name} frame {frame}", mode, number(result.precision, 3), number(result.recall, 3),
        f"{number(result.unknown_share, 3)}{verdict}", f"{result.right_m2:.3f}", f"{result.wrong_m2:.3f}",
        f"{result.unknown_m2:.3f}", len(result.reference),
    )  # fmt: skip


def number(value: float, digits: int) -> str:
    """A figure, - where there is none."""
    return "-" if np.isnan(value) else f"{value:.{digits}f}"


def buffer_row(data: DataSet, frame: int, result: HiddenScore) -> str:
    """A row of the table of buffers."""
    cells = [
        f"{number(one.completeness, 2)} / {number(one.correctness, 2)} / {number(1e3 * one.accuracy_m, 0)}"
        for one in result.buffers
    ]
    return row(f"{data.name} frame {frame}", *cells)


@suite("hidden-by-other-scans", smallest="--frames 1 --modes standard --only open3d_redwood")
def hidden_by_other_scans(
    frames: int = 6,
    only: str = "",
    modes: str = "conservative,standard,bold",
    pictures: Annotated[Path | None, typer.Option(help="Folder of the pictures.")] = None,
) -> Iterator[str]:
    """Real scans: one frame completed alone, scored by what registered frames saw behind its occluders.

    --frames of each set; --only: a set; --modes of the first frame, of the others standard alone.
    """
    yield from head(
        "set | mode | precision | recall | unknown | right m2 | wrong m2 | unknown m2 | reference points"
    )
    buffers = []
    for data in (one for one in SETS if only in ("", one.name)):
        for frame in range(1, min(data.n_frames, frames) + 1):
            for mode in MODES:
                if mode not in (modes.split(",") if frame == 1 else ("standard",)):
                    continue
                result, picture = score_frame(data, frame, mode)
                yield score_row(data, frame, mode, result)
                if mode == "standard":
                    buffers.append(buffer_row(data, frame, result))
                    if pictures is not None:
                        pictures.mkdir(parents=True, exist_ok=True)
                        picture.quantize(64).save(pictures / f"{data.name}-{frame}.png", optimize=True)
    yield from (
        "",
        "Within buffers, standard mode: completeness / correctness / accuracy in millimetres.",
        "",
    )
    yield from head("set", *(f"{100 * one:.0f} cm" for one in BUFFERS_M))
    yield from buffers
