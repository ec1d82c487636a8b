# SPDX-License-Identifier: MIT
"""A small house checked against its design: what is off, missing and hidden, on its plan.

Run it with `python examples/plot_check.py [-o FOLDER] [--report FOLDER]`: it scans a house with a wall 20 mm
off, a door that is missing and a wall behind crates (2 mm of noise), checks the scans against the design,
prints each verdict with its reason, and writes `check_plan.png` into FOLDER/pictures (default: docs). With
`--report` it writes all files of a check there.
"""

import argparse
import io
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from nbv import CheckedDesign, check_design, scan_scene
from nbv.report.blocks.check_tables import numbered
from nbv.report.blocks.verdict_plans import verdict_plans
from nbv.report.check_report import check_page
from nbv.scanning.sensor import SphericalSensor
from scenes import Pose, RangeImage, Scene
from scenes.mesh.design import Element, ElementMesh
from scenes.mesh.labelled_mesh import LabelledMesh

Box = tuple[tuple[float, float, float], tuple[float, float, float]]
DESIGN: Mapping[str, list[Box]] = {
    "IfcSlab floor": [((-0.3, -0.3, -0.3), (7.5, 3.3, 0.0))],
    "IfcSlab ceiling": [((-0.3, -0.3, 2.5), (7.5, 3.3, 2.8))],
    "IfcWall south": [((-0.3, -0.3, 0.0), (7.5, 0.0, 2.5))],
    "IfcWall north": [((-0.3, 3.0, 0.0), (7.5, 3.3, 2.5))],
    "IfcWall west": [((-0.3, 0.0, 0.0), (0.0, 3.0, 2.5))],
    "IfcWall east": [((7.2, 0.0, 0.0), (7.5, 3.0, 2.5))],
    "IfcWall partition": [
        ((4.0, 0.0, 0.0), (4.15, 0.8, 2.5)), ((4.0, 1.9, 0.0), (4.15, 3.0, 2.5)),
        ((4.0, 0.8, 2.1), (4.15, 1.9, 2.5)),
    ],
    "IfcDoor of the bath": [((1.8, 2.0, 0.0), (1.84, 2.9, 2.1))],
    "IfcColumn column": [((5.8, 0.5, 0.0), (6.1, 0.8, 2.5))],
    "IfcFurniture shelf": [((0.05, 0.05, 0.0), (1.6, 0.4, 1.8))],
}  # fmt: skip
"""Elements of the design: boxes by their least and largest corners, metres."""
MOVED = {"IfcWall south": (0.0, 0.02, 0.0)}
"""By how much elements were built off their places, metres."""
REMOVED = ("IfcDoor of the bath",)
CRATES: list[Box] = [((6.5, 0.02, 0.0), (7.0, 2.98, 2.45))]
"""What stands before the eastern wall."""
PLACES = ((1.0, 1.6, 1.5), (3.2, 1.2, 1.5), (4.9, 2.3, 1.5), (5.1, 1.1, 1.5))
_QUADS = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])


def mesh_of(boxes: Sequence[Sequence[Box]]) -> LabelledMesh:
    """A mesh with a surface for each sequence of boxes, outside outside."""
    corners, faces, surface = [], [], []
    for number, several in enumerate(boxes):
        for ends in several:
            low, high = np.array(ends)
            triangles = np.concatenate([_QUADS[:, [0, 1, 2]], _QUADS[:, [0, 2, 3]]]) + 8 * len(corners)
            corners.append([np.where([bit & 4, bit & 2, bit & 1], high, low) for bit in range(8)])
            faces.append(triangles)
            surface += [number] * 12
    return LabelledMesh(
        np.concatenate(corners), np.concatenate(faces).astype(np.int32), np.array(surface, np.int32)
    )


def design() -> ElementMesh:
    """The design, as an IFC file would give it."""
    elements = [
        Element(name.partition(" ")[2], name.partition(" ")[0], storey="Ground floor") for name in DESIGN
    ]
    return ElementMesh(mesh_of(list(DESIGN.values())), tuple(elements), "house")


def built() -> Scene:
    """The house as it was built, with the crates."""
    boxes = [
        [tuple(tuple(np.add(end, MOVED.get(name, (0, 0, 0)))) for end in box) for box in several]
        for name, several in DESIGN.items()
        if name not in REMOVED
    ]
    mesh = mesh_of([*boxes, CRATES])
    return Scene.from_mesh(mesh, name="house", mode="room")


def scans() -> list[RangeImage]:
    """A scan from each place, with 2 mm of noise."""
    sensor = SphericalSensor(
        azimuth_span_deg=360.0, elevation_min_deg=-70.0, elevation_max_deg=70.0, width=720, height=280,
        name="panorama", max_range_m=12.0,
    )  # fmt: skip
    house, taken = built(), []
    for k, place in enumerate(PLACES):
        pose = Pose.looking_at(place, np.array(place) + (1.0, 0.3, 0.0))
        taken.append(scan_scene(house, pose, sensor, noise="gaussian-2mm", rng=k))
    return taken


def checked_house() -> CheckedDesign:
    """The scans checked against the design at 10 mm."""
    return check_design(design(), scans(), tolerance_m=0.01)


def main(given: Sequence[str] | None = None) -> None:
    """Print the verdicts and write the picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--out", type=Path, default=Path("docs"), help="folder of the pictures")
    parser.add_argument("--report", type=Path, help="folder for the files of the check")
    asked = parser.parse_args(given)
    checked = checked_house()
    for one in checked.elements:
        print(f"{one.verdict:10} {one.element.ifc_class} {one.element.name}: {one.sentence}", flush=True)
    pictures = asked.out / "pictures"
    pictures.mkdir(parents=True, exist_ok=True)
    (plan,) = verdict_plans(checked.findings, numbered(checked.findings))
    drawn = Image.open(io.BytesIO(plan.png)).convert("RGBA")
    Image.alpha_composite(Image.new("RGBA", drawn.size, "white"), drawn).save(pictures / "check_plan.png")
    if asked.report is not None:
        checked.save(asked.report)
        check_page(checked, "house").write(asked.report / "report.html")


if __name__ == "__main__":
    main()
