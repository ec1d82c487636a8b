# SPDX-License-Identifier: MIT
"""Building elements for IFC: walls, slabs, ceilings, columns, pipes, furniture, and other things."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import chain
from typing import Any, Literal

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
from completion.export.building.model import BuildingModel, CylinderElement, OpeningOutline
from completion.export.building.parts import BuildingColumn, BuildingParts
from completion.export.building.proxies import find_proxies
from completion.export.building.rooms import bands, storey_at
from completion.export.building.runs import segments_in_runs
from completion.export.ifc_entities import Shapes
from completion.export.ifc_furniture import furniture_product
from completion.export.ifc_products import (
    Hole,
    Product,
    ProductEvidence,
    ProductPiece,
    Quantity,
    deviation_at,
    mean_confidence,
    state_of,
)
from scenes.checks import FloatArray

_REACH_M = 0.01  # by which an opening's solid reaches beyond both faces
_SETS = {
    "IfcWall": ("Qto_WallBaseQuantities", "NetSideArea", "Width"),
    "IfcSlab": ("Qto_SlabBaseQuantities", "NetArea", "Width"),
    "IfcCovering": ("Qto_CoveringBaseQuantities", "NetArea", "Width"),
}


def body_product(shapes: Shapes, parts: BuildingParts, body: Body, part: Any, key: str) -> Product:
    """Return part of a wall or a slab with its thickness; openings of either face go through it."""
    face, other = (next(face for face in parts.faces if face.number == number) for number in body.surfaces)
    holes = [(outline, area) for outline, area in _through(body, face, other) if _is_beside(area, part)]
    open_area = union(area for _, area in holes)
    whole = smooth(union((common(body.area, part), open_area)), limits.THIN_M)
    inferred = common(smooth(less(common(body.inferred, part), [open_area]), limits.THIN_M), whole)
    gross = float(whole.area)
    measured, inferred = (
        smooth(less(area, [open_area]), limits.FINE_M) for area in (less(whole, [inferred]), inferred)
    )
    net = float(measured.area + inferred.area)
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
    quantities = [
        *_lengths(entity, whole),
        Quantity(depth_name, "Length", depth),
        Quantity(net_name.replace("Net", "Gross"), "Area", gross),
        Quantity(net_name, "Area", net),
        Quantity("GrossVolume", "Volume", gross * depth),
        Quantity("NetVolume", "Volume", net * depth),
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
    outlined = [(opening, _outline(opening, face.frame)) for opening in face.openings]
    holes = [
        Hole(opening, [shapes.world_loop(opening.points)], "Curve3D", None)
        for opening, area in outlined
        if _is_beside(area, remainder) and not _is_within(area, taken)
    ]
    return Product(
        key=key,
        entity=entity,
        predefined=words.get(entity, "NOTDEFINED"),
        described="a surface seen from one side; its thickness is not known",
        representation="Tessellation",
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
        evidence=ProductEvidence(
            surfaces=(pipe.number,),
            measured_share=pipe.measured_share,
            sd_m=pipe.radius_sd_m,
            confidence=mean_confidence(pipe),
            more=more,
        ),
        quantities_of="Qto_PipeSegmentBaseQuantities",
        quantities=(
            Quantity("Length", "Length", pipe.length_m),
            Quantity("GrossCrossSectionArea", "Area", float(np.pi) * pipe.radius_m**2),
            Quantity("OuterSurfaceArea", "Area", 2 * float(np.pi) * pipe.radius_m * pipe.length_m),
        ),
    )


def thing_product(shapes: Shapes, model: BuildingModel, numbers: tuple[int, ...]) -> Product:
    """Return surfaces that are no part of the building, and touch each other, as one object."""
    is_member, seen = np.isin(model.surface, numbers), model.is_measured
    corners = model.vertices[model.faces]
    size = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    area = float(size[is_member].sum())
    surfaces = [one for one in (*model.planes, *model.cylinders) if one.number in numbers]
    kinds = sorted({model.kinds[number] for number in numbers})
    more: dict[str, str | float] = {"Kinds": ", ".join(kinds), "Thickness": "unknown: seen from outside"}
    for cylinder in model.cylinders:
        if numbers == (cylinder.number,):
            more["Radius_mm"] = 1e3 * cylinder.radius_m
    described = "surfaces that touch each other and are" if len(numbers) > 1 else "a surface that is"
    return Product(
        key=f"Thing {numbers[0]}",
        entity="IfcBuildingElementProxy",
        predefined="NOTDEFINED",
        described=f"{described} no part of the building",
        representation="Tessellation",
        pieces=(
            ProductPiece(shapes.triangles(model.vertices, model.faces[is_member & seen]), "measured"),
            ProductPiece(shapes.triangles(model.vertices, model.faces[is_member & ~seen]), "inferred"),
        ),
        evidence=ProductEvidence(
            surfaces=numbers,
            measured_share=float(size[is_member & seen].sum()) / area if area else 0.0,
            sd_m=None,
            confidence=min(map(mean_confidence, surfaces), default=None),
            more=more,
        ),
        quantities_of="Qto_BuildingElementProxyQuantities",
        quantities=(Quantity("NetSurfaceArea", "Area", area),),
    )


_NAMES = {"IfcWall": "Wall", "IfcSlab": "Floor", "IfcCovering": "Ceiling"}


def elements_of(parts: BuildingParts, shapes: Sequence[Shapes]) -> Iterator[tuple[int, Product]]:
    """Yield all elements with the number of their storey; `shapes` has the geometry of each storey.

    An opening in both faces of a wall is filled once.
    """
    known: list[FloatArray] = []
    for k, product in chain(
        _bodies(parts, shapes), _sheets(parts, shapes), _columns(parts, shapes), _others(parts, shapes)
    ):
        floor_m = float(shapes[k].origin[2]) if parts.storeys and parts.storeys[k].floors else None
        yield k, replace(product, holes=tuple(_filled(hole, floor_m, known) for hole in product.holes))


def _filled(hole: Hole, floor_m: float | None, known: list[FloatArray]) -> Hole:
    """An opening with its door or window, above the floor of its storey where that was found.

    It has none where it is no rectangle in a wall, or reaches the floor and has not the size of a door, or
    where the opening was filled in the other face of the wall.
    """
    outline = hole.outline
    middle = outline.points.mean(axis=0)
    is_rectangle = outline.area_m2 >= limits.RECTANGLE * outline.width_m * outline.height_m
    is_known = any(np.linalg.norm(middle - one) < limits.MOST_THICKNESS_M for one in known)
    if outline.kind == "opening" or not is_rectangle or is_known:
        return hole
    kind = outline.kind
    if floor_m is not None:
        kind = "door" if outline.points[:, 2].min() < floor_m + limits.DOOR_M else "window"
    narrow, wide_m = limits.DOOR_WIDTH_M
    fits = narrow <= outline.width_m <= wide_m and outline.height_m >= limits.HEADROOM_M
    if kind == "door" and not fits:
        return hole
    known.append(middle)
    filling: Literal["IfcDoor", "IfcWindow"] = "IfcDoor" if kind == "door" else "IfcWindow"
    return replace(hole, outline=replace(outline, kind=kind), filling=filling)


def _bodies(parts: BuildingParts, shapes: Sequence[Shapes]) -> Iterator[tuple[int, Product]]:
    face_of = {face.number: face for face in parts.faces}
    for body in parts.bodies:
        begin, kind = _begin(face_of[body.surfaces[0]]), "Wall" if body.kind == "wall" else "Slab"
        split: Sequence[tuple[int, Any]] = [(storey_at(parts.storeys, begin), body.area)]
        if body.kind == "wall":
            split = bands(parts.storeys, body.area, body.frame, begin)
        for k, part, key in _with_keys(split, f"{kind} {body.surfaces[0]}-{body.surfaces[1]}"):
            yield k, body_product(shapes[k], parts, body, part=part, key=key)


def _posts(parts: BuildingParts) -> set[int]:
    return {number for column in parts.columns for number in column.surfaces}


def _sheets(parts: BuildingParts, shapes: Sequence[Shapes]) -> Iterator[tuple[int, Product]]:
    posts = _posts(parts)
    for face in parts.faces:
        k, entity = _place_and_class(parts, face)
        remainder = rest_of(parts, face)
        if entity is None or face.number in posts or not polygons(remainder, limits.LEAST_ELEMENT_M2):
            continue
        split: Sequence[tuple[int, Any]] = [(k, remainder)]
        if entity == "IfcWall":
            split = bands(parts.storeys, remainder, face.frame, _begin(face))
        for k, part, key in _with_keys(split, f"{_NAMES[entity]} {face.number}"):
            yield k, sheet_product(shapes[k], parts, face, remainder=part, named=(entity, key))


def _columns(parts: BuildingParts, shapes: Sequence[Shapes]) -> Iterator[tuple[int, Product]]:
    known = {one.number: mean_confidence(one) for one in (*parts.model.planes, *parts.model.cylinders)}
    for column in parts.columns:
        k = storey_at(parts.storeys, column.bottom_m + limits.LEAST_PART_M)
        yield k, column_product(shapes[k], column, min(known[number] for number in column.surfaces))


def _others(parts: BuildingParts, shapes: Sequence[Shapes]) -> Iterator[tuple[int, Product]]:
    """Pipes, closed things, and what is left beside them and the building."""
    runs, model = segments_in_runs(parts.pipes), parts.model
    for pipe in (pipe for pipe in parts.pipes if pipe.number in runs):
        k = storey_at(parts.storeys, float(pipe.ends[:, 2].min()) + limits.LEAST_PART_M)
        yield k, pipe_product(shapes[k], pipe)
    structure = _posts(parts) | runs
    structure |= {face.number for face in parts.faces if _place_and_class(parts, face)[1] is not None}
    for thing in model.things:
        k = storey_at(parts.storeys, float(thing.vertices[:, 2].min()) + limits.LEAST_PART_M)
        yield k, furniture_product(shapes[k], thing)
        structure |= {*thing.surfaces}
    for numbers in find_proxies(model, structure):
        lowest = float(model.vertices[model.faces[np.isin(model.surface, numbers)]][..., 2].min())
        k = storey_at(parts.storeys, lowest + limits.LEAST_PART_M)
        yield k, thing_product(shapes[k], model, numbers)


def _with_keys(split: Sequence[tuple[int, Any]], key: str) -> Iterator[tuple[int, Any, str]]:
    """Parts by storey, each with a key of its own; what is too small to be written is left out."""
    for k, part in split:
        if polygons(part, limits.LEAST_ELEMENT_M2):
            yield k, part, key if len(split) == 1 else f"{key} storey {k}"


def _place_and_class(parts: BuildingParts, face: PlaneFace) -> tuple[int, str | None]:
    """The storey of a face, and what it is there; None of what is no part of the building."""
    for k, storey in enumerate(parts.storeys):
        for faces, entity in (
            (storey.floors, "IfcSlab"),
            (storey.ceilings, "IfcCovering"),
            (storey.walls, "IfcWall"),
        ):
            if face in faces:
                return k, entity
    kinds = {"wall": "IfcWall", "floor": "IfcSlab", "ceiling": "IfcCovering"}
    bodies = {number: body.kind for body in parts.bodies for number in body.surfaces}
    kind = {"wall": "wall", "slab": "floor"}.get(bodies.get(face.number, ""), face.element.kind)
    return storey_at(parts.storeys, _begin(face)), kinds.get(kind)


def _begin(face: PlaneFace) -> float:
    """Height by which a face belongs to a storey."""
    return face.lowest_m + limits.LEAST_PART_M
