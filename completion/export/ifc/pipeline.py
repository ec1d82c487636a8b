# SPDX-License-Identifier: MIT
"""IFC: a building's parts as one file (ISO 16739-1, IFC4), for programs that plan buildings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from completion.export.building.faces import PlaneFace, polygons
from completion.export.building.parts import BuildingParts
from completion.export.building.storeys import bands, storey_at
from completion.export.ifc.elements import (
    body_product,
    column_product,
    cylinder_product,
    pipe_product,
    rest_of,
    sheet_product,
    write_space,
)
from completion.export.ifc.entities import Ref, Shapes, StepText, Word
from completion.export.ifc.products import Contexts, Product, mean_confidence, write_product
from scenes.checks import FloatArray

_FAR_M = 1000.0  # coordinates beyond which the file has an origin of its own
_PRECISION_M = 1e-6
_LEAST_M2 = 1e-3  # of an element
_NAMES = {"IfcWall": "Wall", "IfcSlab": "Floor", "IfcCovering": "Ceiling", "IfcBuildingElementProxy": "Plane"}
_STANDING_M = 0.5  # by which an element may begin below the floor of its storey


@dataclass(frozen=True, slots=True, eq=False)
class _Level:
    """A storey in the file."""

    shapes: Shapes
    placement: Ref
    entity: Ref


def ifc_of(parts: BuildingParts, name: str = "completed.ifc") -> str:
    """Return a building as the text of an IFC4 file; the same parts give the same text.

    Walls and slabs that were seen from both sides are bodies of their thickness, with openings; other walls,
    floors and ceilings are surfaces. Rooms are spaces, columns and pipes are solids, other planes and
    cylinders proxies; what no surface explains is left out. Property sets `Unseen_Evidence` say what was
    measured and how well it is known. Where coordinates are large, the file has an origin of its own, and an
    IfcMapConversion leads to the scans' coordinates.
    """
    model = parts.model
    file = StepText(b"".join(np.ascontiguousarray(one).tobytes() for one in (model.vertices, model.faces)))
    origin = _origin(model.drawn)
    contexts = _contexts(file, origin)
    units = file.add("IfcUnitAssignment", [[
        file.add("IfcSIUnit", [Word("*"), Word(kind), None, Word(unit)])
        for kind, unit in (
            ("LENGTHUNIT", "METRE"), ("AREAUNIT", "SQUARE_METRE"), ("VOLUMEUNIT", "CUBIC_METRE"),
            ("PLANEANGLEUNIT", "RADIAN"),
        )
    ]])  # fmt: skip
    whole = contexts[1]
    values = [file.guid("project"), None, "Completion", None, None, None, None, [whole], units]
    project = file.add("IfcProject", values)
    ground = Shapes(file, origin)
    site_at = ground.placement(None)
    site = file.add("IfcSite", [*_named(file, "Site", site_at), *[None] * 5])
    house_at = ground.placement(site_at)
    house = file.add("IfcBuilding", [*_named(file, "Building", house_at), None, None, None])
    levels = list(_levels(file, parts, origin, house_at))
    _aggregate(file, project, [site])
    _aggregate(file, site, [house])
    _aggregate(file, house, [level.entity for level in levels])
    inside: dict[int, list[Ref]] = {}
    for k, product in _products(parts, levels):
        inside.setdefault(k, []).append(
            write_product(levels[k].shapes, contexts[0], levels[k].placement, product)
        )
    for k, level in enumerate(levels):
        if inside.get(k):
            values = [file.guid(f"contained {k}"), None, None, None, inside[k], level.entity]
            file.add("IfcRelContainedInSpatialStructure", values)
        rooms = [room for room in parts.rooms if room.storey == k]
        spaces = [
            write_space(level.shapes, contexts[0], level.placement, (f"Room {k}.{n}", room, model))
            for n, room in enumerate(rooms, start=1)
        ]
        if spaces:
            _aggregate(file, level.entity, spaces)
    return file.text(name, "IFC4")


def _products(parts: BuildingParts, levels: Sequence[_Level]) -> Iterator[tuple[int, Product]]:
    """All elements with the number of their storey, in the order of the file."""
    storeys, model = parts.storeys, parts.model
    face_of = {face.number: face for face in parts.faces}
    for body in parts.bodies:
        begin, kind = _begin(face_of[body.surfaces[0]]), "Wall" if body.kind == "wall" else "Slab"
        split: Sequence[tuple[int, Any]] = [(storey_at(storeys, begin), body.area)]
        if body.kind == "wall":
            split = bands(storeys, body.area, body.frame, begin)
        for k, part, key in _keyed(split, f"{kind} {body.surfaces[0]}-{body.surfaces[1]}"):
            yield k, body_product(levels[k].shapes, parts, body, part=part, key=key)
    posts = {number for column in parts.columns for number in column.surfaces}
    for face in parts.faces:
        rest = rest_of(parts, face)
        if face.number in posts or not polygons(rest, _LEAST_M2):
            continue
        k, entity = _place_and_class(parts, face)
        split = bands(storeys, rest, face.frame, _begin(face)) if entity == "IfcWall" else [(k, rest)]
        for k, part, key in _keyed(split, f"{_NAMES[entity]} {face.number}"):
            yield k, sheet_product(levels[k].shapes, parts, face, rest=part, named=(entity, key))
    cylinders = {one.number: one for one in model.cylinders}
    for column in parts.columns:
        known = [cylinders.get(number) or face_of[number].element for number in column.surfaces]
        k = storey_at(storeys, column.bottom_m + _STANDING_M)
        yield k, column_product(levels[k].shapes, column, min(map(mean_confidence, known)))
    for number, cylinder in cylinders.items():
        k = storey_at(storeys, float(cylinder.ends[:, 2].min()) + _STANDING_M)
        if number in posts:
            continue
        if cylinder in parts.pipes:
            yield k, pipe_product(levels[k].shapes, cylinder)
        elif (other := cylinder_product(levels[k].shapes, model, cylinder)) is not None:
            yield k, other


def _keyed(split: Sequence[tuple[int, Any]], key: str) -> Iterator[tuple[int, Any, str]]:
    """Parts by storey, each with a key of its own; what is too small to be written is left out."""
    for k, part in split:
        if polygons(part, _LEAST_M2):
            yield k, part, key if len(split) == 1 else f"{key} storey {k}"


def _place_and_class(parts: BuildingParts, face: PlaneFace) -> tuple[int, str]:
    """The storey of a face, and what it is there."""
    for k, storey in enumerate(parts.storeys):
        for faces, entity in (
            (storey.floors, "IfcSlab"),
            (storey.ceilings, "IfcCovering"),
            (storey.walls, "IfcWall"),
        ):
            if face in faces:
                return k, entity
    kinds = {"wall": "IfcWall", "floor": "IfcSlab", "ceiling": "IfcCovering"}
    return storey_at(parts.storeys, _begin(face)), kinds.get(face.element.kind, "IfcBuildingElementProxy")


def _begin(face: PlaneFace) -> float:
    """Height by which a face belongs to a storey."""
    return face.lowest_m + _STANDING_M


def _levels(file: StepText, parts: BuildingParts, origin: FloatArray, above: Ref) -> Iterator[_Level]:
    """The storeys; one at the origin where nothing was found."""
    heights = [storey.elevation_m for storey in parts.storeys] or [float(origin[2])]
    for k, height in enumerate(heights):
        rise = height - float(origin[2])
        shapes = Shapes(file, np.array([origin[0], origin[1], height]))
        placement = shapes.placement(above, rise)
        values = [*_named(file, f"Storey {k}", placement), rise]
        yield _Level(shapes, placement, file.add("IfcBuildingStorey", values))


def _named(file: StepText, name: str, placement: Ref) -> list[Ref | str | Word | None]:
    """The attributes that all spatial elements begin with."""
    return [file.guid(name), None, name, None, None, placement, None, None, Word("ELEMENT")]


def _aggregate(file: StepText, whole: Ref, parts: Sequence[Ref]) -> None:
    identifier = file.guid(f"{whole.number} consists of")
    file.add("IfcRelAggregates", [identifier, None, None, None, whole, list(parts)])


def _origin(places: FloatArray) -> FloatArray:
    """The place of the world that is the file's origin: whole metres where coordinates are large."""
    if not len(places) or np.abs(places).max() < _FAR_M:
        return np.zeros(3)
    return np.asarray(np.floor(places.min(axis=0)))


def _contexts(file: StepText, origin: FloatArray) -> tuple[Contexts, Ref]:
    """Contexts of geometry, the last of them the whole; where it lies in the scans' coordinates."""
    zero = file.add("IfcCartesianPoint", [[0.0, 0.0, 0.0]])
    axes = file.add("IfcAxis2Placement3D", [zero, None, None])
    whole = file.add("IfcGeometricRepresentationContext", [None, "Model", 3, _PRECISION_M, axes, None])
    kinds = (("Body", "MODEL_VIEW"), ("FootPrint", "PLAN_VIEW"), ("Reference", "GRAPH_VIEW"))
    star = Word("*")
    body, foot_print, reference = (
        file.add(
            "IfcGeometricRepresentationSubContext",
            [name, "Model", star, star, star, star, whole, None, Word(view), None],
        )
        for name, view in kinds
    )
    if origin.any():
        told = "coordinates of the scans; which reference system they are in is not known"
        system = file.add("IfcProjectedCRS", ["unknown", told, None, None, None, None, None])
        file.add("IfcMapConversion", [whole, system, *origin.tolist(), 1.0, 0.0, 1.0])
    return Contexts(body, foot_print, reference), whole
