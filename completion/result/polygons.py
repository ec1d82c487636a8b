# SPDX-License-Identifier: MIT
"""Polygons: completed planes as outlines with holes and openings, each edge measured or inferred."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import shapely

from completion.extension.claims import role_of
from completion.extension.patch import Patch
from completion.panels.outline import NearOutline, polygon_parts, runs_of
from completion.result.completed_model import CompletedModel, DerivedSurface
from completion.result.openings import Opening
from scenes.checks import FloatArray
from scenes.run.mapping import trim
from scenes.surfaces.catalogue import Plane

FORMAT = "unseen polygons 1"
_OF_SIDES = ("sd_m", "inwards_m", "outwards_m", "measured")
_SHORT = 3  # samples, a cell apart: what is shorter takes after what comes before it
_DOOR_M = 0.1  # how far above a wall's lower edge a door may begin


def polygons_record(completion: CompletedModel) -> dict[str, Any]:
    """Return what `polygons.json` holds: planes as polygons, world coordinates, metres.

    Rings run anticlockwise seen from the normal's side, holes clockwise; they do not repeat their first
    point, and edge k leads from point k to the next. An edge is "measured" where the surface was measured
    up to it, else "inferred"; `kind` and `provenance` are those of completion.json. Outlines are those of the
    cells, laid on the surface's straight edges and on where it meets what encloses the room (`guides_of`),
    elsewhere straightened to within a cell; parts and holes of fewer than nine cells are left out.
    """
    planes = [
        _surface(completion, number, surface)
        for number, surface in enumerate(completion.derived.surfaces, start=1)
        if isinstance(surface.patch.grid.surface, Plane)
    ]
    return {"format": FORMAT, "unit": "m", "mode": completion.mode, "surfaces": planes}


def _surface(completion: CompletedModel, number: int, surface: DerivedSurface) -> dict[str, Any]:
    trim()
    patch, world = surface.patch, completion.world_from_reference
    normal = world.rotate(patch.grid.surface.normal(np.zeros((1, 3))))[0]
    area, boundary = surface.polygon, NearOutline.of(patch.grid, surface.outline)
    return {
        "id": number,
        "role": role_of(normal, encloses=patch.limits.encloses),
        "plane": {
            "point": world.apply(patch.grid.surface.from_uv(np.zeros((1, 2))))[0].tolist(),
            "normal": normal.tolist(),
        },
        "standard_deviation": patch.stated.parameter_deviations(),
        "observed_m2": patch.observed_m2,
        "hypothesised_m2": patch.hypothesised_m2,
        "area_m2": float(area.area),
        "polygons": [
            {
                "outer": _ring(completion, patch, boundary, polygon.exterior, anticlockwise=True),
                "holes": [
                    _ring(completion, patch, boundary, hole, anticlockwise=False)
                    for hole in polygon.interiors
                ],
            }
            for polygon in polygon_parts(area)
        ],
        "openings": [_opening(completion, patch, normal, found) for found in surface.openings],
    }


def _ring(
    completion: CompletedModel, patch: Patch, boundary: NearOutline, ring: Any, *, anticlockwise: bool
) -> dict[str, Any]:
    """Points of a ring, more where its state changes, and what is said of each edge."""
    uv = np.asarray(shapely.get_coordinates(ring), dtype=np.float64)[:-1]
    if bool(shapely.is_ccw(ring)) != anticlockwise:
        uv = uv[::-1]
    points, edges = [], []
    for place, edge in _stretches(boundary, uv, float(patch.grid.cell.max())):
        points.append(place)
        edges.append(edge)
    local = patch.grid.surface.from_uv(np.array(points))
    sd = patch.stated.standard_deviation(local)
    for k, edge in enumerate(edges):
        edge["sd_m"] = float(max(sd[k], sd[(k + 1) % len(sd)]))
    return {"points": completion.world_from_reference.apply(local).tolist(), "edges": edges}


def _stretches(
    boundary: NearOutline, corners: FloatArray, cell_m: float
) -> Iterator[tuple[FloatArray, dict[str, Any]]]:
    """The edges between a ring's corners (n, 2), cut where what is said of them changes.

    The beginning of each stretch, and what is said; it is asked about once a cell of `cell_m` metres.
    """
    along = np.roll(corners, -1, axis=0) - corners
    count = np.maximum(np.ceil(np.linalg.norm(along, axis=1) / cell_m), 1).astype(np.int64)
    first_of, edge_of = np.cumsum(count) - count, np.repeat(np.arange(len(corners)), count)
    share = (np.arange(len(edge_of)) - first_of[edge_of] + 0.5) / count[edge_of]
    _, index = boundary.tree.query(corners[edge_of] + share[:, None] * along[edge_of])
    known = boundary.known
    said = list(zip(known.kinds[index].tolist(), known.provenances[index].tolist(), strict=True))
    for k, (begin, n) in enumerate(zip(first_of.tolist(), count.tolist(), strict=True)):
        for first, last in runs_of(said[begin : begin + n], _SHORT):
            kind, provenance = said[begin + first]
            confidence = known.confidence[index[begin + first : begin + last + 1]]
            edge = {
                "state": "measured" if provenance == "measured" else "inferred",
                "kind": kind,
                "provenance": provenance,
                "confidence": float(np.mean(confidence)),
            }
            yield corners[k] + first / n * along[k], edge


def _opening(completion: CompletedModel, patch: Patch, normal: FloatArray, found: Opening) -> dict[str, Any]:
    """An opening with its kind and its size along the level and upwards, metres."""
    points = completion.world_from_reference.apply(found.points)
    is_wall = found.feature > 0 or role_of(normal, encloses=patch.limits.encloses) == "wall"
    farthest = np.linalg.svd(points - points.mean(axis=0))[2][0]  # the direction in which it reaches most
    across = np.cross([0.0, 0, 1], normal) if is_wall else farthest
    across /= np.linalg.norm(across)
    other = np.cross(normal, across)
    extent = [float(np.ptp(points @ direction)) for direction in (across, other)]
    kind = "opening"
    if is_wall:
        all_points = completion.world_from_reference.apply(patch.grid.centres()[patch.observed.ravel()])
        kind = "door" if points[:, 2].min() < all_points[:, 2].min() + _DOOR_M else "window"
    return {
        "kind": kind,
        "width_m": extent[0],
        "height_m": extent[1],
        "area_m2": found.area_m2,
        "seen_share": found.seen_share,
        "provenance": "user" if found.declared else "inferred",
        "points": points.tolist(),
        "sides": [
            {"sd_m": sd, "inwards_m": inwards, "outwards_m": outwards, "measured_share": measured}
            for sd, inwards, outwards, measured in zip(
                *(getattr(found.sides, name).tolist() for name in _OF_SIDES), strict=True
            )
        ],
    }
