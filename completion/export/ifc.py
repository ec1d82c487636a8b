# SPDX-License-Identifier: MIT
"""IFC: a building's parts as one file (ISO 16739-1, IFC4), for programs that plan buildings.

Elements are walls, slabs, ceilings, columns, pipes, doors, windows, things, and rooms as spaces.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime

import numpy as np

from completion.export.building import limits
from completion.export.building.faces import FaceFrame
from completion.export.building.model import told_turn
from completion.export.building.parts import BuildingParts
from completion.export.building.rooms import BuildingRoom
from completion.export.ifc_elements import elements_of
from completion.export.ifc_entities import Exact, Ref, Shapes, StepText, TypedValue, Word, outlines
from completion.export.ifc_products import (
    Contexts,
    ProductEvidence,
    Quantity,
    Representation,
    define,
    mean_confidence,
    product_shape,
    write_product,
)
from scenes.checks import FloatArray
from scenes.io.formats.format import METRES_PER_UNIT, Units

_FAR_M = 1000.0  # coordinates beyond which the file has an origin of its own
_PRECISION_M = 1e-6
_SI = {"cm": "CENTI", "mm": "MILLI"}
_NAMED = {"in": "inch", "ft": "foot", "us-ft": "US survey foot"}
_MEASURES = (  # kind of unit, its SI name, its measure, before the name of a unit of length
    ("LENGTHUNIT", "METRE", "IfcLengthMeasure", ""),
    ("AREAUNIT", "SQUARE_METRE", "IfcAreaMeasure", "square "),
    ("VOLUMEUNIT", "CUBIC_METRE", "IfcVolumeMeasure", "cubic "),
)


@dataclass(frozen=True, slots=True, eq=False)
class _Level:
    """A storey in the file."""

    shapes: Shapes
    placement: Ref
    entity: Ref


def ifc_of(
    parts: BuildingParts, name: str = "completed.ifc", *, written: datetime, units: Units = "m"
) -> str:
    """Return a building as the text of an IFC4 file; the same parts and time give the same text.

    Walls and slabs that were seen from both sides are bodies of their thickness, without their openings;
    other walls, floors and ceilings are surfaces. Rectangular openings of walls hold a door, or a window
    above a sill. Rooms are spaces, columns and runs of pipes are solids; surfaces that touch each other and
    are none of these are one proxy. What no surface explains is left out. Property sets `Unseen_Evidence`
    say what was measured and how well it is known. Where coordinates are large, the file has an origin of
    its own, and an IfcMapConversion leads to the scans' coordinates. Where up is not z in these, the
    project's description says by which matrix they were turned first.

    Parameters
    ----------
    parts : BuildingParts
        What to write.
    name : str
        Of the file.
    written : datetime
        When it is written.
    units : "mm", "cm", "m", "in", "ft" or "us-ft"
        Unit of all lengths, areas and volumes; properties whose names end in `_mm` are in millimetres.
    """
    model = parts.model
    file = StepText(
        b"".join(np.ascontiguousarray(array).tobytes() for array in (model.vertices, model.faces))
    )
    metre = 1 / METRES_PER_UNIT[units]
    ground = Shapes(file, _origin(model.drawn, metre), metre)
    assigned = _units(file, units)
    contexts, whole = _contexts(ground, assigned[0])
    turn = told_turn(model.drawing_from_world).strip("; ") or None
    unit = file.add("IfcUnitAssignment", [assigned])
    values = [file.guid("project"), None, "Completion", turn, None, None, None, [whole], unit]
    levels = _spatial_tree(ground, parts, file.add("IfcProject", values))
    inside: dict[int, list[Ref]] = {}
    for k, product in elements_of(parts, [level.shapes for level in levels]):
        written_here = write_product(levels[k].shapes, contexts, levels[k].placement, product)
        inside.setdefault(k, []).extend(written_here)
    for k, level in enumerate(levels):
        if inside.get(k):
            values = [file.guid(f"contained {k}"), None, None, None, inside[k], level.entity]
            file.add("IfcRelContainedInSpatialStructure", values)
        rooms = [room for room in parts.rooms if room.storey == k]
        spaces = [
            _write_space(level, contexts, (f"Room {k}.{n}", room, parts)) for n, room in enumerate(rooms, 1)
        ]
        if spaces:
            _aggregate(file, level.entity, spaces)
    return file.text(name, "IFC4", written)


def _units(file: StepText, units: Units) -> list[Ref]:
    """The units of lengths, areas, volumes and angles.

    Those that are not metric are named as buildingSMART's table of conversion based units has them.
    """
    refs = []
    for power, (kind, name, measure, prefix) in enumerate(_MEASURES, start=1):
        scale = _SI.get(units)
        si = file.add("IfcSIUnit", [Word("*"), Word(kind), scale and Word(scale), Word(name)])
        if units in _NAMED:
            exact = TypedValue(measure, Exact(METRES_PER_UNIT[units] ** power))
            factor = file.add("IfcMeasureWithUnit", [exact, si])
            dimensions = file.add("IfcDimensionalExponents", [power, *[0] * 6])
            named = f"{prefix}{_NAMED[units]}"
            si = file.add("IfcConversionBasedUnit", [dimensions, Word(kind), named, factor])
        refs.append(si)
    return [*refs, file.add("IfcSIUnit", [Word("*"), Word("PLANEANGLEUNIT"), None, Word("RADIAN")])]


def _spatial_tree(ground: Shapes, parts: BuildingParts, project: Ref) -> list[_Level]:
    """Site, building and storeys below the project; the storeys."""
    file = ground.file
    site_at = ground.placement(None)
    site = file.add("IfcSite", [*_spatial_attributes(file, "Site", site_at), *[None] * 5])
    house_at = ground.placement(site_at)
    house = file.add("IfcBuilding", [*_spatial_attributes(file, "Building", house_at), None, None, None])
    levels = list(_levels(ground, parts, house_at))
    _aggregate(file, project, [site])
    _aggregate(file, site, [house])
    _aggregate(file, house, [level.entity for level in levels])
    return levels


def _levels(ground: Shapes, parts: BuildingParts, above: Ref) -> Iterator[_Level]:
    """The storeys; one at the origin where nothing was found."""
    file, origin = ground.file, ground.origin
    heights = [storey.elevation_m for storey in parts.storeys] or [float(origin[2])]
    for k, height in enumerate(heights):
        rise = height - float(origin[2])
        shapes = Shapes(file, np.array([origin[0], origin[1], height]), ground.metre)
        placement = shapes.placement(above, rise)
        values = [*_spatial_attributes(file, f"Storey {k}", placement), ground.metre * rise]
        yield _Level(shapes, placement, file.add("IfcBuildingStorey", values))


_BASE = FaceFrame(np.zeros(3), *np.eye(3))


def _write_space(level: _Level, contexts: Contexts, named: tuple[str, BuildingRoom, BuildingParts]) -> Ref:
    """Return a room as a space, with a body and the outline of its floor.

    Where no ceiling was found, the body ends where the storey's does, or at the highest place that there is.
    """
    key, room, parts = named
    shapes, file, model = level.shapes, level.shapes.file, parts.model
    height = room.height_m or _drawn_height(room, parts)
    floor, top = (
        FaceFrame(_BASE.place(np.zeros(2), z), _BASE.right, _BASE.up, _BASE.normal)
        for z in (room.floor_m, room.floor_m + height)
    )
    kind: Representation = "SweptSolid"
    if room.by_facets:
        kind, faces = "Tessellation", model.faces[np.isin(model.surface, room.surfaces)]
        items = shapes.triangles(model.vertices, faces[:, ::-1], closed=True)  # they face inwards
    else:
        items = shapes.extrude(room.outline, top, height)
    rings = [shapes.world_loop(floor.place(ring)) for ring in outlines(room.outline)]
    representations = [
        (contexts.body, "Body", kind, items),
        (contexts.foot_print, "FootPrint", "Curve3D", rings),
    ]
    shape = product_shape(file, representations)
    sentence = "closed" if room.closed else "open: walls were not found all around it"
    placement = shapes.placement(level.placement)
    values = [file.guid(key), None, key, sentence, None, placement, shape, None, Word("ELEMENT")]
    space = file.add("IfcSpace", [*values, Word("INTERNAL" if room.closed else "NOTDEFINED"), None])
    define(shapes, key, space, _evidence_of(room, parts, sentence), _quantities_of(room))
    return space


def _drawn_height(room: BuildingRoom, parts: BuildingParts) -> float:
    """How high a room is drawn over which no ceiling was found, metres."""
    storey = parts.storeys[room.storey]
    above = [other.elevation_m for other in parts.storeys[room.storey + 1 :]]
    highest = float(parts.model.drawn[:, 2].max())
    top = storey.ceiling_m if storey.ceiling_m is not None else min([highest, *above])
    height = top - room.floor_m
    return height if height > limits.LEAST_ROOM_M else limits.HEADROOM_M


def _evidence_of(room: BuildingRoom, parts: BuildingParts, sentence: str) -> ProductEvidence:
    around = [plane for plane in parts.model.planes if plane.number in room.surfaces]
    is_known = room.height_m is not None
    height = "between floor and ceiling" if is_known else "inferred: no ceiling was found over most of it"
    return ProductEvidence(
        surfaces=room.surfaces,
        measured_share=room.measured_share,
        sd_m=None,
        confidence=min((mean_confidence(element) for element in around), default=None),
        more={"Boundary": sentence, "Volume": room.volume_origin, "BodyHeight": height},
    )


def _quantities_of(room: BuildingRoom) -> tuple[str, Sequence[Quantity]]:
    quantities = [Quantity("NetFloorArea", "Area", room.area_m2)]
    if room.height_m is not None:
        quantities.append(Quantity("Height", "Length", room.height_m))
    if room.volume_m3 is not None:
        quantities.append(Quantity("NetVolume", "Volume", room.volume_m3))
    return "Qto_SpaceBaseQuantities", quantities


def _spatial_attributes(file: StepText, name: str, placement: Ref) -> list[Ref | str | Word | None]:
    """The attributes that all spatial elements begin with."""
    return [file.guid(name), None, name, None, None, placement, None, None, Word("ELEMENT")]


def _aggregate(file: StepText, whole: Ref, parts: Sequence[Ref]) -> None:
    identifier = file.guid(f"{whole.number} consists of")
    file.add("IfcRelAggregates", [identifier, None, None, None, whole, list(parts)])


def _origin(places: FloatArray, metre: float) -> FloatArray:
    """The place of the world that is the origin: whole units of the file where coordinates are large."""
    if not len(places) or np.abs(places).max() < _FAR_M:
        return np.zeros(3)
    return np.asarray(np.floor(places.min(axis=0) * metre) / metre)


def _contexts(ground: Shapes, unit: Ref) -> tuple[Contexts, Ref]:
    """Contexts of geometry, and the whole; where it lies in the scans' coordinates, in the file's unit."""
    file = ground.file
    zero = file.add("IfcCartesianPoint", [[0.0, 0.0, 0.0]])
    axes = file.add("IfcAxis2Placement3D", [zero, None, None])
    precision = _PRECISION_M * ground.metre
    whole = file.add("IfcGeometricRepresentationContext", [None, "Model", 3, precision, axes, None])
    kinds = (
        ("Body", "MODEL_VIEW"), ("FootPrint", "PLAN_VIEW"), ("Reference", "GRAPH_VIEW"),
        ("Profile", "ELEVATION_VIEW"),
    )  # fmt: skip
    star = Word("*")
    contexts = (
        file.add(
            "IfcGeometricRepresentationSubContext",
            [name, "Model", star, star, star, star, whole, None, Word(view), None],
        )
        for name, view in kinds
    )
    if ground.origin.any():
        told = "coordinates of the scans; which reference system they are in is not known"
        system = file.add("IfcProjectedCRS", ["unknown", told, None, None, None, None, unit])
        place = np.rint(ground.origin * ground.metre).tolist()
        file.add("IfcMapConversion", [whole, system, *place, 1.0, 0.0, 1.0])
    return Contexts(*contexts), whole
