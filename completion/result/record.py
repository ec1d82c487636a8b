# SPDX-License-Identifier: MIT
"""Record: what completion.json holds of a completed model, and its planes as polygons.json has them.

Polygons are outlines with holes and openings; each edge is measured or inferred.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, replace
from typing import Any, Literal, get_args

import numpy as np
import shapely

from completion.edits.file import edit_record
from completion.export.building.limits import DOOR_M
from completion.export.panels.model import FoldEdge, rotate_covariances
from completion.export.panels.outline import NearOutline, polygon_parts, runs_of
from completion.extension.patch import Patch
from completion.features.engine.template import feature_record, moved_geometry
from completion.fitting.result import surface_parameters
from completion.relations.graph import frame_records, freedom_record, relation_records
from completion.relations.pipeline import SurfaceRelations
from completion.result.completed_model import CompletedModel, DerivedSurface
from completion.result.flat_scans import surface_flattening, whole_flattening
from completion.result.labelled_points import PROVENANCE_NAMES
from completion.result.openings import SurfaceOpening
from completion.result.verification import Finding, Verification, counterpart
from scenes.checks import FloatArray, InputError
from scenes.pose import Pose
from scenes.run.mapping import trim
from scenes.surfaces.catalogue import Plane


def panels_record(completion: CompletedModel) -> dict[str, Any]:
    """Return the folds, corners and facets of the light model; world coordinates, metres."""
    panels, world = completion.panels(), completion.world_from_reference
    turn = world.rotation
    return {
        "folds": [_fold(fold, world.apply(fold.points), turn) for fold in panels.folds],
        "corners": [
            {
                "surfaces": list(corner.surfaces),
                "point": world.apply(corner.point[None])[0].tolist(),
                "covariance_m2": rotate_covariances(corner.covariance, turn).tolist(),
            }
            for corner in panels.corners
        ],
        "panels": {
            "triangles": len(panels.faces),
            "rest_triangles": len(panels.remainder.faces),
            "vertices": len(panels.vertices),
            "open_edges_m": dict(panels.open_m),
        },
    }


def _fold(fold: FoldEdge, points: FloatArray, turn: FloatArray) -> dict[str, Any]:
    return {
        "surfaces": list(fold.surfaces),
        "kind": fold.kind,
        "goes_on": list(fold.goes_on),
        "points": points.tolist(),
        "length_m": fold.length_m,
        "dihedral_deg": fold.dihedral_deg,
        "dihedral_sd_deg": fold.dihedral_sd_deg,
        "sd_m": fold.sd_m,
        "covariance_m2": rotate_covariances(fold.covariance, turn).tolist(),
        "measured_share": fold.measured_share,
    }


_OF_PAIR = (
    "overlap_m2",
    "offset_m",
    "offset_sd_m",
    "left_m",
    "contradicted_m2",
    "depth_m",
    "still_contradicted_m2",
)

ObservedDetail = Literal["auto", "full"]
"""How many of the measured points observed.ply holds: few enough to be looked at, or all of them."""


def completion_record(
    completion: CompletedModel,
    verification: Verification | None = None,
    *,
    observed: ObservedDetail = "auto",
) -> dict[str, Any]:
    """What `completion.json` holds; lengths in metres, areas in square metres, world coordinates.

    `observed` says how many points observed.ply is to hold: all of them, or of very many every k-th row and
    column.

    Raises InputError: `observed` is neither.
    """
    if observed not in get_args(ObservedDetail):
        raise InputError(f"observed is {observed!r}; known: auto, full")
    record: dict[str, Any] = {
        "warnings": list(completion.warnings),
        "edits": [edit_record(edit) for edit in completion.edits],
        "surfaces": [
            _surface_record(completion, number, surface)
            for number, surface in enumerate(completion.surfaces, start=1)
        ],
        "observed_m2": completion.observed_m2,
        "hypothesised_m2": completion.hypothesised_m2,
        "free_space_violation_m2": completion.free_space_violation_m2,
        "overlapping_claims_m2": completion.overlapping_claims_m2,
        **panels_record(completion),
        "mode": completion.mode,
        **completion.up.to_json(),
        "n_scans": len(completion.observations),
        "range_noise": [
            {
                "constant_m": seen.noise.constant_m,
                "linear": seen.noise.linear,
                "quadratic_per_m": seen.noise.quadratic_per_m,
            }
            for seen in completion.observations
        ],
        "flatness_m": completion.flatness_m,
        "choice": {**asdict(completion.choice), "only": list(completion.choice.only)},
        "projector": [seen.shadow._asdict() for seen in completion.observations],
        "remainder_step": completion.remainder.step,
        "observed_step": 1 if observed == "full" else completion.observed_step,
        "provenance": {number: {"name": name} for number, name in PROVENANCE_NAMES.items()},
    }
    pose = completion.world_from_reference
    record["features"] = [
        feature_record(replace(fit, geometry=moved_geometry(fit, pose.rotation, pose.translation)))
        for fit in completion.features
    ]
    if completion.flattened:
        record["flattening"] = whole_flattening(completion.flattened)
        for number, entry in enumerate(record["surfaces"], start=1):
            if entry["kind"] == Plane.kind:
                entry["flattening"] = surface_flattening(completion.flattened, number)
    record["rooms"] = _room_records(completion)
    if completion.relations is not None:
        record |= _relations_record(completion, completion.relations)
    if len(completion.observations) > 1:
        record["poses"] = _poses_record(completion)
    if len(completion.key_frames) < len(completion.observations):
        record["key_frames"] = [number + 1 for number in completion.key_frames]
    if completion.unconfirmed.n_regions:
        record["unconfirmed"] = completion.unconfirmed._asdict()
    if verification is not None:
        record["first_scan"] = _verification_record(completion, verification)
    return record


def _room_records(completion: CompletedModel) -> list[dict[str, Any]]:
    """The rooms that the scans show, storey by storey: outlines at their floors, world coordinates."""
    world, room, records = completion.world_from_reference, completion.completed.room, list[dict[str, Any]]()
    for storey, layout in enumerate(room.layouts, start=1):
        standing = np.mean([origin @ room.up for origin in room.origins])
        base_m = layout.floor_m if np.isfinite(layout.floor_m) else float(standing)
        height_m = layout.ceiling_m - layout.floor_m
        numbers = np.unique(layout.rooms[layout.rooms > 0]).tolist()
        for number, (area, enclosed) in zip(numbers, layout.outlines(), strict=True):
            rings = [
                world.apply(shapely.get_coordinates(ring)[:-1] @ layout.axes + base_m * room.up).tolist()
                for part in shapely.get_parts(area)
                for ring in (part.exterior, *part.interiors)
            ]
            records.append({
                "number": number,
                "storey": storey,
                "area_m2": area.area,
                "walled_share": enclosed,
                "has_scanner": number in layout.scanner_rooms,
                "height_m": height_m if np.isfinite(height_m) else None,
                "rings": rings,
            })  # fmt: skip
    return records


def _relations_record(completion: CompletedModel, relations: SurfaceRelations) -> dict[str, Any]:
    """What surfaces are to each other; those without a number are named by their own point, world frame."""
    world, graph = completion.world_from_reference, relations.graph
    names = [
        number
        or {"point": world.apply(np.array(fit.parameters()["point"])).tolist(), "kind": fit.surface.kind}
        for number, fit in zip(relations.numbers, graph.fits, strict=True)
    ]
    moved = [
        {"surface": name, "moved_sd": moved, "off_m": off, "is_moved": is_moved}
        for name, moved, off, is_moved in zip(
            names, graph.moved_sd, relations.off_m, relations.is_moved, strict=True
        )
    ]
    return {
        "relations": relation_records(graph, relations.before, names, world=world),
        "direction_frames": frame_records(graph, names, world.rotation),
        "degrees_of_freedom": freedom_record(graph),
        "built_within": {"angle_deg": graph.options.tolerance_deg, "length_m": graph.options.tolerance_m},
        "moved_by_relations": moved,
    }


def _poses_record(completion: CompletedModel) -> dict[str, Any]:
    """What scans say of their poses: where each stands, how far moved and unsure, and pairs how far apart."""
    registration = completion.registration
    scans = [
        {
            "scan": number,
            "world_from_sensor": (
                completion.world_from_reference @ seen.scan.world_from_sensor
            ).matrix.tolist(),
            "moved_m": float(moved),
            "error_m": seen.pose_error_m,
        }
        for number, (moved, seen) in enumerate(
            zip(registration.moved_m, completion.observations, strict=True), start=1
        )
    ]
    pairs = [
        {"scans": [pair.first + 1, pair.second + 1], **{name: getattr(pair, name) for name in _OF_PAIR}}
        for pair in registration.pairs
    ]
    return {"stated_m": registration.stated_m, "scans": scans, "pairs": pairs}


def _verification_record(completion: CompletedModel, verification: Verification) -> dict[str, Any]:
    """What later scans say of what the first one alone inferred; surfaces numbered as in the completion."""
    findings = (Finding.CONFIRMED, Finding.REFUTED, Finding.HIDDEN)
    surfaces = [
        {
            "surface": counterpart(surface, completion),
            "anchor": surface.anchor.tolist(),
            **{f"{finding.name.lower()}_m2": surface.area_m2(finding) for finding in findings},
        }
        for surface in verification.surfaces
    ]
    totals = {f"{finding.name.lower()}_m2": verification.area_m2(finding) for finding in findings}
    return {**totals, "surfaces": surfaces}


def _surface_record(completion: CompletedModel, number: int, surface: DerivedSurface) -> dict[str, Any]:
    patch, world = surface.patch, completion.world_from_reference
    fit = patch.source.fit
    trim()
    return {
        "id": number,
        "kind": fit.surface.kind,
        "anchor": completion.anchor(number).tolist(),
        "parameters": surface_parameters(fit.surface.transform(world)),
        "standard_deviation": patch.stated.parameter_deviations(),
        "rms": fit.rms,
        "n": fit.n,
        "n_parts": patch.source.n_parts,
        "observed_m2": patch.observed_m2,
        "hypothesised_m2": patch.hypothesised_m2,
        "cell_m": float(np.sqrt(patch.grid.cell_area)),
        "encloses": patch.limits.encloses,
        "feature": patch.feature,
        "texture": _texture_record(completion, number),
        "user": {"actions": list(patch.verdict.actions), **asdict(surface.effect)},
        "openings": [
            {
                "area_m2": opening.area_m2,
                "seen_share": opening.seen_share,
                "provenance": "user" if opening.declared else "inferred",
                "feature": opening.feature,
                "points": world.apply(opening.points),
            }
            for opening in surface.openings
        ],
        "boundary": [
            {
                "kind": segment.kind,
                "provenance": segment.provenance,
                "confidence": segment.confidence,
                "points": world.apply(segment.points),
            }
            for segment in surface.boundary
        ],
    }


def _texture_record(completion: CompletedModel, number: int) -> dict[str, Any] | None:
    """How a surface's hidden part got its colour; None without texture."""
    texture = completion.textures[number - 1] if completion.textures else None
    if texture is None:
        return None
    return {
        "texel_m": float(np.sqrt(texture.grid.cell_area)),
        "measured_texels": int(np.count_nonzero(texture.measured)),
        "synthesised_texels": texture.n_synthesised,
        "synthesised_m": texture.synthesised_m,
        "samples": texture.n_samples,
        "window": texture.window,
        "search": texture.search,
        "is_plain": texture.is_plain,
        "confidence": texture.confidence,
        "verbatim_share": texture.verbatim_share,
        "is_doubtful": texture.is_doubtful,
    }


FORMAT = "unseen polygons 1"
_OF_SIDES = ("sd_m", "inwards_m", "outwards_m", "measured")
_SHORT = 3  # samples, a cell apart: what is shorter takes after what comes before it


def polygons_record(completion: CompletedModel, frame: Pose | None = None) -> dict[str, Any]:
    """Return what `polygons.json` holds: planes as polygons, world coordinates, metres.

    `frame`: from the working frame to another one than the world, such as that of drawings.

    Rings run anticlockwise seen from the normal's side, holes clockwise; they do not repeat their first
    point, and edge k leads from point k to the next. An edge is "measured" where the surface was measured
    up to it, else "inferred"; `kind` and `provenance` are those of completion.json. Outlines are those of the
    cells, laid on the surface's straight edges and on where it meets what encloses the room (`guides_of`),
    elsewhere straightened to within a cell; parts and holes of fewer than nine cells are left out.
    """
    world = completion.world_from_reference if frame is None else frame
    planes = [
        _surface(completion, number, surface, world)
        for number, surface in enumerate(completion.surfaces, start=1)
        if isinstance(surface.patch.grid.surface, Plane)
    ]
    return {"format": FORMAT, "unit": "m", "mode": completion.mode, "surfaces": planes}


def _surface(completion: CompletedModel, number: int, surface: DerivedSurface, world: Pose) -> dict[str, Any]:
    trim()
    patch = surface.patch
    normal = world.rotate(patch.grid.surface.normal(np.zeros((1, 3))))[0]
    area, boundary = surface.polygon, NearOutline.of(patch.grid, surface.outline)
    return {
        "id": number,
        "role": patch.limits.role or "surface",
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
                "outer": _ring_record(world, patch, boundary, polygon.exterior, anticlockwise=True),
                "holes": [
                    _ring_record(world, patch, boundary, hole, anticlockwise=False)
                    for hole in polygon.interiors
                ],
            }
            for polygon in polygon_parts(area)
        ],
        "openings": [
            _opening_record(completion, patch, normal, opening, world) for opening in surface.openings
        ],
    }


def _ring_record(
    world: Pose, patch: Patch, boundary: NearOutline, ring: Any, *, anticlockwise: bool
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
    return {"points": world.apply(local).tolist(), "edges": edges}


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
    states = list(zip(known.kinds[index].tolist(), known.provenances[index].tolist(), strict=True))
    for k, (begin, n) in enumerate(zip(first_of.tolist(), count.tolist(), strict=True)):
        for first, last in runs_of(states[begin : begin + n], _SHORT):
            kind, provenance = states[begin + first]
            confidence = known.confidence[index[begin + first : begin + last + 1]]
            edge = {
                "state": "measured" if provenance == "measured" else "inferred",
                "kind": kind,
                "provenance": provenance,
                "confidence": float(np.mean(confidence)),
            }
            yield corners[k] + first / n * along[k], edge


def _opening_record(
    completion: CompletedModel, patch: Patch, normal: FloatArray, opening: SurfaceOpening, world: Pose
) -> dict[str, Any]:
    """An opening with its kind and its size along the level and upwards, metres."""
    points, here = world.apply(opening.points), completion.up_in_reference
    up = world.rotate(here[None])[0]
    is_wall = opening.feature > 0 or patch.limits.role == "wall"
    farthest = np.linalg.svd(points - points.mean(axis=0))[2][0]  # the direction in which it reaches most
    across = np.cross(up, normal) if is_wall else farthest
    across /= np.linalg.norm(across)
    other = np.cross(normal, across)
    extent = [float(np.ptp(points @ direction)) for direction in (across, other)]
    kind = "opening"
    if is_wall:
        lowest = float((patch.grid.centres()[patch.observed.ravel()] @ here).min())
        kind = "door" if float((opening.points @ here).min()) < lowest + DOOR_M else "window"
    return {
        "kind": kind,
        "width_m": extent[0],
        "height_m": extent[1],
        "area_m2": opening.area_m2,
        "seen_share": opening.seen_share,
        "provenance": "user" if opening.declared else "inferred",
        "points": points.tolist(),
        "sides": [
            {"sd_m": sd, "inwards_m": inwards, "outwards_m": outwards, "measured_share": measured}
            for sd, inwards, outwards, measured in zip(
                *(getattr(opening.sides, name).tolist() for name in _OF_SIDES), strict=True
            )
        ],
    }
