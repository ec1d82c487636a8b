# SPDX-License-Identifier: MIT
"""Parts: what people order of a building, of a building model: walls, slabs, rooms, columns, pipes."""

from __future__ import annotations

from dataclasses import dataclass

from completion.exchange.building.beams import Beams
from completion.exchange.building.bodies import Body, find_bodies
from completion.exchange.building.building_model import BuildingModel
from completion.exchange.building.columns import Column, find_columns, find_pipes
from completion.exchange.building.elements import CylinderElement
from completion.exchange.building.faces import PlaneFace, faces_of
from completion.exchange.building.gaps import trimmed_bodies, with_gaps, within_rooms
from completion.exchange.building.rooms import Room, find_rooms
from completion.exchange.building.storeys import Storey, find_storeys


@dataclass(frozen=True, slots=True, eq=False)
class BuildingParts:
    """What a building consists of.

    Attributes
    ----------
    model : BuildingModel
        Where it comes from.
    faces : tuple of PlaneFace
        Its planes as areas, of those that bound rooms what these show, with all openings.
    bodies : tuple of Body
        Walls and slabs that were seen from both sides.
    storeys : tuple of Storey
        From the lowest up; none where there is nothing.
    rooms : tuple of Room
        By storey.
    columns : tuple of Column
        What stands on a floor.
    pipes : tuple of CylinderElement
        Straight segments.
    """

    model: BuildingModel
    faces: tuple[PlaneFace, ...]
    bodies: tuple[Body, ...]
    storeys: tuple[Storey, ...]
    rooms: tuple[Room, ...]
    columns: tuple[Column, ...]
    pipes: tuple[CylinderElement, ...]


def building_parts(model: BuildingModel, beams: Beams) -> BuildingParts:
    """Return the parts of a building; `beams` say where there can be no wall.

    Planes that are back to back are bodies where nothing speaks against it; level planes give storeys; the
    walls of a storey enclose rooms. What was inferred beyond the rooms is left out, and doorways and windows
    are found where a room's wall is not. Posts of four planes are no walls.
    """
    faces = faces_of(model)
    bodies = find_bodies(faces, beams)
    storeys = find_storeys(faces, bodies)
    columns = find_columns(model.cylinders, bodies, storeys)
    posts = {number for column in columns if column.cylinder is None for number in column.surfaces}
    rooms = find_rooms(model, storeys)
    shown = with_gaps(within_rooms(faces, storeys, rooms), rooms, beams)
    new = {face.number: face for face in shown}
    return BuildingParts(
        model=model,
        faces=shown,
        bodies=trimmed_bodies([body for body in bodies if not posts & {*body.surfaces}], shown),
        storeys=tuple(storey.with_faces(new) for storey in storeys),
        rooms=rooms,
        columns=columns,
        pipes=find_pipes(model.cylinders, columns),
    )
