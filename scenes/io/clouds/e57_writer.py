# SPDX-License-Identifier: MIT
"""E57 writer: structured scans in double precision, and clouds of inferred points marked as such."""

from __future__ import annotations

import hashlib
import os
import uuid
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenes.checks import ArrayValue, ColourArray, FloatArray, InputError
from scenes.io.clouds.e57 import INFERRED, E57File
from scenes.io.formats.facts import FormatFacts
from scenes.io.formats.format import Format, each_cloud, each_scan
from scenes.io.formats.grid_fit import SCANNER_FROM_SENSOR
from scenes.io.formats.header import scan_header
from scenes.io.formats.returns import cloud_of
from scenes.pose import quaternion_of
from scenes.run.atomic import atomic_path, encodable, json_text
from scenes.run.libraries import import_extra
from scenes.scan.range_image import RangeImage

EXTENSION = ("unseen", "https://unseen.invalid/e57/inferred/1")
"""Prefix and name of the fields that E57 itself does not know."""
_RANGES = {"surface": (0, 65535), "provenance": (0, 255)}


@dataclass(frozen=True, slots=True, eq=False)
class InferredPoints(ArrayValue):
    """Points that nobody measured.

    Attributes
    ----------
    name : str
        Of the cloud, which in the file begins with "inferred".
    points : (n, 3) float
        World coordinates, metres.
    colour : (n, 3) uint8
        sRGB.
    surface, provenance : (n,) int
        As in hypothesised.ply.
    confidence, sd : (n,) float
        Probability that the surface is there, and predicted deviation in metres.
    legend : dict
        What the provenances mean.
    """

    name: str
    points: FloatArray
    colour: ColourArray
    surface: NDArray[np.int32]
    provenance: NDArray[np.int32]
    confidence: FloatArray
    sd: FloatArray
    legend: dict[str, str]

    def columns(self) -> dict[str, Any]:
        """Return one array a field."""
        prefix = EXTENSION[0]
        columns: dict[str, Any] = {
            f"cartesian{axis}": np.ascontiguousarray(self.points[:, k]) for k, axis in enumerate("XYZ")
        }
        for k, name in enumerate(("Red", "Green", "Blue")):
            columns[f"color{name}"] = np.ascontiguousarray(self.colour[:, k])
        columns[f"{prefix}:surface"] = np.ascontiguousarray(self.surface, dtype=np.uint16)
        columns[f"{prefix}:provenance"] = np.ascontiguousarray(self.provenance, dtype=np.uint8)
        columns[f"{prefix}:confidence"] = np.ascontiguousarray(self.confidence, dtype=np.float32)
        columns[f"{prefix}:sd"] = np.ascontiguousarray(self.sd, dtype=np.float32)
        return columns

    def description(self) -> dict[str, Any]:
        """Return what the cloud's description says, ready for JSON."""
        return {
            "format": INFERRED,
            "warning": "nobody measured these points: they were inferred from knowledge of shape",
            "provenance": self.legend,
            "fields": {
                f"{EXTENSION[0]}:surface": "number of the surface in completion.json",
                f"{EXTENSION[0]}:provenance": "why it is there, see provenance",
                f"{EXTENSION[0]}:confidence": "probability that the surface is there",
                f"{EXTENSION[0]}:sd": "predicted standard deviation along the normal, metres",
            },
        }


def content_guid(*parts: bytes) -> str:
    """Return an E57 guid that depends on the content alone, so that the same scan gives the same bytes."""
    return "{" + str(uuid.UUID(bytes=hashlib.sha256(b"".join(parts)).digest()[:16])) + "}"


def field_node(lib: Any, image_file: Any, name: str) -> Any:
    """Return the node of one of the extension's fields in the record of a point."""
    bounds = _RANGES.get(name.partition(":")[2])
    if bounds is None:
        return lib.FloatNode(image_file, 0.0, lib.E57_SINGLE)
    return lib.IntegerNode(image_file, 0, *bounds)


_PICKS = {"Minimum": np.min, "Maximum": np.max}
_ENDS = tuple(_PICKS)
_CHANNELS = ("Red", "Green", "Blue")
_RETURNS = ("returnIndex", "returnCount")


def write_e57(scans: Sequence[RangeImage], path: Path, inferred: Sequence[InferredPoints] = ()) -> None:
    """Write `scans` as structured E57: every return with rowIndex, columnIndex, and colour where known.

    Scans with further returns also have returnIndex, from 0, and returnCount, as ASTM E2807 names them.

    Coordinates are double in the scanner's frame (z up), the pose is the scan's; projection, noise and name
    go as JSON into the scan's description. pye57's own writer rounds to single precision and draws random
    identifiers, so the nodes are built here. Inferred points follow as clouds of their own, without grid and
    pose, marked in name and description; their fields that E57 does not know belong to an extension.

    Raises InputError: nothing to write, or a scan without any return, which E57 cannot hold as a grid.
    """
    if not scans and not inferred:
        raise InputError("there is no scan to write")
    lib = import_extra("pye57", "e57").libe57
    with atomic_path(path) as temporary, _library_writes(lib, path):
        image_file = lib.ImageFile(os.fsencode(temporary), "w")
        try:
            data3d = _begin(lib, image_file)
            if inferred:
                image_file.extensionsAdd(*EXTENSION)
            parts: tuple[Sequence[RangeImage | InferredPoints], ...] = (scans, inferred)
            for clouds in parts:
                for index in range(len(clouds)):  # an iterator would hold one scan while it makes the next
                    _append(lib, image_file, data3d, clouds[index])
        finally:
            image_file.close()


def _append(lib: Any, image_file: Any, data3d: Any, cloud: RangeImage | InferredPoints) -> None:
    """Write a scan, or inferred points, after those that are there."""
    columns = _columns(cloud) if isinstance(cloud, RangeImage) else cloud.columns()
    data3d.append(_scan_node(lib, image_file, cloud, columns))
    _write_columns(lib, image_file, data3d[len(data3d) - 1]["points"], columns)


@contextmanager
def _library_writes(lib: Any, path: Path) -> Iterator[None]:
    """Turn what the library says of a full disk, in many lines, into an InputError that names the file."""
    try:
        yield
    except lib.E57Exception as error:
        cause = str(error).strip().partition("\n")[0]
        raise InputError(f"{path}: cannot write: {cause}; is the disk full?") from error


def _begin(lib: Any, image_file: Any) -> Any:
    """Write what stands at the head of an E57 file; return its list of scans."""
    image_file.extensionsAdd("", lib.E57_V1_0_URI)
    root, data3d = image_file.root(), lib.VectorNode(image_file, True)
    texts = {"formatName": "ASTM E57 3D Imaging Data File", "guid": content_guid(b"unseen")}
    texts |= {"e57LibraryVersion": lib.E57_LIBRARY_ID, "coordinateMetadata": ""}
    for name, text in texts.items():
        root.set(name, lib.StringNode(image_file, encodable(text)))
    root.set("versionMajor", lib.IntegerNode(image_file, lib.E57_FORMAT_MAJOR))
    root.set("versionMinor", lib.IntegerNode(image_file, lib.E57_FORMAT_MINOR))
    root.set("data3D", data3d)
    root.set("images2D", lib.VectorNode(image_file, True))
    return data3d


def _scan_node(lib: Any, image_file: Any, cloud: RangeImage | InferredPoints, columns: dict[str, Any]) -> Any:
    """Everything of a scan, or of inferred points, but the points; its identifier is that of the content."""
    scan, tops = (cloud if isinstance(cloud, RangeImage) else None), dict[str, int]()
    header = cloud.description() if isinstance(cloud, InferredPoints) else scan_header(cloud)
    description = json_text(header, indent=None)
    node = lib.StructureNode(image_file)
    guid = content_guid(description.encode(), *(column.tobytes() for column in columns.values()))
    for key, text in (("guid", guid), ("name", cloud.name), ("description", description)):
        node.set(key, lib.StringNode(image_file, encodable(text)))
    if scan is not None:
        tops = {"rowIndex": scan.shape[0] - 1, "columnIndex": scan.shape[1] - 1}
        tops |= {name: int(columns[name].max()) for name in _RETURNS if name in columns}
        bounds = {"row": tops["rowIndex"], "column": tops["columnIndex"], "return": tops.get(_RETURNS[0], 0)}
        limits = {f"{name}{end}": top * (end == "Maximum") for name, top in bounds.items() for end in _ENDS}
        node.set("indexBounds", _structure(lib, image_file, limits))
    if "colorRed" in columns:
        limits = {f"color{name}{end}": 255 * (end == "Maximum") for name in _CHANNELS for end in _ENDS}
        node.set("colorLimits", _structure(lib, image_file, limits))
    if "intensity" in columns:
        ends = {f"intensity{end}": float(pick(columns["intensity"])) for end, pick in _PICKS.items()}
        node.set("intensityLimits", _structure(lib, image_file, ends))
    node.set("cartesianBounds", _structure(lib, image_file, _box(columns)))
    if scan is not None:
        node.set("pose", _pose(lib, image_file, scan))
    node.set("points", _points_node(lib, image_file, columns, tops))
    return node


def _columns(scan: RangeImage) -> dict[str, Any]:
    """One array a field, valid pixels only, row by row, in the scanner's frame."""
    if not scan.valid.any():
        raise InputError(f"scan {scan.name!r} has no return; E57 cannot hold an empty grid, use .npz")
    cloud = cloud_of(scan.with_facts(world_from_sensor=SCANNER_FROM_SENSOR), all_returns=True)
    columns: dict[str, Any] = {
        f"cartesian{axis}": np.ascontiguousarray(cloud.points[:, i]) for i, axis in enumerate("XYZ")
    }
    columns["rowIndex"], columns["columnIndex"] = cloud.row.astype("q"), cloud.column.astype("q")
    if cloud.number is not None and cloud.count is not None:  # pye57 knows no other integers than "q"
        columns["returnIndex"], columns["returnCount"] = (
            (cloud.number - 1).astype("q"),
            cloud.count.astype("q"),
        )
    if cloud.intensity is not None:
        columns["intensity"] = np.ascontiguousarray(cloud.intensity, dtype=np.float32)
    if cloud.colour is not None:
        for i, name in enumerate(_CHANNELS):
            columns[f"color{name}"] = np.ascontiguousarray(cloud.colour[:, i])
    return columns


def _box(columns: dict[str, Any]) -> dict[str, float]:
    """Bounds of the points in the scanner's frame."""
    return {
        f"{axis.lower()}{end}": float(pick(columns[f"cartesian{axis}"]))
        for axis in "XYZ"
        for end, pick in _PICKS.items()
    }


def _structure(lib: Any, image_file: Any, values: dict[str, Any]) -> Any:
    """A node of numbers: int as integer, float as float."""
    node = lib.StructureNode(image_file)
    for name, value in values.items():
        kind = lib.IntegerNode if isinstance(value, int) else lib.FloatNode
        node.set(name, kind(image_file, value))
    return node


def _pose(lib: Any, image_file: Any, scan: RangeImage) -> Any:
    """World from the scanner's frame as quaternion and translation."""
    pose = scan.world_from_sensor @ SCANNER_FROM_SENSOR.inverse()
    x, y, z, w = quaternion_of(pose.rotation)
    node = lib.StructureNode(image_file)
    node.set("rotation", _structure(lib, image_file, {"w": w, "x": x, "y": y, "z": z}))
    shift = {axis: float(value) for axis, value in zip("xyz", pose.translation, strict=True)}
    node.set("translation", _structure(lib, image_file, shift))
    return node


def _points_node(lib: Any, image_file: Any, columns: dict[str, Any], tops: dict[str, int]) -> Any:
    """Points whose record has doubles for coordinates and integers up to `tops`, or 255, for the rest."""
    record = lib.StructureNode(image_file)
    for name in columns:
        if name.startswith("cartesian"):
            record.set(name, lib.FloatNode(image_file, 0.0, lib.E57_DOUBLE))
        elif name == "intensity":
            record.set(name, lib.FloatNode(image_file, 0.0, lib.E57_SINGLE))
        elif ":" in name:
            record.set(name, field_node(lib, image_file, name))
        else:
            record.set(name, lib.IntegerNode(image_file, 0, 0, tops.get(name, 255)))
    return lib.CompressedVectorNode(image_file, record, lib.VectorNode(image_file, True))


def _write_columns(lib: Any, image_file: Any, points: Any, columns: dict[str, Any]) -> None:
    """Pass all points through in one go."""
    buffers = lib.VectorSourceDestBuffer()
    n_points = len(columns["cartesianX"])
    for name, column in columns.items():
        buffers.append(lib.SourceDestBuffer(image_file, name, column, n_points, True, True))
    writer = points.writer(buffers)
    writer.write(n_points)
    writer.close()


FORMAT = Format(
    suffixes=(".e57",),
    points=each_cloud(E57File),
    scans=each_scan(E57File),
    write=write_e57,
    several=True,
    all_returns=True,
    facts=FormatFacts(
        title="`.e57`",
        read=(
            "structured scans with rows and columns, in any order; unstructured ones with a pose are "
            "projected; first returns, all of ours; `timeStamp`"
        ),
        lost="images, later returns, a second turn of columns; each with a count but images",
        written="several scans: 1e-14 m",
        poses="of each scan; `--origin` or `--trajectory` for clouds without",
        units="metres; steps of scaled integers are errors that all points share",
        colours="by `colorLimits` or the bounds of the fields; invalid ones take the nearest; intensity",
        noise="in files of ours, else estimated from the points",
    ),
)
