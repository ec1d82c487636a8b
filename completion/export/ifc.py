# SPDX-License-Identifier: MIT
"""IFC: a building's parts as one file (ISO 16739-1, IFC4), for programs that plan buildings.

Elements are walls, slabs, ceilings, columns, pipes, other surfaces, and rooms as spaces.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely

from completion.export.building import limits
from completion.export.building.bodies import Body
from completion.export.building.faces import (
    FaceFrame,
    PlaneFace,
    common,
    inside,
    less,
    polygons,
    project_area,
    smooth,
    union,
    wide,
)
from completion.export.building.model import BuildingModel, CylinderElement, OpeningOutline, told_turn
from completion.export.building.parts import BuildingColumn, BuildingParts
from completion.export.building.rooms import BuildingRoom, bands, storey_at
from completion.export.ifc_entities import Ref, Shapes, StepText, Word, outlines
from completion.export.ifc_products import (
    Contexts,
    Hole,
    Product,
    ProductEvidence,
    ProductPiece,
    Quantity,
    define,
    deviation_at,
    mean_confidence,
    shape_representation,
    state_of,
    write_product,
)
from scenes.checks import FloatArray

_REACH_M = 0.01  # by which an opening's solid reaches beyond both faces
_SETS = {
    "IfcWall": ("Qto_WallBaseQuantities", "NetSideArea", "Width"),
    "IfcSlab": ("Qto_SlabBaseQuantities", "NetArea", "Width"),
    "IfcCovering": ("Qto_CoveringBaseQuantities", "NetArea", "Width"),
    "IfcBuildingElementProxy": ("Qto_BuildingElementProxyQuantities", "NetSurfaceArea", "Width"),
}


def body_product(shapes: Shapes, parts: BuildingParts, body: Body, part: Any, key: str) -> Product:
    """Return part of a wall or a slab with its thickness; openings of either face go through it."""
    face, other = (next(face for face in parts.faces if face.number == number) for number in body.surfaces)
    holes = [(outline, area) for outline, area in _through(body, face, other) if _is_beside(area, part)]
    open_area = union(area for _, area in holes)
    whole = smooth(union((common(body.area, part), open_area)), limits.THIN_M)
    inferred = common(smooth(less(common(body.inferred, part), [open_area]), limits.THIN_M), whole)
    measured, inferred = smooth(less(whole, [inferred]), limits.FINE_M), smooth(inferred, limits.FINE_M)
    net = less(union((measured, inferred)), [open_area])
    depth = body.thickness_m
    entity = "IfcWall" if body.kind == "wall" else "IfcSlab"
    pieces = (
        ProductPiece(shapes.extrude(measured, body.frame, depth), "measured"),
        ProductPiece(shapes.extrude(inferred, body.frame, depth), "inferred"),
    )
    evidence = ProductEvidence(
        surfaces=body.surfaces,
        measured_share=float(common(body.measured, part).area / part.area),
        sd_m=body.thickness_sd_m if np.isfinite(body.thickness_sd_m) else None,
        confidence=min(mean_confidence(face.element), mean_confidence(other.element)),
        more={
            "Thickness": "between both faces, where both were measured",
            "Thickness_mm": 1e3 * depth,
            "Angle_deg": body.angle_deg,
        },
    )
    name, net_name, depth_name = _SETS[entity]
    gross = float(measured.area + inferred.area)
    quantities = [
        *_lengths(entity, whole),
        Quantity(depth_name, "Length", depth),
        Quantity(net_name.replace("Net", "Gross"), "Area", gross),
        Quantity(net_name, "Area", net.area),
        Quantity("GrossVolume", "Volume", gross * depth),
        Quantity("NetVolume", "Volume", net.area * depth),
    ]
    voids = [
        Hole(outline, solids, "SweptSolid", depth)
        for outline, area in holes
        if (solids := shapes.extrude(area, body.frame, depth + _REACH_M, -_REACH_M))
    ]
    return Product(
        key=key,
        entity=entity,
        predefined="NOTDEFINED" if entity == "IfcWall" else "FLOOR",
        described="seen from both sides",
        representation="SweptSolid",
        pieces=pieces,
        evidence=evidence,
        quantities_of=name,
        quantities=tuple(quantities),
        holes=tuple(voids),
    )


def sheet_product(
    shapes: Shapes, parts: BuildingParts, face: PlaneFace, remainder: Any, named: tuple[str, str]
) -> Product:
    """Return part of a face that is in no body, as a surface without thickness; `named` is class and key."""
    entity, key = named
    measured = smooth(common(remainder, face.measured), limits.FINE_M)
    inferred = smooth(less(remainder, [measured]), limits.FINE_M)
    area = float(measured.area + inferred.area)
    place = face.frame.place(inside(remainder))
    evidence = ProductEvidence(
        surfaces=(face.number,),
        measured_share=float(measured.area) / area,
        sd_m=deviation_at(face.element, place),
        confidence=mean_confidence(face.element),
        more={"Thickness": "unknown: seen from one side"},
    )
    pieces = (
        ProductPiece(shapes.sheet(measured, face.frame), "measured"),
        ProductPiece(shapes.sheet(inferred, face.frame), "inferred"),
    )
    name, net_name, _ = _SETS[entity]
    words = {"IfcSlab": "FLOOR", "IfcCovering": "CEILING"}
    taken = union(_laid_on(parts, face))
    holes = [
        Hole(opening, [shapes.world_loop(opening.points)], "Curve3D", None)
        for opening in face.openings
        if entity != "IfcBuildingElementProxy"
        and not _is_within(shapely.Polygon(face.frame.flat(opening.points)), taken)
    ]
    return Product(
        key=key,
        entity=entity,
        predefined=words.get(entity, "NOTDEFINED"),
        described="a surface seen from one side; its thickness is not known",
        representation="SurfaceModel",
        pieces=pieces,
        evidence=evidence,
        quantities_of=name,
        quantities=(*_lengths(entity, remainder), Quantity(net_name, "Area", area)),
        holes=tuple(holes),
    )


def rest_of(parts: BuildingParts, face: PlaneFace) -> Any:
    """What of a face is in no body."""
    taken = list(_laid_on(parts, face))
    return wide(less(face.area, taken), limits.NEAR_FACE_M) if taken else face.area


def _laid_on(parts: BuildingParts, face: PlaneFace) -> Iterator[Any]:
    """The areas that bodies take of a face, with the openings through them."""
    for body in parts.bodies:
        if face.number in body.surfaces:
            first, second = (next(f for f in parts.faces if f.number == number) for number in body.surfaces)
            through = union((body.area, *(area for _, area in _through(body, first, second))))
            yield project_area(through, body.frame, face.frame)


def _through(body: Body, face: PlaneFace, other: PlaneFace) -> Iterator[tuple[OpeningOutline, Any]]:
    """The openings in a body and their outlines on its first face; of two that are one, the first."""
    around = shapely.buffer(body.area, 0.0).convex_hull
    known: list[Any] = []
    for outline in (*face.openings, *other.openings):
        area = _outline(outline, body.frame)
        if area.area and not _is_within(area, union(known)) and _is_within(area, around):
            known.append(area)
            yield outline, less(common(area, around), known[:-1])


def _outline(opening: OpeningOutline, frame: FaceFrame) -> Any:
    return union([shapely.Polygon(frame.flat(opening.points))])


def _is_beside(opening: Any, part: Any) -> bool:
    """Whether an opening is in a part of a wall, rather than in that of another storey."""
    around = shapely.box(*part.bounds)
    return not opening.is_empty and bool(
        shapely.contains(around.buffer(limits.NEAR_FACE_M), opening.centroid)
    )


def _is_within(area: Any, other: Any) -> bool:
    return bool(common(area, other).area > limits.MAJORITY * area.area)


def _lengths(entity: str, area: Any) -> Sequence[Quantity]:
    """Length and height of an upright element."""
    if entity != "IfcWall":
        return ()
    left, low, right, high = area.bounds
    return Quantity("Length", "Length", right - left), Quantity("Height", "Length", high - low)


_UP = FaceFrame(np.zeros(3), *np.eye(3))


def column_product(shapes: Shapes, column: BuildingColumn, confidence: float) -> Product:
    """Return a column: round of its radius, or with four sides."""
    high = column.top_m - column.bottom_m
    if column.cylinder is not None:
        items = shapes.rod(column.cylinder.ends, column.cylinder.radius_m)
        high, section = column.cylinder.length_m, np.pi * column.cylinder.radius_m**2
    else:
        frame = FaceFrame(np.array([0.0, 0.0, column.top_m]), _UP.right, _UP.up, _UP.normal)
        items, section = shapes.extrude(column.footprint, frame, high), float(column.footprint.area)
    evidence = ProductEvidence(column.surfaces, column.measured_share, column.sd_m, confidence)
    return Product(
        key=f"Column {'-'.join(map(str, column.surfaces))}",
        entity="IfcColumn",
        predefined="COLUMN",
        described="stands on a floor",
        representation="SweptSolid",
        pieces=(ProductPiece(items, state_of(column.measured_share)),),
        evidence=evidence,
        quantities_of="Qto_ColumnBaseQuantities",
        quantities=(
            Quantity("Length", "Length", high),
            Quantity("CrossSectionArea", "Area", float(section)),
            Quantity("NetVolume", "Volume", float(section) * high),
        ),
    )


def pipe_product(shapes: Shapes, pipe: CylinderElement) -> Product:
    """Return a straight segment of a pipe, filled: how thick its wall is was not seen."""
    more: dict[str, str | float] = {
        "Radius_mm": 1e3 * pipe.radius_m,
        "Thickness": "unknown: seen from outside",
    }
    return Product(
        key=f"Pipe {pipe.number}",
        entity="IfcPipeSegment",
        predefined="RIGIDSEGMENT",
        described="a straight segment, drawn filled",
        representation="SweptSolid",
        pieces=(ProductPiece(shapes.rod(pipe.ends, pipe.radius_m), state_of(pipe.measured_share)),),
        evidence=_of_cylinder(pipe, more),
        quantities_of="Qto_PipeSegmentBaseQuantities",
        quantities=(
            Quantity("Length", "Length", pipe.length_m),
            Quantity("GrossCrossSectionArea", "Area", float(np.pi) * pipe.radius_m**2),
            Quantity("OuterSurfaceArea", "Area", 2 * float(np.pi) * pipe.radius_m * pipe.length_m),
        ),
    )


def cylinder_product(shapes: Shapes, model: BuildingModel, cylinder: CylinderElement) -> Product | None:
    """Return another cylinder as its facets; None where it has none."""
    is_member, seen = model.surface == cylinder.number, model.is_measured
    pieces = (
        ProductPiece(shapes.triangles(model.vertices, model.faces[is_member & seen]), "measured"),
        ProductPiece(shapes.triangles(model.vertices, model.faces[is_member & ~seen]), "inferred"),
    )
    if not is_member.any():
        return None
    return Product(
        key=f"Cylinder {cylinder.number}",
        entity="IfcBuildingElementProxy",
        predefined="NOTDEFINED",
        described="part of a cylinder",
        representation="Tessellation",
        pieces=pieces,
        evidence=_of_cylinder(cylinder, {"Radius_mm": 1e3 * cylinder.radius_m}),
        quantities_of="",
        quantities=(),
    )


def _of_cylinder(cylinder: CylinderElement, more: dict[str, str | float]) -> ProductEvidence:
    return ProductEvidence(
        surfaces=(cylinder.number,),
        measured_share=cylinder.measured_share,
        sd_m=cylinder.radius_sd_m,
        confidence=mean_confidence(cylinder),
        more=more,
    )


def write_space(
    shapes: Shapes, contexts: Contexts, above: Ref, named: tuple[str, BuildingRoom, BuildingModel]
) -> Ref:
    """Return a room as a space: with its volume where it is closed, else the outline of its floor."""
    key, room, model = named
    file = shapes.file
    base = FaceFrame(np.array([0.0, 0.0, room.floor_m]), _UP.right, _UP.up, _UP.normal)
    if room.volume_m3 is None or room.height_m is None:
        rings = [shapes.world_loop(base.place(ring)) for ring in outlines(room.outline)]
        shape = shape_representation(file, contexts.foot_print, "FootPrint", "Curve3D", rings)
    else:
        if room.by_facets:
            faces = model.faces[np.isin(model.surface, room.surfaces)][:, ::-1]  # they face inwards
            items, kind = shapes.solid(model.vertices, faces), "Brep"
        else:
            top = FaceFrame(base.place(np.zeros(2), room.height_m), _UP.right, _UP.up, _UP.normal)
            items, kind = shapes.extrude(room.outline, top, room.height_m), "SweptSolid"
        shape = shape_representation(file, contexts.body, "Body", kind, items)
    sentence = "closed" if room.closed else "open: walls were not found all around it"
    values = [
        file.guid(key),
        None,
        key,
        sentence,
        None,
        shapes.placement(above),
        shape,
        None,
        Word("ELEMENT"),
    ]
    space = file.add("IfcSpace", [*values, Word("INTERNAL" if room.closed else "NOTDEFINED"), None])
    around = [plane for plane in model.planes if plane.number in room.surfaces]
    evidence = ProductEvidence(
        surfaces=room.surfaces,
        measured_share=room.measured_share,
        sd_m=None,
        confidence=min((mean_confidence(element) for element in around), default=None),
        more={"Boundary": sentence, "Volume": room.volume_origin},
    )
    quantities = [Quantity("NetFloorArea", "Area", room.area_m2)]
    if room.height_m is not None:
        quantities.append(Quantity("Height", "Length", room.height_m))
    if room.volume_m3 is not None:
        quantities.append(Quantity("NetVolume", "Volume", room.volume_m3))
    define(file, key, space, evidence, ("Qto_SpaceBaseQuantities", quantities))
    return space


_FAR_M = 1000.0  # coordinates beyond which the file has an origin of its own
_PRECISION_M = 1e-6
_NAMES = {"IfcWall": "Wall", "IfcSlab": "Floor", "IfcCovering": "Ceiling", "IfcBuildingElementProxy": "Plane"}


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
    IfcMapConversion leads to the scans' coordinates. Where up is not z in these, the project's description
    says by which matrix they were turned first.
    """
    model = parts.model
    file = StepText(
        b"".join(np.ascontiguousarray(array).tobytes() for array in (model.vertices, model.faces))
    )
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
    turn = told_turn(model.drawing_from_world).strip("; ") or None
    values = [file.guid("project"), None, "Completion", turn, None, None, None, [whole], units]
    project = file.add("IfcProject", values)
    ground = Shapes(file, origin)
    site_at = ground.placement(None)
    site = file.add("IfcSite", [*_spatial_attributes(file, "Site", site_at), *[None] * 5])
    house_at = ground.placement(site_at)
    house = file.add("IfcBuilding", [*_spatial_attributes(file, "Building", house_at), None, None, None])
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
        for k, part, key in _with_keys(split, f"{kind} {body.surfaces[0]}-{body.surfaces[1]}"):
            yield k, body_product(levels[k].shapes, parts, body, part=part, key=key)
    posts = {number for column in parts.columns for number in column.surfaces}
    for face in parts.faces:
        remainder = rest_of(parts, face)
        if face.number in posts or not polygons(remainder, limits.LEAST_ELEMENT_M2):
            continue
        k, entity = _place_and_class(parts, face)
        split = (
            bands(storeys, remainder, face.frame, _begin(face)) if entity == "IfcWall" else [(k, remainder)]
        )
        for k, part, key in _with_keys(split, f"{_NAMES[entity]} {face.number}"):
            yield k, sheet_product(levels[k].shapes, parts, face, remainder=part, named=(entity, key))
    cylinders = {cylinder.number: cylinder for cylinder in model.cylinders}
    for column in parts.columns:
        known = [cylinders.get(number) or face_of[number].element for number in column.surfaces]
        k = storey_at(storeys, column.bottom_m + limits.LEAST_PART_M)
        yield k, column_product(levels[k].shapes, column, min(map(mean_confidence, known)))
    for number, cylinder in cylinders.items():
        k = storey_at(storeys, float(cylinder.ends[:, 2].min()) + limits.LEAST_PART_M)
        if number in posts:
            continue
        if cylinder in parts.pipes:
            yield k, pipe_product(levels[k].shapes, cylinder)
        elif (other := cylinder_product(levels[k].shapes, model, cylinder)) is not None:
            yield k, other


def _with_keys(split: Sequence[tuple[int, Any]], key: str) -> Iterator[tuple[int, Any, str]]:
    """Parts by storey, each with a key of its own; what is too small to be written is left out."""
    for k, part in split:
        if polygons(part, limits.LEAST_ELEMENT_M2):
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
    return face.lowest_m + limits.LEAST_PART_M


def _levels(file: StepText, parts: BuildingParts, origin: FloatArray, above: Ref) -> Iterator[_Level]:
    """The storeys; one at the origin where nothing was found."""
    heights = [storey.elevation_m for storey in parts.storeys] or [float(origin[2])]
    for k, height in enumerate(heights):
        rise = height - float(origin[2])
        shapes = Shapes(file, np.array([origin[0], origin[1], height]))
        placement = shapes.placement(above, rise)
        values = [*_spatial_attributes(file, f"Storey {k}", placement), rise]
        yield _Level(shapes, placement, file.add("IfcBuildingStorey", values))


def _spatial_attributes(file: StepText, name: str, placement: Ref) -> list[Ref | str | Word | None]:
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
        contexts = "coordinates of the scans; which reference system they are in is not known"
        system = file.add("IfcProjectedCRS", ["unknown", contexts, None, None, None, None, None])
        file.add("IfcMapConversion", [whole, system, *origin.tolist(), 1.0, 0.0, 1.0])
    return Contexts(body, foot_print, reference), whole
