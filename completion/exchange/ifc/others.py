# SPDX-License-Identifier: MIT
"""Columns, pipes, other surfaces, and rooms as spaces."""

from __future__ import annotations

import numpy as np

from completion.exchange.building.building_model import BuildingModel
from completion.exchange.building.columns import Column
from completion.exchange.building.elements import CylinderElement
from completion.exchange.building.faces import Frame
from completion.exchange.building.rooms import Room
from completion.exchange.ifc.evidence import Evidence, Quantity, mean_confidence, state_of
from completion.exchange.ifc.products import Contexts, Piece, Product, define, represented
from completion.exchange.ifc.shapes import Shapes, outlines
from completion.exchange.ifc.step_text import Ref, Word

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
