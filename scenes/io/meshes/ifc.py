# SPDX-License-Identifier: MIT
"""IFC (ISO 16739-1): a building's elements, their openings cut, in metres and in the frame of their map.

ifcopenshell meshes them in a process of its own (`ifc_geometry` beside), so that what a damaged file makes of
it stays there.
"""

from __future__ import annotations

import importlib.util
import json
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from scenes.checks import InputError
from scenes.io.checks.guard import guard_reading, one_line
from scenes.io.checks.limits import check_limit, current_limits
from scenes.io.formats.crs import LengthUnit
from scenes.mesh.appearance import GeometryLook, PlacedGeometry
from scenes.mesh.design import Design, Element, MapConversion
from scenes.run.atomic import atomic_path, write_json
from scenes.run.libraries import missing_extra
from scenes.run.memory import room

_PROGRAM = Path(__file__).with_name("ifc_geometry.py")
_SECONDS, _SECONDS_A_MB = 60, 30  # a house of 2.4 MB takes 4 s
_BYTES, _BYTES_A_BYTE = 3 << 30, 200  # address space for data; that house takes 100 MB
_NAMES_TOLD = 3
_AT_ENDS = 4096  # bytes
_GRID_SCALE = 0.01  # by which a map's metre may differ from the design's: maps reach 0.0025
TypedValue = tuple[str, str | float]
"""A measure of IFC, "IfcLabel", and its value; lengths in metres."""

_MAP_UNITS = {"metre": 1.0, "meter": 1.0, "m": 1.0, "millimetre": 0.001, "foot": 0.3048}


class IfcFile(NamedTuple):
    """An IFC file.

    Attributes
    ----------
    parts : list of PlacedGeometry
        One for each element, in the file's own frame and unit.
    body : (m,) int64
        Which faces of all parts are of one item of one element.
    design : Design
        What they are, and the map conversion from the file's own frame.
    unit : LengthUnit, optional
        What the file states; None where it states none.
    warnings : tuple of str
        What was left out.
    """

    parts: list[PlacedGeometry]
    body: NDArray[np.int64]
    design: Design
    unit: LengthUnit | None
    warnings: tuple[str, ...]


def read_ifc(file: Path) -> IfcFile:
    """Read the elements of an IFC file: of IfcElement all but openings, surface features and virtual ones.

    Spaces, annotations and grids are none. What an element is drawn as in other contexts than the body's does
    not count.

    Raises InputError: no IFC, damaged, ifcopenshell is missing, no element has geometry, more than the limits
    allow, or the geometry takes too long.
    """
    with TemporaryDirectory(prefix="unseen-ifc-") as folder:
        facts = _in_process(file, Path(folder), "read")
        with np.load(Path(folder, "mesh.npz")) as arrays:
            mesh = dict(arrays)
    check_limit("faces", facts["faces"], "its triangles, counted up to there")
    if not facts["elements"]:
        raise InputError(f"holds no element with geometry; elements without: {len(facts['bare'])}")
    ends = [np.cumsum(mesh[name])[:-1] for name in ("n_vertices", "n_faces", "n_faces")]
    split = [
        np.split(mesh[name], at) for name, at in zip(("vertices", "faces", "colours"), ends, strict=True)
    ]
    elements = tuple(Element(**held) for held in facts["elements"])
    names = [f"{element.ifc_class} {element.name}".strip() for element in elements]
    unit = _unit(facts["unit"])
    metres = 1.0 if unit is None or unit.metres is None else unit.metres[0]
    parts = [
        PlacedGeometry(name, vertices / metres, faces, _look(colours))
        for name, vertices, faces, colours in zip(names, *split, strict=True)
    ]
    items = np.column_stack([np.repeat(np.arange(len(parts)), mesh["n_faces"]), mesh["items"]])
    body = np.unique(items, axis=0, return_inverse=True)[1].reshape(-1).astype(np.int64)
    conversion, doubts = _conversion(facts["conversion"], metres)
    design = Design(elements, facts["schema"], "" if unit is None else unit.name, conversion)
    return IfcFile(parts, body, design, unit, (*doubts, *_left_out(facts)))


def _check_frame(file: Path) -> None:
    """Raise InputError where a file does not begin and end as ISO 10303-21 has it."""
    with file.open("rb") as stream:
        start = stream.read(_AT_ENDS).removeprefix(b"\xef\xbb\xbf").lstrip()
        stream.seek(max(file.stat().st_size - _AT_ENDS, 0))
        end = stream.read()
    if not start.startswith(b"ISO-10303-21"):
        is_packed = start.startswith(b"PK")
        looks = "is an archive; unpack it first" if is_packed else "does not begin with ISO-10303-21"
        raise InputError(f"is no IFC file: it {looks}")
    if b"END-ISO-10303-21" not in end:
        raise InputError("is cut off: it does not end with END-ISO-10303-21; export or copy it again")


def write_ifc_properties(
    source: Path, target: Path, name: str, properties: Mapping[str, Mapping[str, TypedValue]]
) -> int:
    """Write a copy of an IFC file in which elements have a property set; return how many have it.

    What the source holds stays as it is, but for sets of that name, which earlier copies have. Identifiers
    follow from those of the elements: the same source and properties give the same bytes.

    Parameters
    ----------
    source, target : Path
        IFC files.
    name : str
        Of the property set.
    properties : mapping
        By GlobalId of elements: values by name. Lengths are written in the unit of the file.

    Raises
    ------
    InputError
        The source cannot be read, ifcopenshell is missing, or the target cannot be written.
    """
    with TemporaryDirectory(prefix="unseen-ifc-") as folder:
        write_json(Path(folder, "properties.json"), {"name": name, "properties": properties})
        with guard_reading(source, "IFC"):
            facts = _in_process(source, Path(folder), "copied")
        with atomic_path(target) as temporary:
            shutil.copyfile(Path(folder, "copy.ifc"), temporary)
    return int(facts["written"])


def _in_process(file: Path, folder: Path, done_to: str) -> dict[str, Any]:
    """What the program `ifc_geometry` tells of a file; it writes more into the folder."""
    _check_frame(file)
    if importlib.util.find_spec("ifcopenshell") is None:
        raise missing_extra("ifcopenshell", "ifc")
    megabytes = file.stat().st_size / 1e6
    seconds = int(_SECONDS + _SECONDS_A_MB * megabytes)
    most_bytes = min(room(), _BYTES + _BYTES_A_BYTE * int(megabytes * 1e6))
    most = {"faces": current_limits().faces, "seconds": seconds, "bytes": most_bytes}
    command = [sys.executable, "-P", str(_PROGRAM), str(file.resolve()), str(folder), json.dumps(most)]
    try:
        done = subprocess.run(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
            timeout=seconds, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired as error:
        raise _stopped(done_to, f"took more than {seconds} s", error.stdout) from None
    facts = folder / "facts.json"
    if done.returncode or not facts.is_file():
        raise _stopped(done_to, f"crashed ({done.returncode})", done.stdout)
    held: dict[str, Any] = json.loads(facts.read_text("utf-8"))
    if "error" in held:
        raise InputError(f"cannot be {done_to} as IFC: {one_line(held['error'])[:300]}")
    return held


def _stopped(done_to: str, what: str, printed: bytes | None) -> InputError:
    """The refusal of a file with which the program did not end."""
    if done_to != "read":
        return InputError(f"cannot be {done_to} as IFC: ifcopenshell {what}")
    lines = (printed or b"").decode("ascii", "replace").split("\n")
    at = f"at {one_line(lines[-2])[:200]}" if len(lines) > 1 else "before the first element"
    return InputError(
        f"cannot be read as IFC: its geometry engine {what} {at}; leave that element out, "
        "or give the model as GLB"
    )


def _look(colours: Any) -> GeometryLook:
    """Colours (m, 4) of faces, NaN for none, as a look; sRGB as in the file."""
    plain = np.isnan(colours[:, :1])
    rgb = np.where(plain, np.float32(0.5), np.clip(colours[:, :3], 0, 1))
    opacity = np.where(np.isnan(colours[:, 3]), np.float32(1), colours[:, 3])
    return GeometryLook(
        np.repeat(rgb[:, None], 3, axis=1),
        is_plain=bool(plain.all()),
        opacity=None if (opacity == 1).all() else opacity,
    )


def _unit(held: dict[str, Any] | None) -> LengthUnit | None:
    """The unit that a file states, as its geometry was converted to metres."""
    if held is None:
        return None
    metres = held["metres"]
    if not 0 < metres < float("inf"):
        raise InputError(f"damaged: its unit {held['name']!r} has {metres:g} m")
    return LengthUnit(one_line(held["name"]), (metres, metres, metres))


def _conversion(held: dict[str, Any] | None, metres: float) -> tuple[MapConversion | None, tuple[str, ...]]:
    """The map conversion of a file whose unit has so many metres, and what is doubtful about it.

    Offsets are in the map's unit, the file's own where it names none. `Scale` leads from the file's unit to
    the map's (ISO 16739-1, IfcMapConversion); where it does not, as in files that leave it out, it is 1.
    """
    if held is None:
        return None, ()
    number = {name: value or 0.0 for name, value in held["values"].items() if isinstance(value, int | float)}
    crs, unit = held["crs"], held["crs"]["unit"]
    named = _MAP_UNITS.get(str(crs.get("unit_name") or "").lower(), metres)
    map_metres = named if unit is None else unit["metres"]
    scale = (number.get("Scale") or 1.0) * map_metres / metres
    doubts: tuple[str, ...] = ()
    if abs(scale - 1) > _GRID_SCALE:
        doubts = (
            f"its map conversion has a scale of {number.get('Scale') or 1.0:g}, by which a metre would be "
            f"{scale:.6g} m on the map: sizes are kept",
        )
        scale = 1.0
    names = (
        ("Eastings", "FirstCoordinate"),
        ("Northings", "SecondCoordinate"),
        ("OrthogonalHeight", "Height"),
    )
    x, y, z = (next((number[name] for name in pair if name in number), 0.0) * map_metres for pair in names)
    along = number.get("XAxisAbscissa", 0.0), number.get("XAxisOrdinate", 0.0)
    turn = float(np.degrees(np.arctan2(along[1], along[0]))) if any(along) else 0.0
    fx, fy, fz = (scale * (number.get(f"Factor{axis}") or 1.0) for axis in "XYZ")
    factors = fx, fy, fz
    conversion = MapConversion(one_line(crs["name"])[:100], (x, y, z), turn, factors)
    return (conversion if any((x, y, z, turn)) or set(factors) != {1.0} else None), doubts


def _left_out(facts: dict[str, Any]) -> tuple[str, ...]:
    """What of a file is not there, and what is there twice."""
    bare, n_elements = facts["bare"], len(facts["elements"]) + len(facts["bare"])
    told = []
    if bare:
        names = ", ".join(one_line(name)[:100] for name in bare[:_NAMES_TOLD])
        more = ", ..." if len(bare) > _NAMES_TOLD else ""
        told.append(
            f"elements without a body that can be meshed, left out: {len(bare)} of {n_elements} "
            f"({names}{more})"
        )
    identities = Counter(element["global_id"] for element in facts["elements"])
    twice = sum(count for count in identities.values() if count > 1)
    if twice:
        told.append(f"elements whose GlobalId another has too: {twice} of {n_elements}")
    return tuple(told)
