# SPDX-License-Identifier: MIT
"""Entities: IFC geometry, and ISO 10303-21 clear text of entities with numbers and values."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from importlib import metadata
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from completion.export.building.faces import FaceFrame, polygons, rings
from scenes.checks import FloatArray

_DIGITS = 9  # behind the point of lengths
_VIEW = "ReferenceView_V1.2"  # of IFC4: shapes to look at and measure, extruded or tessellated
_GUID = "0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz_$"


@dataclass(frozen=True, slots=True)
class Ref:
    """An entity that was written, by its number."""

    number: int


@dataclass(frozen=True, slots=True)
class Word:
    """A value of an enumeration; * is derived from others."""

    name: str


@dataclass(frozen=True, slots=True)
class TypedValue:
    """A value with its type, where several are allowed."""

    name: str
    value: Value


@dataclass(frozen=True, slots=True)
class Exact:
    """A positive number with all its digits, as of a conversion, where lengths are rounded."""

    value: float


Value = Ref | Word | TypedValue | Exact | str | float | int | bool | None | Sequence["Value"]


class StepText:
    """Entities as they are added; equal ones without an identifier of their own are written once.

    Parameters
    ----------
    content : bytes
        What identifiers derive from: the same content gives the same ones.
    """

    def __init__(self, content: bytes) -> None:
        self._content = hashlib.sha256(content).digest()
        self._lines: list[str] = []
        self._known: dict[str, Ref] = {}
        self._keys: set[str] = set()

    def add(self, name: str, values: Sequence[Value], *, alone: bool = False) -> Ref:
        """Return an entity of a type with the values of its attributes, in the order of the schema.

        One that is `alone` is shared with no other of the same values.
        """
        line = f"{name.upper()}({','.join(map(_encode, values))})"
        if alone or line not in self._known:
            self._lines.append(line)
            self._known[line] = Ref(len(self._lines))
        return self._known[line]

    def guid(self, key: str) -> str:
        """Return the GlobalId (22 characters) that belongs to a key, which may be used once.

        Raises
        ------
        ValueError
            A key that was used already.
        """
        if key in self._keys:
            raise ValueError(f"{key!r} has an identifier already")
        self._keys.add(key)
        number = int.from_bytes(hashlib.sha256(self._content + key.encode()).digest()[:16])
        return "".join(_GUID[(number >> shift) & 63] for shift in range(126, -1, -6))

    def text(self, name: str, schema: str, written: datetime) -> str:
        """Return the whole file of an IFC schema, with its name and when it was written.

        The header is that of the IFC file header policy, as buildingSMART's validation service checks it
        (buildingSMART/ifc-gherkin-rules, buildingSMART/validate): a view definition of the schema, a time
        stamp in ISO 8601, and company, application and version of the originating system.
        """
        version = _version()
        unknown = "('not stated')"
        head = [
            "ISO-10303-21;",
            "HEADER;",
            f"FILE_DESCRIPTION(('ViewDefinition [{_VIEW}]'),'2;1');",
            f"FILE_NAME({_encode(name)},'{written.isoformat(timespec='seconds')}',{unknown},{unknown},"
            f"'unseen {version}','The unseen developers - unseen - {version}','');",
            f"FILE_SCHEMA(({_encode(schema)}));",
            "ENDSEC;",
            "DATA;",
        ]
        body = [f"#{number}={line};" for number, line in enumerate(self._lines, start=1)]
        return "\n".join([*head, *body, "ENDSEC;", "END-ISO-10303-21;", ""])


def _version() -> str:
    """Digits of the release, as the header policy wants them; 0 where the package is not installed."""
    try:
        release = re.match(r"\d+(\.\d+)*", metadata.version("unseen"))
    except metadata.PackageNotFoundError:
        release = None
    return release[0] if release else "0"


def _encode(value: Value) -> str:
    """A value as text."""
    match value:
        case None:
            return "$"
        case Ref():
            return f"#{value.number}"
        case Word():
            return value.name if value.name == "*" else f".{value.name}."
        case TypedValue():
            return f"{value.name.upper()}({_encode(value.value)})"
        case Exact():
            return _text_of(value.value)
        case bool():
            return ".T." if value else ".F."
        case int() | np.integer():
            return str(int(value))
        case float() | np.floating():
            return _real(float(value))
        case str():
            return f"'{_characters(value)}'"
        case _:
            return f"({','.join(map(_encode, value))})"


def _real(value: float) -> str:
    """A number with a point, which must be finite."""
    if not np.isfinite(value):
        raise ValueError(f"STEP files hold finite numbers, got {value}")
    return _text_of(round(value, _DIGITS) + 0.0)


def _text_of(value: float) -> str:
    text = repr(value)
    if "e" in text:
        mantissa, power = text.split("e")
        return f"{mantissa if '.' in mantissa else mantissa + '.'}E{power}"
    return text.removesuffix("0") if text.endswith(".0") else text


def _characters(text: str) -> str:
    """Characters beyond ASCII by their codes; apostrophes and backslashes twice."""
    characters = []
    for character in text:
        if character in "'\\":
            characters.append(2 * character)
        elif 32 <= ord(character) < 127:
            characters.append(character)
        else:
            characters.append(f"\\X2\\{character.encode('utf-16-be').hex().upper()}\\X0\\")
    return "".join(characters)


@dataclass(frozen=True, slots=True, eq=False)
class Shapes:
    """Geometry for one file.

    Attributes
    ----------
    file : StepText
        Where it is written.
    origin : (3,) float
        The place of the world that is the file's origin, metres.
    metre : float
        A metre in the file's unit of length. All lengths that are given to methods are metres.
    """

    file: StepText
    origin: FloatArray
    metre: float = 1.0

    def point(self, place: FloatArray) -> Ref:
        """A point (2,) or (3,) relative to the file's origin."""
        return self.file.add("IfcCartesianPoint", [(self.metre * np.asarray(place, np.float64)).tolist()])

    def direction(self, vector: FloatArray) -> Ref:
        """A direction (2,) or (3,)."""
        return self.file.add("IfcDirection", [np.asarray(vector, dtype=np.float64).tolist()])

    def axes(self, place: FloatArray, axis: FloatArray, right: FloatArray) -> Ref:
        """Axes at a place (3,) of the file: z along `axis` (3,), x along `right` (3,)."""
        values = [self.point(place), self.direction(axis), self.direction(right)]
        return self.file.add("IfcAxis2Placement3D", values)

    def placement(self, above: Ref | None, height_m: float = 0.0) -> Ref:
        """Where an object is: `height_m` above the placement that it belongs to."""
        place = self.file.add("IfcAxis2Placement3D", [self.point(np.array([0, 0, height_m])), None, None])
        return self.file.add("IfcLocalPlacement", [above, place], alone=True)

    def extrude(self, area: Any, frame: FaceFrame, depth_m: float, low_m: float = 0.0) -> list[Ref]:
        """Solids that reach from `depth_m` behind the plane of a frame to `low_m` behind it, by polygon."""
        if area.is_empty:
            return []
        corner = np.array(area.bounds[:2])  # where profiles begin
        axes = self.axes(frame.place(corner, -depth_m) - self.origin, frame.normal, frame.right)
        along = self.direction(np.array([0, 0, 1.0]))
        outline = shapely.transform(area, lambda uv: uv - corner)
        return [
            self.file.add(
                "IfcExtrudedAreaSolid", [self.profile(polygon), axes, along, self.metre * (depth_m - low_m)]
            )
            for polygon in polygons(outline)
        ]

    def profile(self, polygon: Any) -> Ref:
        """An outline with its holes, for an extrusion."""
        outer, *holes = [self.loop_line(ring) for ring in rings(polygon)]
        if holes:
            return self.file.add("IfcArbitraryProfileDefWithVoids", [Word("AREA"), None, outer, holes])
        return self.file.add("IfcArbitraryClosedProfileDef", [Word("AREA"), None, outer])

    def loop_line(self, ring: FloatArray) -> Ref:
        """A closed polyline through points (n, 2) or (n, 3) of the file."""
        points = [self.point(place) for place in ring]
        return self.file.add("IfcPolyline", [[*points, points[0]]])

    def world_loop(self, points: FloatArray) -> Ref:
        """A closed polyline through points (n, 3) of the world."""
        return self.loop_line(np.asarray(points) - self.origin)

    def sheet(self, area: Any, frame: FaceFrame) -> list[Ref]:
        """Flat faces with their holes, without thickness; none of an area that is empty."""
        return [self._facet(rings(polygon), frame) for polygon in polygons(area)]

    def _facet(self, outlines: Sequence[FloatArray], frame: FaceFrame) -> Ref:
        """A flat face: its outer ring (n, 2), then those of its holes."""
        places = self._point_list(frame.place(np.concatenate(outlines)))
        ends = np.cumsum([len(ring) for ring in outlines])
        outer, *holes = [
            list(range(end - len(ring) + 1, end + 1))
            for ring, end in zip(outlines, ends.tolist(), strict=True)
        ]
        if holes:
            face = self.file.add("IfcIndexedPolygonalFaceWithVoids", [outer, holes])
        else:
            face = self.file.add("IfcIndexedPolygonalFace", [outer])
        return self.file.add("IfcPolygonalFaceSet", [places, False, [face], None])

    def _point_list(self, places: FloatArray) -> Ref:
        """Points (n, 3) of the world."""
        return self.file.add("IfcCartesianPointList3D", [(self.metre * (places - self.origin)).tolist()])

    def triangles(self, vertices: FloatArray, faces: NDArray[np.int64], *, closed: bool = False) -> list[Ref]:
        """Triangles (m, 3) of vertices (n, 3) of the world; none of no triangles.

        Those that are `closed` face outwards and enclose a solid.
        """
        if not len(faces):
            return []
        used, index = np.unique(faces, return_inverse=True)
        numbers = (index.reshape(-1, 3) + 1).tolist()
        places = self._point_list(vertices[used])
        return [self.file.add("IfcTriangulatedFaceSet", [places, None, closed, numbers, None])]

    def rod(self, ends: FloatArray, radius_m: float) -> list[Ref]:
        """A solid cylinder between the ends (2, 3) of its axis, world coordinates."""
        along = ends[1] - ends[0]
        length = float(np.linalg.norm(along))
        axis = along / length
        right = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
        axes = self.axes(ends[0] - self.origin, axis, right / np.linalg.norm(right))
        profile = self.file.add("IfcCircleProfileDef", [Word("AREA"), None, None, self.metre * radius_m])
        up = self.direction(np.array([0, 0, 1.0]))
        return [self.file.add("IfcExtrudedAreaSolid", [profile, axes, up, self.metre * length])]


def outlines(area: Any) -> Sequence[FloatArray]:
    """Outer rings (n, 2) of an area's polygons."""
    return [rings(polygon)[0] for polygon in polygons(area)]
