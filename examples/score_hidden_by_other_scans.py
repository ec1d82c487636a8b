# SPDX-License-Identifier: MIT
"""Real scans: one frame completed alone, scored by what registered frames saw behind its occluders.

Run it with `python examples/score_hidden_by_other_scans.py [FOLDER] [PICTURES]`: it writes
`hidden-by-other-scans.md` into the folder (default: docs), and a picture for each data set into the second
(default: out/hidden): blue is right, orange wrong, yellow unknown, grey not counted. The data are read from
UNSEEN_DATA (default ../shared/data).
"""

import os
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from completion import CompletionOptions, complete
from completion.evaluation.other_scans import HiddenScore, score_by_others
from completion.evaluation.samples import sample
from completion.limits import Mode
from nbv.evaluation.cases import hypothesis_of
from scenes import RangeImage, read_scan

MODES: tuple[Mode, ...] = ("conservative", "standard", "bold")
SHOWN = {1: (0, 114, 178), -1: (213, 94, 0), 0: (240, 228, 66), 2: (150, 150, 150)}
DATA = Path(os.environ.get("UNSEEN_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))


@dataclass(frozen=True)
class DataSet:
    """Posed frames of one place, each of which is completed alone and scored by the others."""

    name: str
    n_frames: int
    intrinsics: tuple[float, float, float, float] | None = None
    depth_scale: float | None = None

    def scan(self, number: int) -> RangeImage:
        """Read one frame."""
        options = {"intrinsics": self.intrinsics, "depth_scale": self.depth_scale}
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
    result = score_by_others(scan, others, samples)
    shown = np.full((*scan.shape, 3), 255, np.uint8)
    if scan.colour is not None:
        shown = (scan.colour * 127 + 128).astype(np.uint8)
    pixels = scan.pixels(samples.points)
    inside = np.isfinite(pixels).all(axis=1)
    row, column = np.rint(pixels[inside]).astype(np.int64).T
    for state, colour in SHOWN.items():
        here = result.state[inside] == state
        shown[row[here], column[here]] = colour
    return result, Image.fromarray(shown)


def line(data: DataSet, frame: int, mode: Mode, result: HiddenScore) -> str:
    """A row of the table."""
    verdict = "decides nothing" if not result.unknown_share <= 0.7 else ""
    return (
        f"| {data.name} frame {frame} | {mode} | {result.precision:.3f} | {result.recall:.3f} "
        f"| {result.unknown_share:.3f} {verdict} | {result.right_m2:.3f} | {result.wrong_m2:.3f} "
        f"| {result.unknown_m2:.3f} | {result.n_reference} |"
    )


def main(folder: Path, pictures: Path) -> None:
    """Score all data sets and write page and pictures."""
    for place in (folder, pictures):
        place.mkdir(parents=True, exist_ok=True)
    rows = []
    for data in SETS:
        for frame in range(1, data.n_frames + 1):
            for mode in MODES if frame == 1 else ("standard",):
                result, picture = score_frame(data, frame, mode)
                rows.append(line(data, frame, mode, result))
                print(rows[-1], flush=True)
                if (frame, mode) == (1, "standard"):
                    picture.quantize(64).save(pictures / f"{data.name}.png", optimize=True)
    page = HEAD + "\n\n" + TABLE + "\n".join(rows) + "\n"
    (folder / "hidden-by-other-scans.md").write_text(page, "utf-8")


HEAD = """<!-- Written by `python examples/score_hidden_by_other_scans.py`; do not edit. -->

# Real frames completed alone, scored by other frames

Counted is inferred area behind something in the frame and more than 10 cm from all that it measured. Right:
within 3 cm of a point of another frame; wrong: a beam of another frame goes through; unknown: neither.
Recall is the share of the other frames' points (one in each 2 cm) hidden from the frame and as far from its
own that have inferred area within 3 cm. A set of which more than 70 % is unknown decides nothing."""
TABLE = """| set | mode | precision | recall | unknown | right m2 | wrong m2 | unknown m2 | reference points |
|---|---|---|---|---|---|---|---|---|
"""

if __name__ == "__main__":
    given = [Path(text) for text in sys.argv[1:]]
    main(*given, *(Path("docs"), Path("out/hidden"))[len(given) :])
