# SPDX-License-Identifier: MIT
"""Elements: walls, slabs, ceilings, columns, pipes, other surfaces, and rooms as spaces."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import shapely

from completion.export.building.bodies import Body
from completion.export.building.faces import (
    Frame,
    PlaneFace,
    common,
    inside,
    joined,
    less,
    moved,
    smoothed,
    wide,
)
from completion.export.building.model import BuildingModel, CylinderElement, OpeningOutline
from completion.export.building.parts import BuildingParts, Column
from completion.export.building.rooms import Room
from completion.export.ifc.entities import Ref, Shapes, Word, outlines
from completion.export.ifc.products import (
    Contexts,
    Evidence,
    Hole,
    Piece,
    Product,
    Quantity,
    define,
    deviation_at,
    mean_confidence,
    represented,
    state_of,
)

_REACH_M = 0.01  # by which an opening's solid reaches beyond both faces
_SLIT_M, _FINE_M = 0.02, 0.002  # of bodies and of surfaces, which programs cannot draw
_BESIDE_M = 0.05  # width of what is left of a face beside a body and is no wall of its own
_SAME = 0.5  # of an opening that lies within another outline
_SETS = {
    "IfcWall": ("Qto_WallBaseQuantities", "NetSideArea", "Width"),
    "IfcSlab": ("Qto_SlabBaseQuantities", "NetArea", "Width"),
    "IfcCovering": ("Qto_CoveringBaseQuantities", "NetArea", "Width"),
    "IfcBuildingElementProxy": ("Qto_BuildingElementProxyQuantities", "NetSurfaceArea", "Width"),
}


def body_product(shapes: Shapes, parts: BuildingParts, body: Body, part: Any, key: str) -> Product:
    """Return part of a wall or a slab with its thickness; openings of either face go through it."""
    face, other = (next(one for one in parts.faces if one.number == number) for number in body.surfaces)
    holes = [(outline, area) for outline, area in _through(body, face, other) if _is_beside(area, part)]
    open_area = joined(area for _, area in holes)
    whole = smoothed(joined((common(body.area, part), open_area)), _SLIT_M)
    inferred = common(smoothed(less(common(body.inferred, part), [open_area]), _SLIT_M), whole)
    measured, inferred = smoothed(less(whole, [inferred]), _FINE_M), smoothed(inferred, _FINE_M)
    net = less(joined((measured, inferred)), [open_area])
    depth = body.thickness_m
    entity = "IfcWall" if body.kind == "wall" else "IfcSlab"
    pieces = (
        Piece(shapes.extruded(measured, body.frame, depth), "measured"),
        Piece(shapes.extruded(inferred, body.frame, depth), "inferred"),
    )
    evidence = Evidence(
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
        if (solids := shapes.extruded(area, body.frame, depth + _REACH_M, -_REACH_M))
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
    shapes: Shapes, parts: BuildingParts, face: PlaneFace, rest: Any, named: tuple[str, str]
) -> Product:
    """Return part of a face that is in no body, as a surface without thickness; `named` is class and key."""
    entity, key = named
    measured = smoothed(common(rest, face.measured), _FINE_M)
    inferred = smoothed(less(rest, [measured]), _FINE_M)
    area = float(measured.area + inferred.area)
    place = face.frame.place(inside(rest))
    evidence = Evidence(
        surfaces=(face.number,),
        measured_share=float(measured.area) / area,
        sd_m=deviation_at(face.element, place),
        confidence=mean_confidence(face.element),
        more={"Thickness": "unknown: seen from one side"},
    )
    pieces = (
        Piece(shapes.sheet(measured, face.frame), "measured"),
        Piece(shapes.sheet(inferred, face.frame), "inferred"),
    )
    name, net_name, _ = _SETS[entity]
    words = {"IfcSlab": "FLOOR", "IfcCovering": "CEILING"}
    taken = joined(_laid_on(parts, face))
    holes = [
        Hole(one, [shapes.world_loop(one.points)], "Curve3D", None)
        for one in face.openings
        if entity != "IfcBuildingElementProxy"
        and not _is_within(shapely.Polygon(face.frame.flat(one.points)), taken)
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
        quantities=(*_lengths(entity, rest), Quantity(net_name, "Area", area)),
        holes=tuple(holes),
    )


def rest_of(parts: BuildingParts, face: PlaneFace) -> Any:
    """What of a face is in no body."""
    taken = list(_laid_on(parts, face))
    return wide(less(face.area, taken), _BESIDE_M) if taken else face.area


def _laid_on(parts: BuildingParts, face: PlaneFace) -> Iterator[Any]:
    """The areas that bodies take of a face, with the openings through them."""
    for body in parts.bodies:
        if face.number in body.surfaces:
            one, other = (next(f for f in parts.faces if f.number == number) for number in body.surfaces)
            through = joined((body.area, *(area for _, area in _through(body, one, other))))
            yield moved(through, body.frame, face.frame)


def _through(body: Body, face: PlaneFace, other: PlaneFace) -> Iterator[tuple[OpeningOutline, Any]]:
    """The openings in a body and their outlines on its first face; of two that are one, the first."""
    around = shapely.buffer(body.area, 0.0).convex_hull
    known: list[Any] = []
    for one in (*face.openings, *other.openings):
        area = _outline(one, body.frame)
        if area.area and not _is_within(area, joined(known)) and _is_within(area, around):
            known.append(area)
            yield one, less(common(area, around), known[:-1])


def _outline(opening: OpeningOutline, frame: Frame) -> Any:
    return joined([shapely.Polygon(frame.flat(opening.points))])


def _is_beside(opening: Any, part: Any) -> bool:
    """Whether an opening is in a part of a wall, rather than in that of another storey."""
    around = shapely.box(*part.bounds)
    return not opening.is_empty and bool(shapely.contains(around.buffer(_BESIDE_M), opening.centroid))


def _is_within(area: Any, other: Any) -> bool:
    return bool(common(area, other).area > _SAME * area.area)


def _lengths(entity: str, area: Any) -> Sequence[Quantity]:
    """Length and height of an upright element."""
    if entity != "IfcWall":
        return ()
    left, low, right, high = area.bounds
    return Quantity("Length", "Length", right - left), Quantity("Height", "Length", high - low)


_UP = Frame(np.zeros(3), *np.eye(3))


def column_product(shapes: Shapes, column: Column, confidence: float) -> Product:
    """Return a column: round of its radius, or with four sides."""
    high = column.top_m - column.bottom_m
    if column.cylinder is not None:
        items = shapes.rod(column.cylinder.ends, column.cylinder.radius_m)
        high, section = column.cylinder.length_m, np.pi * column.cylinder.radius_m**2
    else:
        frame = Frame(np.array([0.0, 0.0, column.top_m]), _UP.right, _UP.up, _UP.normal)
        items, section = shapes.extruded(column.footprint, frame, high), float(column.footprint.area)
    evidence = Evidence(column.surfaces, column.measured_share, column.sd_m, confidence)
    return Product(
        key=f"Column {'-'.join(map(str, column.surfaces))}",
        entity="IfcColumn",
        predefined="COLUMN",
        described="stands on a floor",
        representation="SweptSolid",
        pieces=(Piece(items, state_of(column.measured_share)),),
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
        pieces=(Piece(shapes.rod(pipe.ends, pipe.radius_m), state_of(pipe.measured_share)),),
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
    own, seen = model.surface == cylinder.number, model.is_measured
    pieces = (
        Piece(shapes.triangles(model.vertices, model.faces[own & seen]), "measured"),
        Piece(shapes.triangles(model.vertices, model.faces[own & ~seen]), "inferred"),
    )
    if not own.any():
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


def _of_cylinder(cylinder: CylinderElement, more: dict[str, str | float]) -> Evidence:
    return Evidence(
        surfaces=(cylinder.number,),
        measured_share=cylinder.measured_share,
        sd_m=cylinder.radius_sd_m,
        confidence=mean_confidence(cylinder),
        more=more,
    )


def write_space(
    shapes: Shapes, contexts: Contexts, above: Ref, named: tuple[str, Room, BuildingModel]
) -> Ref:
    """Return a room as a space: with its volume where it is closed, else the outline of its floor."""
    key, room, model = named
    file = shapes.file
    base = Frame(np.array([0.0, 0.0, room.floor_m]), _UP.right, _UP.up, _UP.normal)
    if room.volume_m3 is None or room.height_m is None:
        rings = [shapes.world_loop(base.place(ring)) for ring in outlines(room.outline)]
        shape = represented(file, contexts.foot_print, "FootPrint", "Curve3D", rings)
    else:
        if room.by_facets:
            faces = model.faces[np.isin(model.surface, room.surfaces)][:, ::-1]  # they face inwards
            items, kind = shapes.solid(model.vertices, faces), "Brep"
        else:
            top = Frame(base.place(np.zeros(2), room.height_m), _UP.right, _UP.up, _UP.normal)
            items, kind = shapes.extruded(room.outline, top, room.height_m), "SweptSolid"
        shape = represented(file, contexts.body, "Body", kind, items)
    told = "closed" if room.closed else "open: walls were not found all around it"
    values = [file.guid(key), None, key, told, None, shapes.placement(above), shape, None, Word("ELEMENT")]
    space = file.add("IfcSpace", [*values, Word("INTERNAL" if room.closed else "NOTDEFINED"), None])
    around = [one for one in model.planes if one.number in room.surfaces]
    evidence = Evidence(
        surfaces=room.surfaces,
        measured_share=room.measured_share,
        sd_m=None,
        confidence=min((mean_confidence(one) for one in around), default=None),
        more={"Boundary": told, "Volume": room.told},
    )
    quantities = [Quantity("NetFloorArea", "Area", room.area_m2)]
    if room.height_m is not None:
        quantities.append(Quantity("Height", "Length", room.height_m))
    if room.volume_m3 is not None:
        quantities.append(Quantity("NetVolume", "Volume", room.volume_m3))
    define(file, key, space, evidence, ("Qto_SpaceBaseQuantities", quantities))
    return space
