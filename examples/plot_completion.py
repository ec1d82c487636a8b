# SPDX-License-Identifier: MIT
"""The gallery of completions: before and after, of built-in scenes and of real scans.

Run it with `python examples/plot_completion.py [NAME...] [-o FOLDER]`: it completes one scan of each scene,
writes its picture into FOLDER/pictures and, when no names are given, the page
`results/completion-gallery.md` into FOLDER (default: docs). Real scans are read from UNSEEN_DATA (default
../shared/data) and left out where it is absent; of them the shape alone is drawn, for
pictures of others' data stay out of the docs.
"""

import argparse
import io
import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from PIL import Image

from completion import Completion, CompletionOptions, complete
from nbv import PinholeSensor, scan_scene
from nbv.report.blocks.page import Gallery
from nbv.report.completion_report import before_and_after
from nbv.report.figures.completion_shots import ModelDrawings
from nbv.report.figures.picture import Camera, aside_cameras
from scenes import Pose, RangeImage, builtin_scene
from scenes.io.scan_request import ScanRequest, read_request

_GAP, _WIDTH = 12, 600
_COLOURS = 160  # of a picture's palette


@dataclass(frozen=True)
class BuiltIn:
    """A built-in scene, the place it is scanned from, and what to look for."""

    name: str
    eye: tuple[float, float, float]
    target: tuple[float, float, float]
    look_for: str

    def scan(self) -> RangeImage:
        """Scan it without noise."""
        sensor = PinholeSensor(fov_deg=65, width=480, height=400)
        return scan_scene(builtin_scene(self.name), Pose.looking_at(self.eye, self.target), sensor)


@dataclass(frozen=True)
class Real:
    """A real scan, its origin, the camera of `aside_cameras` that shows most, and what to look for."""

    name: str
    path: str
    origin: str
    camera: int
    look_for: str
    intrinsics: tuple[float, ...] | None = None
    depth_scale: float | None = None


BUILT_IN = (
    BuiltIn(
        "chair_before_wall",
        (0.5, -2.2, 1.5),
        (0.0, 0.8, 0.7),
        "The bricks go on behind the slats, the gravel under the seat.",
    ),
    BuiltIn(
        "two_cylinders",
        (0.3, -2.6, 1.6),
        (0.0, 0.3, 0.8),
        "The paper's figure 9: a board cuts both cylinders in two; the parts of each are one surface.",
    ),
    BuiltIn(
        "textured_cylinder",
        (0.2, -2.4, 1.5),
        (0.0, 0.3, 0.9),
        "The paper's figure 10: the bricks of the column go on behind the board, and round its back.",
    ),
    BuiltIn(
        "engaged_column",
        (0.6, -2.4, 1.5),
        (0.0, 0.9, 0.8),
        "The half column goes on behind the board, and ends at the wall that it is engaged in.",
    ),
    BuiltIn(
        "pipe_rack",
        (0.7, -2.6, 1.5),
        (-0.05, 0.9, 0.9),
        "Pipes go on behind the cabinet and behind one another.",
    ),
    BuiltIn("two_occluders", (0.4, 0.4, 1.7), (4.0, 3.0, 0.8), "A room with two boxes, from its corner."),
)
REAL = (
    Real(
        "office1",
        "range/pcl/office1.pcd",
        "Point Cloud Library, BSD-3",
        0,
        "Wall and floor go on behind desk and chair, and behind the boxes in the recess.",
    ),
    Real(
        "align3d",
        "range/align3d_sample1#1",
        "align3d, MIT",
        0,
        "The wall behind the chair, down to the floor, and the floor beside it.",
    ),
    Real(
        "redwood",
        "range/open3d_redwood#1",
        "Open3D, MIT",
        0,
        "Wall and floor behind chair, curtain and door frame.",
    ),
    Real(
        "pumpA",
        "range/e57/pumpA.e57",
        "pye57 and libE57, MIT",
        0,
        "The floor and the plinths under the pumps; pipes and motors close around their backs and end where "
        "beams passed.",
    ),
    Real(
        "nyu_dining",
        "range/nyu_dining#1",
        "NYU Depth, by slambook2",
        0,
        "The floor under table and chairs, and the moats of the projector's shadow round them.",
        intrinsics=(518.0, 519.0, 325.5, 253.5),
        depth_scale=1000.0,
    ),
    Real(
        "living_room",
        "range/align3d_sample2#1",
        "align3d, MIT",
        1,
        "The floor behind armchair and table, the wall behind the plant; straight at the edge of the view.",
    ),
    Real(
        "icl_nuim",
        "range/icl_nuim#1",
        "ICL-NUIM, by slambook2",
        0,
        "Walls and floor behind sofa, table and lamp.",
        intrinsics=(481.2, -480.0, 319.5, 239.5),
        depth_scale=5000.0,
    ),
    Real(
        "arcade",
        "range/tdtk#1",
        "3DTK, Osnabrueck",
        1,
        "An arcade by a laser scanner: the floor is still in pieces, and little is continued.",
    ),
    Real(
        "tins",
        "range/mOSD/learn33.pcd",
        "mOSD",
        0,
        "The table top behind boxes and tins.",
    ),
)


def plot_built_in(scene: BuiltIn, folder: Path) -> str:
    """Write measured, marked and completed side by side; return the line of figures."""
    completed = complete(scene.scan(), rng=0)
    (gallery,) = (block for block in before_and_after(completed) if isinstance(block, Gallery))
    measured, whole, marked, *_ = (Image.open(io.BytesIO(picture.png)) for picture in gallery.pictures)
    write_strip([measured, marked, whole], folder / f"{scene.name}.png")
    return figures(completed)


def plot_real(real: Real, data: Path, folder: Path) -> str:
    """Write the shape as measured and with what is inferred marked; return the line of figures."""
    asked = ScanRequest(
        (str(data / real.path),), intrinsics=real.intrinsics, depth_scale=real.depth_scale, up="auto"
    )
    (scan,) = read_request(asked).scans
    completed = complete(scan, CompletionOptions(texture=False), rng=0)
    stage = ModelDrawings.of(completed, in_colour=False)
    camera: Camera = aside_cameras(scan)[real.camera]
    pictures = stage.shoot(camera, "")
    measured, _, marked = (Image.open(io.BytesIO(picture.png)) for picture in pictures)
    write_strip([measured, marked], folder / f"completion_{real.name}.png")
    return figures(completed)


def write_strip(panels: Sequence[Image.Image], path: Path) -> None:
    """Write pictures side by side, on a see-through ground, with a small palette."""
    height = round(_WIDTH * panels[0].height / panels[0].width)
    strip = Image.new("RGBA", (len(panels) * (_WIDTH + _GAP) - _GAP, height), (255, 255, 255, 0))
    for column, panel in enumerate(panels):
        small = panel.convert("RGBA").resize((_WIDTH, height), Image.Resampling.LANCZOS)
        strip.alpha_composite(small, (column * (_WIDTH + _GAP), 0))
    strip.quantize(_COLOURS).save(path, optimize=True)


def figures(completed: Completion) -> str:
    """What was measured, inferred, and inferred against the evidence."""
    return (
        f"Measured {completed.observed_m2:.2f} m2, inferred {completed.hypothesised_m2:.2f} m2, "
        f"of which in observed free space {completed.free_space_violation_m2:.2g} m2."
    )


def main(given: Sequence[str] | None = None) -> None:
    """Write the pictures asked for, or all of them and their page."""
    parser = argparse.ArgumentParser(description="Before and after completion: pictures and their page.")
    parser.add_argument("names", nargs="*", help="scenes to draw; all of them when none is named")
    parser.add_argument("-o", "--out", type=Path, default=Path("docs"), help="folder of the page")
    asked = parser.parse_args(given)
    data = Path(os.environ.get("UNSEEN_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))
    pictures = asked.out / "pictures"
    pictures.mkdir(parents=True, exist_ok=True)
    jobs = [(scene, f"{scene.name}.png", partial(plot_built_in, scene, pictures)) for scene in BUILT_IN]
    jobs += [
        (real, f"completion_{real.name}.png", partial(plot_real, real, data, pictures))
        for real in REAL
        if (data / real.path.split("#")[0]).exists()
    ]
    sections: dict[type, list[str]] = {BuiltIn: [HEAD], Real: [REAL_HEAD]}
    for scene, picture, plot in jobs:
        if not asked.names or scene.name in asked.names:
            line = plot()
            print(f"{scene.name}: {line}", flush=True)
            sections[type(scene)].append(section_of(scene, picture, line))
    if not asked.names and len(sections[Real]) > 1:
        text = "\n\n".join(part for parts in sections.values() for part in parts)
        (asked.out / "results").mkdir(exist_ok=True)
        (asked.out / "results" / "completion-gallery.md").write_text(text + "\n", "utf-8")


def section_of(scene: BuiltIn | Real, picture: str, line: str) -> str:
    """The part of the page about one scene."""
    origin = f" Scan: {scene.origin}." if isinstance(scene, Real) else ""
    return (
        f"### {scene.name}\n\n![{scene.look_for}](../pictures/{picture})\n\n{scene.look_for} {line}{origin}"
    )


HEAD = """<!-- Written by `python examples/plot_completion.py`; do not edit. -->

# Before and after

Each picture is seen from a step aside of the one scan that was completed, in standard mode, so that what lay
behind the occluders comes into view. Marked blue is what was inferred; where it is hatched nothing is known.
`python examples/plot_completion.py` writes pictures and page.

## Built-in scenes

Measured; completed, what is inferred in blue; completed, what is inferred in its texture. Like the paper's
figures 9 and 10."""
REAL_HEAD = """## Real scans

Measured, and completed with what is inferred in blue; measured area is grey, for shape alone is drawn. All
real scans by an earlier version and by this one, with what is wrong counted: [before and
after](real-scans.md)."""

if __name__ == "__main__":
    main()
