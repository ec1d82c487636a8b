# SPDX-License-Identifier: MIT
"""The IFC file of a scanned house, opened and tessellated by another program, ifcopenshell.

Run it with `python examples/plot_ifc.py [FILE.ifc] [-o FOLDER]`: it draws the elements of a file, or of two
storeys of two rooms (a scan in each, 2 mm of noise) when none is given, without ceilings and spaces, and
writes `ifc.png` into FOLDER/pictures (default: docs). Walls and slabs that were seen from
both sides are bodies; blue was inferred. It needs `pip install ifcopenshell`, and does nothing without it.
"""

import argparse
import importlib.util
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np

from completion import CompletionOptions, complete
from nbv import scan_scene
from nbv.scanning.sensor import SphericalSensor
from scenes import Pose, RayCaster, Scene

_HIDDEN = ("IfcSpace", "IfcCovering", "IfcOpeningElement")
_WIDTH, _SMOOTH = 1000, 2  # pixels of the picture; how many samples there are along each
_LIGHT = np.array([0.35, -0.5, 0.8]) / np.linalg.norm([0.35, -0.5, 0.8])
_HIGH, _SLAB, _PARTITION, _OUTER = 2.5, 0.3, 0.15, 0.4  # metres, of the house
_PLACES = ((1.6, 1.4, 1.3), (5.4, 1.7, 1.4), (1.7, 1.3, 4.1), (5.6, 1.3, 4.2))


def house() -> Scene:
    """Two storeys of two rooms, with partitions of 15 cm, a door in each, and a slab of 30 cm."""
    left, end, top, outside = 4.0, 7.15, 2 * _HIGH + _SLAB, -_OUTER
    boxes = []
    for low, high in ((outside, 0), (_HIGH, _HIGH + _SLAB), (top, top + _OUTER)):
        boxes.append(((outside, outside, low), (end + _OUTER, 3 + _OUTER, high)))
    for low in (0, _HIGH + _SLAB):
        for y, z in (((0, 1), (0, _HIGH)), ((1.9, 3), (0, _HIGH)), ((1, 1.9), (2, _HIGH))):
            boxes.append(((left, y[0], low + z[0]), (left + _PARTITION, y[1], low + z[1])))
        top = low + _HIGH
        boxes += [((x, 0, low), (x + _OUTER, 3, top)) for x in (outside, end)]
        boxes += [((outside, y, low), (end + _OUTER, y + _OUTER, top)) for y in (outside, 3.0)]
    boxes.append(((1.2, 0, 0), (2.4, 0.5, 1.8)))  # a cupboard
    corners, faces = [], []
    side = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    for k, ends in enumerate(boxes):
        low, high = np.array(ends, dtype=float)
        corners += [np.where([bit & 4, bit & 2, bit & 1], high, low) for bit in range(8)]
        faces += [(8 * k + quad[list(part)]).tolist() for quad in side for part in ((0, 1, 2), (0, 2, 3))]
    return Scene.from_mesh((np.array(corners), np.array(faces)), name="house", mode="room")


def export(path: Path) -> None:
    """Scan the house from the middle of each room, complete the scans together, write an IFC file."""
    sensor = SphericalSensor(
        azimuth_span_deg=360.0, elevation_min_deg=-70.0, elevation_max_deg=70.0, width=720, height=280,
        name="panorama", max_range_m=12.0,
    )  # fmt: skip
    scene, scans = house(), []
    for k, place in enumerate(_PLACES):
        pose = Pose.looking_at(place, np.array(place) + (1.0, 0.3, 0.0))
        scans.append(scan_scene(scene, pose, sensor, noise="gaussian-2mm", rng=k))
    complete(scans, CompletionOptions(texture=False), rng=0).export(path)


def triangles(path: Path, hidden: Sequence[str]) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield the corners (n, 3, 3) and colours (n, 3) of the elements of a file, by ifcopenshell."""
    import ifcopenshell  # only this example needs it
    import ifcopenshell.geom

    model = ifcopenshell.open(path)
    print(dict(Counter(one.is_a() for one in model.by_type("IfcElement"))), flush=True)
    settings = ifcopenshell.geom.settings()
    settings.set("use-world-coords", True)
    for element in model.by_type("IfcProduct"):
        if element.Representation is None or element.is_a() in hidden:
            continue
        shape = ifcopenshell.geom.create_shape(settings, element).geometry
        vertices, faces = np.reshape(shape.verts, (-1, 3)), np.reshape(shape.faces, (-1, 3))
        colours = np.array([one.diffuse.components for one in shape.materials])
        yield vertices[faces], colours[np.array(shape.material_ids)]


def drawn(corners: np.ndarray, colours: np.ndarray, azimuth_deg: float, elevation_deg: float) -> np.ndarray:
    """An image (rows, columns, 3) of triangles from a direction, without perspective, edges in dark."""
    a, e = np.radians([azimuth_deg, elevation_deg])
    back = np.array([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)])
    right = np.array([-np.sin(a), np.cos(a), 0.0])
    up = np.cross(back, right)
    places = corners.reshape(-1, 3)
    low, high = (np.array([f(places @ right), f(places @ up)]) for f in (np.min, np.max))
    step = (high[0] - low[0]) * 1.04 / (_WIDTH * _SMOOTH)
    columns, rows = np.ceil((high - low) * 1.04 / step).astype(int)
    u = low[0] - 0.02 * np.ptp([low[0], high[0]]) + step * np.arange(columns)
    v = high[1] + 0.02 * np.ptp([low[1], high[1]]) - step * np.arange(rows)
    far = float((places @ back).max()) + 1.0
    origins = (u[None, :, None] * right + v[:, None, None] * up + far * back).reshape(-1, 3)
    caster = RayCaster(places, np.arange(len(places)).reshape(-1, 3))
    hits = caster.first_hit(origins, np.tile(-back, (len(origins), 1)))
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal = across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)
    normal *= np.where(normal @ back < 0, -1.0, 1.0)[:, None]
    shade = 0.55 + 0.45 * np.clip(normal @ _LIGHT, 0, 1)
    image = np.ones((rows * columns, 3))
    image[hits.hit] = (colours * shade[:, None])[hits.face[hits.hit]]
    image = image.reshape(rows, columns, 3)
    depth = np.where(hits.hit, hits.ranges, far + 50).reshape(rows, columns)
    turned = np.where(hits.hit[:, None], normal[hits.face], 0).reshape(rows, columns, 3)
    for axis in (0, 1):
        edge = np.abs(np.diff(depth, axis=axis)) > 0.12
        edge |= np.linalg.norm(np.diff(turned, axis=axis), axis=2) > 0.3
        image[: edge.shape[0], : edge.shape[1]][edge] *= 0.45
    size = (_WIDTH, int(rows / _SMOOTH))
    return np.asarray(cv2.resize((255 * image).astype(np.uint8), size, interpolation=cv2.INTER_AREA))


def main(given: Sequence[str] | None = None) -> None:
    """Write the picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file", nargs="?", type=Path, help="an IFC file; that of the house otherwise")
    parser.add_argument("-o", "--out", type=Path, default=Path("docs"), help="folder of the pictures")
    parser.add_argument("--azimuth", type=float, default=-60.0, help="to the viewer, degrees from +x")
    parser.add_argument("--elevation", type=float, default=50.0, help="of the viewer, degrees")
    parser.add_argument("--hide", action="append", default=[], help="a further class that is left out")
    asked = parser.parse_args(given)
    if importlib.util.find_spec("ifcopenshell") is None:
        print("ifcopenshell is not installed, nothing was drawn: pip install ifcopenshell")
        return
    pictures = asked.out / "pictures"
    pictures.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        path = asked.file or Path(folder, "house.ifc")
        if asked.file is None:
            export(path)
        found = list(triangles(path, (*_HIDDEN, *asked.hide)))
    corners, colours = (np.concatenate(one) for one in zip(*found, strict=True))
    image = drawn(corners, colours, asked.azimuth, asked.elevation)
    cv2.imwrite(str(pictures / "ifc.png"), image[:, :, ::-1])


if __name__ == "__main__":
    main()
