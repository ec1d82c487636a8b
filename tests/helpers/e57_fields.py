# SPDX-License-Identifier: MIT
"""E57 files with any fields: scans of a box room, written node by node as other programs do."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenes.io.clouds.e57_writer import _begin, _structure

SIZE, STATION = np.array([5.0, 4.0, 2.7]), np.array([2.9, 1.3, 1.5])
Bounds = tuple[float, float] | None


def room_points(azimuths: NDArray[Any], elevations: NDArray[Any]) -> NDArray[Any]:
    """Points (rows, columns, 3) of the room's inside, from the station, in its frame; angles in degrees."""
    around, up = np.meshgrid(np.radians(azimuths), np.radians(elevations))
    rays = np.stack([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)], axis=-1)
    with np.errstate(divide="ignore"):
        reach = np.maximum(-STATION / rays, (SIZE - STATION) / rays).min(axis=-1)
    return np.asarray(rays * reach[..., None])


@dataclass
class Record:
    """A scan to be written.

    Attributes
    ----------
    fields : dict of (n,) arrays
        Floats become doubles, integers integers.
    bounds : dict
        Least and largest value of a field's node; None for none.
    scales : dict
        Steps of fields that become scaled integers.
    limits : dict
        What the scan's `colorLimits` say.
    pose : (quaternion w, x, y, z, translation), optional
    """

    fields: dict[str, NDArray[Any]]
    bounds: dict[str, Bounds] = field(default_factory=dict)
    scales: dict[str, float] = field(default_factory=dict)
    limits: dict[str, float] = field(default_factory=dict)
    pose: tuple[Sequence[float], Sequence[float]] | None = ((1, 0, 0, 0), tuple(STATION))
    name: str = "theirs"


def grid_fields(points: NDArray[Any], first: int = 0) -> dict[str, NDArray[Any]]:
    """Coordinates and pixels of points (rows, columns, 3), which begin at row and column `first`."""
    row, column = np.mgrid[: points.shape[0], : points.shape[1]].reshape(2, -1)
    return {
        **{f"cartesian{axis}": points[..., k].ravel() for k, axis in enumerate("XYZ")},
        "rowIndex": row + first,
        "columnIndex": column + first,
    }


def write_records(path: Path, records: Sequence[Record]) -> Path:
    """Write scans with the fields that they have."""
    import pye57

    lib = pye57.libe57
    file = lib.ImageFile(str(path), "w")
    data3d = _begin(lib, file)
    for number, record in enumerate(records):
        node = lib.StructureNode(file)
        node.set("guid", lib.StringNode(file, f"{{{number}}}"))
        node.set("name", lib.StringNode(file, record.name))
        if record.limits:
            node.set("colorLimits", _structure(lib, file, record.limits))
        if record.pose is not None:
            pose = lib.StructureNode(file)
            for key, letters, values in zip(
                ("rotation", "translation"), ("wxyz", "xyz"), record.pose, strict=True
            ):
                pose.set(key, _structure(lib, file, dict(zip(letters, map(float, values), strict=True))))
            node.set("pose", pose)
        prototype, buffers, n_points = lib.StructureNode(file), lib.VectorSourceDestBuffer(), 0
        columns = {
            name: np.ascontiguousarray(
                values, "q" if values.dtype == np.int64 else None
            )  # "l" means int32 there
            for name, values in record.fields.items()
        }
        for name, values in columns.items():
            prototype.set(name, _node(lib, file, values, record.bounds.get(name), record.scales.get(name)))
            n_points = len(values)
            buffers.append(lib.SourceDestBuffer(file, name, values, n_points, True, True))
        points = lib.CompressedVectorNode(file, prototype, lib.VectorNode(file, True))
        node.set("points", points)
        data3d.append(node)
        if n_points:
            writer = points.writer(buffers)
            writer.write(n_points)
            writer.close()
    file.close()
    return path


def _node(lib: Any, file: Any, values: NDArray[Any], bounds: Bounds, scale: float | None) -> Any:
    if scale is not None:
        return lib.ScaledIntegerNode(file, 0, -(2**31), 2**31 - 1, scale, 0.0)
    if values.dtype.kind == "f":
        single = lib.E57_SINGLE if values.dtype == np.float32 else lib.E57_DOUBLE
        return lib.FloatNode(file, 0.0, single, *(bounds or ()))
    low, high = bounds or (int(values.min(initial=0)), int(values.max(initial=0)))
    return lib.IntegerNode(file, int(low), int(low), int(high))
