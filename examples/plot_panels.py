# SPDX-License-Identifier: MIT
"""The light model of a scan: its facets, what was measured of them, and the folds in which they meet.

Run it with `python examples/plot_panels.py [SCAN...] [-o FOLDER]`: it completes each scan, or the built-in
office when none is given, and writes `panels_NAME.png`, seen from a step aside of the scanner, into
FOLDER/pictures (default: docs). Thin lines part facets, red ones surfaces; blue is what was inferred.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from completion import CompletionOptions, complete
from nbv import PinholeSensor, scan_scene
from nbv.report.figures.drawing import MeshDrawing
from nbv.report.figures.picture import aside_cameras
from scenes import Pose, RangeImage, builtin_scene, read_scan
from scenes.mesh.labelled_mesh import LabelledMesh

_SHAPE = (760, 1000)
_MEASURED, _INFERRED = (0.80, 0.80, 0.78), (0.42, 0.60, 0.92)
_FACET, _FOLD = 0.8, (0.78, 0.12, 0.12)  # brightness of the lines between facets; colour between surfaces


def office() -> RangeImage:
    """A scan of the built-in office."""
    camera = PinholeSensor(fov_deg=75, width=640, height=480)
    return scan_scene(builtin_scene("office"), Pose.looking_at((0.5, 0.5, 1.7), (4.0, 3.0, 0.8)), camera)


def plot(scan: RangeImage, path: Path, camera: int) -> str:
    """Complete a scan, draw its panels, and say how many there are."""
    done = complete(scan, CompletionOptions(texture=False), rng=0)
    panels = done.panels()
    vertices = done.world_from_reference.apply(panels.vertices)
    drawing = MeshDrawing(LabelledMesh(vertices, panels.faces.astype(np.int32), panels.face_surface))
    seen = drawing.look(aside_cameras(done.scans[0])[camera], _SHAPE)
    hit, face = seen.hit, np.maximum(seen.face, 0)
    image = np.ones((*_SHAPE, 3))
    colour = np.where(panels.is_measured[face][..., None], _MEASURED, _INFERRED)
    image[hit] = (colour * drawing.shade(seen)[..., None])[hit]
    image[_between(np.where(hit, face, -1))] *= _FACET
    image[_between(np.where(hit, panels.face_surface[face], 0))] = _FOLD
    Image.fromarray((image.clip(0, 1) * 255).astype(np.uint8)).save(path, optimize=True)
    pixels = done.observed_mesh()
    return f"{len(panels.faces)} facets, {len(panels.folds)} folds; {len(pixels.faces)} triangles of pixels"


def _between(number: np.ndarray) -> np.ndarray:
    """Pixels (rows, columns) beside one of another number."""
    line = np.zeros(number.shape, np.bool_)
    line[:, 1:] |= number[:, 1:] != number[:, :-1]
    line[1:] |= number[1:] != number[:-1]
    return line


def main(given: Sequence[str] | None = None) -> None:
    """Write the pictures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "scans", nargs="*", type=Path, help="scans to draw; the built-in office when none is given"
    )
    parser.add_argument("-o", "--out", type=Path, default=Path("docs"), help="folder of the pictures")
    parser.add_argument("--camera", type=int, default=0, choices=(0, 1), help="from which side")
    asked = parser.parse_args(given)
    pictures = asked.out / "pictures"
    pictures.mkdir(parents=True, exist_ok=True)
    scans = [(path.stem, read_scan(path)) for path in asked.scans] or [("office", office())]
    for name, scan in scans:
        print(f"{name}: {plot(scan, pictures / f'panels_{name}.png', asked.camera)}", flush=True)


if __name__ == "__main__":
    main()
