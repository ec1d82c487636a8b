# SPDX-License-Identifier: MIT
"""Drawings of a scanned room: its floor plan as SVG, and its DXF as another program draws it.

Run it with `python examples/plot_exchange.py [SCAN...] [-o FOLDER]`: it completes the scans together, or a
scan all round the built-in room with two occluders (2 mm of noise) when none is given, and writes
`exchange_plan.svg` and `exchange_dxf.png` into FOLDER/pictures (default: docs). The second shows plan and
sections of the DXF, drawn by ezdxf.
"""

import argparse
import tempfile
from collections.abc import Sequence
from pathlib import Path

import ezdxf
import matplotlib as mpl
from ezdxf.addons.drawing import Frontend, RenderContext
from ezdxf.addons.drawing.config import BackgroundPolicy, Configuration
from ezdxf.addons.drawing.matplotlib import MatplotlibBackend
from matplotlib.figure import Figure

from completion import CompletionOptions, complete
from nbv import View, load_sensor, scan_scene
from scenes import Pose, RangeImage, builtin_scene, read_scan

_FLAT = ("PLAN", "SECTION", "TEXT")  # first words of the layers that are drawn


def room() -> RangeImage:
    """A scan all round the built-in room with two occluders."""
    view = View(Pose.looking_at((2.0, 3.6, 1.5), (6.0, 2.5, 1.5)), load_sensor("panorama"))
    return scan_scene(builtin_scene("two_occluders"), view, noise="gaussian-2mm", rng=0)


def draw(path: Path, picture: Path) -> str:
    """Read a DXF, draw its plan and sections, and say what it holds."""
    document = ezdxf.readfile(path)
    space, found = document.modelspace(), document.audit()
    figure = Figure(figsize=(7, 7))
    axes = figure.add_axes((0, 0, 1, 1))
    config = Configuration(background_policy=BackgroundPolicy.WHITE)
    Frontend(RenderContext(document), MatplotlibBackend(axes), config=config).draw_layout(
        space, filter_func=lambda entity: entity.dxf.layer.split("-")[0] in _FLAT
    )
    figure.savefig(picture, dpi=110, bbox_inches="tight", metadata={"Software": None})
    counts = {kind: len(space.query(kind)) for kind in ("3DFACE", "POLYLINE", "LWPOLYLINE", "POINT")}
    return f"{len(found.errors)} errors; {counts}"


def main(given: Sequence[str] | None = None) -> None:
    """Write the pictures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scans", nargs="*", type=Path, help="scans; of the built-in room when none is given")
    parser.add_argument("-o", "--out", type=Path, default=Path("docs"), help="folder of the pictures")
    asked = parser.parse_args(given)
    pictures = asked.out / "pictures"
    pictures.mkdir(parents=True, exist_ok=True)
    mpl.use("Agg")
    scans = [read_scan(path) for path in asked.scans] or [room()]
    done = complete(scans, CompletionOptions(texture=False), rng=0)
    done.export(pictures / "exchange_plan.svg")
    with tempfile.TemporaryDirectory() as folder:
        done.export(Path(folder, "model.dxf"))
        print(draw(Path(folder, "model.dxf"), pictures / "exchange_dxf.png"), flush=True)


if __name__ == "__main__":
    main()
