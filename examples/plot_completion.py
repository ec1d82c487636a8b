# SPDX-License-Identifier: MIT
"""The gallery of completions: built-in scenes as measured, marked and completed, in docs/pictures.

Run it with `python examples/plot_completion.py [FOLDER]`.
"""

import io
import sys
from pathlib import Path

from PIL import Image

from completion import complete
from nbv import PinholeSensor, scan_scene
from nbv.report.completion_report import before_and_after
from nbv.report.page import Gallery
from scenes import Pose, builtin_scene

VIEWS = {
    "chair_before_wall": Pose.looking_at((0.5, -2.2, 1.5), (0.0, 0.8, 0.7)),
    "two_cylinders": Pose.looking_at((0.3, -2.6, 1.6), (0.0, 0.3, 0.8)),
    "textured_cylinder": Pose.looking_at((0.2, -2.4, 1.5), (0.0, 0.3, 0.9)),
    "two_occluders": Pose.looking_at((0.4, 0.4, 1.7), (4.0, 3.0, 0.8)),
}


def plot(name: str, folder: Path) -> None:
    """Complete one scan of a built-in scene and write its three pictures side by side."""
    sensor = PinholeSensor(fov_deg=65, width=480, height=400)
    completed = complete(scan_scene(builtin_scene(name), VIEWS[name], sensor), rng=0)
    (gallery,) = (block for block in before_and_after(completed) if isinstance(block, Gallery))
    measured, whole, marked, *_ = (Image.open(io.BytesIO(picture.png)) for picture in gallery.pictures)
    panels = [panel.convert("RGBA") for panel in (measured, marked, whole)]
    width, height = panels[0].size
    strip = Image.new("RGBA", (3 * width + 2 * 12, height), (255, 255, 255, 0))
    for column, panel in enumerate(panels):
        strip.alpha_composite(panel, (column * (width + 12), 0))
    strip.quantize(192).save(folder / f"{name}.png", optimize=True)
    print(
        f"{name}: measured {completed.observed_m2:.2f} m2, inferred {completed.hypothesised_m2:.2f} m2, "
        f"in observed free space {completed.free_space_violation_m2:.2g} m2"
    )


if __name__ == "__main__":
    target = Path(sys.argv[1] if len(sys.argv) > 1 else "docs/pictures")
    target.mkdir(parents=True, exist_ok=True)
    for scene_name in VIEWS:
        plot(scene_name, target)
