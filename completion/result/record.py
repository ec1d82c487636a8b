# SPDX-License-Identifier: MIT
"""Record: a completed model as files and pictures show it: named textured pieces, points, and JSON."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, replace
from typing import Any, Literal, get_args

import numpy as np

from completion.edits.file import edit_record
from completion.extension.patch import Provenance
from completion.features.engine.template import feature_record, moved_geometry
from completion.fitting.result import surface_parameters
from completion.panels.model import PanelPart
from completion.relations.graph import frame_records, freedom_record, relation_records
from completion.relations.pipeline import FoundRelations
from completion.result.completed_model import CompletedModel, DerivedSurface
from completion.result.flat_scans import surface_flattening, whole_flattening
from completion.result.labelled_points import PROVENANCE_NAMES
from completion.result.panel_files import panels_record
from completion.result.verification import Finding, Verification, counterpart
from scenes.checks import ColourArray, InputError
from scenes.io.e57_writer import InferredPoints
from scenes.mesh.blocks import in_blocks
from scenes.mesh.labelled_mesh import Appearance, LabelledMesh
from scenes.mesh.mesh_parts import MeshPart
from scenes.run.mapping import trim
from scenes.surfaces.catalogue import Plane

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
OBSERVED_GREY, HYPOTHESISED_BLUE = (0.72, 0.72, 0.70), (0.35, 0.55, 0.85)
"""Colours of surface without texture, sRGB in 0..1."""


def model_parts(completion: CompletedModel) -> list[MeshPart]:
    """Return the model in world coordinates; a part for each surface and state, and one for the rest.

    They are called `observed 1 plane`, `hypothesised 1 plane` and so on, and `observed remainder`: a
    hypothesis can never pass for a measurement. Their textures lie on the pages of one atlas; without
    texture, parts have the colour of their state. Those of large models are in blocks of space.
    """
    parts, derived = [], completion.derived
    panels = derived.panels
    for index, surface in enumerate(derived.surfaces):
        trim()
        own = panels.face_surface == index + 1
        for state, kept in (
            ("observed", own & panels.is_measured),
            ("hypothesised", own & ~panels.is_measured),
        ):
            if kept.any():
                name = f"{state} {index + 1} {surface.patch.grid.surface.kind}"
                parts.append(_surface_part(completion, index, panels.part(kept), name))
    rest = completion.derived.light_remainder
    if len(rest.faces):
        vertices = completion.world_from_reference.apply(rest.vertices)
        faces = rest.faces.astype(np.int64)
        parts.append(MeshPart("observed remainder", vertices, faces, 0, rest.colour))
    return in_blocks(parts)


def _surface_part(completion: CompletedModel, index: int, mesh: PanelPart, name: str) -> MeshPart:
    """One state of a surface, with its page of the atlas or the state's colour."""
    atlas = completion.derived.atlas
    page = int(atlas.page[index])
    vertices = completion.world_from_reference.apply(mesh.vertices)
    faces = mesh.faces
    if page < 0:
        tint = OBSERVED_GREY if name.startswith("observed") else HYPOTHESISED_BLUE
        return MeshPart(name, vertices, faces, index + 1, _plain(tint, len(vertices)))
    uv = atlas.coordinates(index, mesh.uv).astype(np.float32)
    white = _plain((1.0, 1.0, 1.0), len(vertices))
    return MeshPart(name, vertices, faces, index + 1, white, image=atlas.pages[page], uv=uv)


def _plain(tint: tuple[float, float, float], n: int) -> ColourArray:
    return np.tile(np.rint(np.array(tint) * 255).astype(np.uint8), (n, 1))


def display_mesh(
    completion: CompletedModel, *, hypothesised: bool = True, mark: bool = False
) -> LabelledMesh:
    """The model as one textured mesh in world coordinates, for pictures: surface 0 observed, 1 not.

    Inferred area is shown if `hypothesised`; `mark` paints it in one colour instead of its texture.
    """
    places, corners, colours, labels, face_image, corner_uv = [], [], [], [], [], []
    atlas, n_places = completion.derived.atlas, 0
    for one in completion.derived.textured:
        trim()
        state = int(one.provenance != Provenance.MEASURED)
        if state and not hypothesised:
            continue
        page, faces = -1 if mark and state else one.page, one.part.faces
        places.append(one.part.vertices)
        corners.append(faces.astype(np.int32) + np.int32(n_places))
        n_places += len(one.part.vertices)
        tint = (OBSERVED_GREY, HYPOTHESISED_BLUE)[state] if page < 0 else (1.0, 1.0, 1.0)
        colours.append(np.broadcast_to(np.array(tint, np.float32), (len(faces), 3, 3)))
        labels.append(np.full(len(faces), state, np.int32))
        face_image.append(np.full(len(faces), page, np.int32))
        corner_uv.append(one.uv[faces])
    rest = completion.derived.light_remainder
    places.append(rest.vertices)
    corners.append(rest.faces.astype(np.int32) + np.int32(n_places))
    colours.append(rest.colour[rest.faces].astype(np.float32) / np.float32(255))
    labels.append(np.zeros(len(rest.faces), np.int32))
    face_image.append(np.full(len(rest.faces), -1, np.int32))
    corner_uv.append(np.zeros((len(rest.faces), 3, 2)))
    has_pages = bool(len(atlas.pages))
    look = Appearance(
        np.concatenate(colours),
        atlas.pages,
        np.concatenate(face_image) if has_pages else None,
        np.concatenate(corner_uv).astype(np.float32) if has_pages else None,
    )
    vertices = completion.world_from_reference.apply(np.concatenate(places))
    return LabelledMesh(vertices, np.concatenate(corners), np.concatenate(labels), look)


def inferred_points(completion: CompletedModel) -> Iterator[InferredPoints]:
    """Yield the vertices of what is inferred, surface by surface, in the world."""
    for points in completion.derived.hypothesised_parts():
        number = int(points.surface[0])
        yield InferredPoints(
            name=f"inferred {number} {completion.patches[number - 1].grid.surface.kind}",
            points=completion.world_from_reference.apply(points.vertices),
            colour=points.colour,
            surface=points.surface,
            provenance=points.provenance,
            confidence=points.confidence,
            sd=points.sd,
            legend=dict(PROVENANCE_NAMES),
        )


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
            for number, surface in enumerate(completion.derived.surfaces, start=1)
        ],
        "observed_m2": completion.observed_m2,
        "hypothesised_m2": completion.hypothesised_m2,
        "free_space_violation_m2": completion.free_space_violation_m2,
        "overlapping_claims_m2": completion.overlapping_claims_m2,
        **panels_record(completion),
        "mode": completion.mode,
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
        "remainder_step": completion.derived.remainder.step,
        "observed_step": 1 if observed == "full" else completion.derived.observed_step,
        "provenance": {number: {"name": name} for number, name in PROVENANCE_NAMES.items()},
    }
    pose = completion.world_from_reference
    record["features"] = [
        feature_record(replace(fit, geometry=moved_geometry(fit, pose.rotation, pose.translation)))
        for fit in completion.features
    ]
    if completion.flattened:
        record["flattening"] = whole_flattening(completion.flattened)
        for number, one in enumerate(record["surfaces"], start=1):
            if one["kind"] == Plane.kind:
                one["flattening"] = surface_flattening(completion.flattened, number)
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


def _relations_record(completion: CompletedModel, found: FoundRelations) -> dict[str, Any]:
    """What surfaces are to each other; those without a number are named by their own point, world frame."""
    world, graph = completion.world_from_reference, found.graph
    names = [
        number
        or {"point": world.apply(np.array(fit.parameters()["point"])).tolist(), "kind": fit.surface.kind}
        for number, fit in zip(found.numbers, graph.fits, strict=True)
    ]
    moved = [
        {"surface": name, "moved_sd": moved, "off_m": off, "is_moved": is_moved}
        for name, moved, off, is_moved in zip(names, graph.moved_sd, found.off_m, found.is_moved, strict=True)
    ]
    return {
        "relations": relation_records(graph, found.before, names, world=world),
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
        {"scans": [one.first + 1, one.second + 1], **{name: getattr(one, name) for name in _OF_PAIR}}
        for one in registration.pairs
    ]
    return {"stated_m": registration.stated_m, "scans": scans, "pairs": pairs}


def _verification_record(completion: CompletedModel, verification: Verification) -> dict[str, Any]:
    """What later scans say of what the first one alone inferred; surfaces numbered as in the completion."""
    found = (Finding.CONFIRMED, Finding.REFUTED, Finding.HIDDEN)
    surfaces = [
        {
            "surface": counterpart(surface, completion),
            "anchor": surface.anchor.tolist(),
            **{f"{finding.name.lower()}_m2": surface.area_m2(finding) for finding in found},
        }
        for surface in verification.surfaces
    ]
    totals = {f"{finding.name.lower()}_m2": verification.area_m2(finding) for finding in found}
    return {**totals, "surfaces": surfaces}


def _surface_record(completion: CompletedModel, number: int, surface: DerivedSurface) -> dict[str, Any]:
    patch, world = surface.patch, completion.world_from_reference
    fit = patch.source.fit
    trim()
    return {
        "id": number,
        "kind": fit.surface.kind,
        "anchor": completion.anchor(number).tolist(),
        "parameters": surface_parameters(fit.surface.transformed(world)),
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
