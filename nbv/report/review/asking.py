# SPDX-License-Identifier: MIT
"""Asking: what is known at a place of a completion: what it is, why it ends there, what hides the rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from completion.export.building.model import BuildingElement
from completion.export.dimension import LEVEL, Support, half_interval
from completion.extension.patch import Patch
from completion.result.completion import Completion
from completion.result.labelled_points import PROVENANCE_NAMES
from completion.result.unknown import unknown_m2
from nbv.run.plain_words import HOW_ITS_END_IS_KNOWN, WHY_INFERRED, WHY_IT_ENDS
from scenes.checks import FloatArray, InputError
from scenes.surfaces.plane import Plane

_NEAR_M = 0.05  # from a clicked place to the surface that is meant
_SNAP_M = 0.3  # from a clicked place to an edge or plane that a cut may snap to
_LEAST_SHARE = 0.02  # of an outline, or of what is hidden, that is worth naming
_LEVEL_COSINE = 0.999  # of planes that are parallel: neither ends the other
_MOST_SNAPS = 5


@dataclass(frozen=True, slots=True, eq=False)
class Snap:
    """Where a surface may end near a place: a sentence, and the edit's `plane` or `line`."""

    sentence: str
    cut: dict[str, Any]


def surface_at(completion: Completion, place: FloatArray) -> int | None:
    """Return the number, from 1, of the surface that is at a place (3,) of the world; None where none is.

    Of several, what was measured there or is inferred goes before what only lies in the same plane.
    """
    found: list[tuple[int, float, int]] = []
    for number, patch in enumerate(completion.patches, start=1):
        here = completion.world_from_reference.inverse().apply(place[None])
        off = abs(float(patch.grid.surface.distance(here)[0]))
        if off <= _NEAR_M:
            element = _element(completion, number)
            rank = 0 if element.provenance(place) >= 0 else 1
            if rank == 0 or _is_unknown(patch, here):
                found.append((rank, off, number))
    return min(found)[2] if found else None


def _is_unknown(patch: Patch, here: FloatArray) -> bool:
    index, cell = patch.grid.cells_of(here)
    return bool(len(index)) and bool(patch.is_within.ravel()[cell[0]])


def _element(completion: Completion, number: int) -> BuildingElement:
    patch = completion.patches[number - 1]
    return BuildingElement(number, patch.grid.surface.kind, patch, completion.world_from_reference)


def facts_of(completion: Completion, number: int, place: FloatArray | None = None) -> dict[str, Any]:
    """Return what is known of a surface, and of a place (3,) on it.

    Raises InputError: there is no such surface.
    """
    if not 1 <= number <= len(completion.patches):
        raise InputError(f"there is no surface {number}: there are {len(completion.patches)}, from 1")
    patch, derived = completion.patches[number - 1], completion.surfaces[number - 1]
    element = _element(completion, number)
    anchor = completion.anchor(number)
    facts: dict[str, Any] = {
        "surface": number,
        "kind": patch.grid.surface.kind,
        "anchor": anchor.tolist(),
        "measured_m2": patch.observed_m2,
        "inferred_m2": patch.hypothesised_m2,
        "unknown_m2": unknown_m2(patch),
        "sd_mm": 1000 * element.sd_m(anchor),
        "ends": _ends(derived.boundary),
        "hidden_by": _hidden_by(patch),
        "seen_by": _seen_by(completion, patch),
        "edits": list(patch.verdict.actions),
        "openings": len(derived.openings),
        "relations": _relations(completion, number),
    }
    if place is not None:
        provenance = element.provenance(place)
        facts["place"] = {
            "at": place.tolist(),
            "state": "unknown" if provenance < 0 else "measured" if provenance == 0 else "inferred",
            "provenance": WHY_INFERRED.get(
                PROVENANCE_NAMES.get(str(provenance), ""), "neither measured nor inferred"
            ),
            "probability": element.confidence(place),
            "sd_mm": 1000 * element.sd_m(place),
        }
    return facts


def _ends(boundary: Sequence[Any]) -> list[dict[str, Any]]:
    """Why a surface ends where it does: metres of its outline by reason, the longest first."""
    metres: dict[tuple[str, str], float] = {}
    for segment in boundary:
        length = float(np.linalg.norm(np.diff(segment.points, axis=0), axis=1).sum())
        key = segment.kind, segment.provenance
        metres[key] = metres.get(key, 0.0) + length
    ordered = sorted(metres.items(), key=lambda one: -one[1])
    return [
        {
            "why": WHY_IT_ENDS.get(kind, kind),
            "known": HOW_ITS_END_IS_KNOWN.get(provenance, provenance),
            "length_m": length,
        }
        for (kind, provenance), length in ordered
        if length > _LEAST_SHARE * sum(metres.values())
    ]


def _hidden_by(patch: Patch) -> list[dict[str, Any]]:
    """Which surfaces stand before its hidden cells (0: what belongs to none), with their share."""
    hidden = patch.is_within & ~patch.observed & (patch.evidence.occluder >= 0)
    behind = patch.evidence.occluder[hidden]
    if not len(behind):
        return []
    shares = np.bincount(behind) / len(behind)
    told = [(int(k), float(shares[k])) for k in np.argsort(-shares) if shares[k] >= _LEAST_SHARE]
    return [{"surface": number, "share": share} for number, share in told]


def _seen_by(completion: Completion, patch: Patch) -> list[dict[str, Any]]:
    """Which scans measured it, with their pixels."""
    pairs = zip(completion.observations, patch.source.pixels, strict=True)
    return [{"scan": seen.scan.name, "pixels": len(held.flat)} for seen, held in pairs if len(held.flat)]


def _relations(completion: Completion, number: int) -> list[str]:
    """What it is to others, of relations that hold."""
    related = completion.relations
    if related is None:
        return []
    told = []
    for relation in related.graph.relations:
        members = [related.numbers[k] for k in relation.surfaces]
        if relation.holds and number in members:
            others = [str(one) for one in members if one != number]
            told.append(f"{relation.kind.replace('_', ' ')} {' '.join(others)}".strip())
    return told


def distance_between(completion: Completion, places: FloatArray) -> dict[str, Any]:
    """Return how far two places (2, 3) of the world are apart, with the 95 % interval, metres.

    The interval is that of the surfaces under both places; None where one of them lies on none.
    """
    length = float(np.linalg.norm(places[1] - places[0]))
    numbers = [surface_at(completion, place) for place in places]
    half = None
    if length > 0 and all(number is not None for number in numbers):
        along = (places[1] - places[0]) / length
        supports = []
        for number, place, way in zip(numbers, places, (along, -along), strict=True):
            element = _element(completion, int(number or 0))
            supports.append(Support(element, place, float(element.normal_at(place) @ way)))
        found = half_interval(supports, completion.errors)
        half = found if np.isfinite(found) else None
    return {"length_m": length, "half_m": half, "level": LEVEL, "surfaces": numbers}


def snaps_at(completion: Completion, number: int, place: FloatArray) -> list[Snap]:
    """Return where a surface may be ended near a place (3,): at planes, along measured edges, at a level."""
    facts_of(completion, number)
    surface = completion.patches[number - 1].grid.surface
    here = completion.world_from_reference.inverse().apply(place[None])[0]
    normal = surface.normal(here[None])[0]
    found: list[tuple[float, Snap]] = []
    for other, patch in enumerate(completion.patches, start=1):
        plane = patch.grid.surface
        if other == number or not isinstance(plane, Plane):
            continue
        off = abs(float(plane.distance(here[None])[0]))
        if off <= _SNAP_M and abs(float(plane.normal_direction @ normal)) < _LEVEL_COSINE:
            world = plane.transform(completion.world_from_reference)
            cut = {"point": world.point.tolist(), "normal": world.normal_direction.tolist()}
            found.append((off, Snap(f"at surface {other}, {1000 * off:.0f} mm from here", {"plane": cut})))
    for segment in completion.surfaces[number - 1].boundary:
        if segment.provenance != "measured" or segment.kind not in ("crease", "edge"):
            continue
        away = np.linalg.norm(segment.points - here, axis=1)
        if away.min() <= _SNAP_M and np.linalg.norm(segment.points[-1] - segment.points[0]) > 1e-3:
            ends = completion.world_from_reference.apply(segment.points[[0, -1]])
            told = f"along a measured edge, {1000 * away.min():.0f} mm from here"
            found.append((float(away.min()), Snap(told, {"line": ends.tolist()})))
    found.sort(key=lambda one: one[0])
    snaps = [snap for _, snap in found[:_MOST_SNAPS]]
    up = completion.up.direction
    if abs(float(completion.world_from_reference.rotate(normal[None])[0] @ up)) < _LEVEL_COSINE:
        snaps.append(Snap("at this height", {"plane": {"point": place.tolist(), "normal": up.tolist()}}))
    across = np.cross(completion.world_from_reference.rotate(normal[None])[0], up)
    if np.linalg.norm(across) > 1e-3:
        upright = {"point": place.tolist(), "normal": (across / np.linalg.norm(across)).tolist()}
        snaps.append(Snap("upright through here", {"plane": upright}))
    return snaps


def rectangle(completion: Completion, number: int, places: FloatArray) -> FloatArray:
    """Return the corners (4, 3) of the rectangle on a plane with two opposite corners (2, 3), world.

    Its sides are level and upright, of a level plane along its own axes. Raises InputError: no plane.
    """
    facts_of(completion, number)
    surface = completion.patches[number - 1].grid.surface
    if not isinstance(surface, Plane):
        raise InputError(f"surface {number} is a {surface.kind}: draw openings on planes")
    plane = surface.transform(completion.world_from_reference)
    normal, up = plane.normal_direction, completion.up.direction
    along = np.cross(up, normal)
    if np.linalg.norm(along) < 0.1:
        along = plane.from_uv(np.array([[1.0, 0.0]]))[0] - plane.from_uv(np.zeros((1, 2)))[0]
    along /= np.linalg.norm(along)
    upwards = np.cross(normal, along)
    on = places - plane.distance(places)[:, None] * normal
    move = on[1] - on[0]
    across, rise = float(move @ along), float(move @ upwards)
    if min(abs(across), abs(rise)) < 1e-3:
        raise InputError("both corners are on one line: click two opposite corners of the opening")
    return np.stack(
        [on[0], on[0] + across * along, on[0] + across * along + rise * upwards, on[0] + rise * upwards]
    )


def hidden_box(completion: Completion, number: int) -> FloatArray:
    """Return the box (2, 3) of the world around what is unknown or inferred of a surface.

    Raises InputError: all of it was measured.
    """
    facts_of(completion, number)
    derived = completion.surfaces[number - 1]
    parts = [derived.unknown, derived.inferred_cells]
    points = np.concatenate([np.zeros((0, 3)), *(part.vertices[np.unique(part.faces)] for part in parts)])
    if not len(points):
        raise InputError(f"nothing of surface {number} is hidden")
    world = completion.world_from_reference.apply(points)
    return np.stack([world.min(axis=0), world.max(axis=0)])
