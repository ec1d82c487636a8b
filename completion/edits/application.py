# SPDX-License-Identifier: MIT
"""Editing: a person's edits carried out on the surfaces that were found, before they are continued."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from shapely import Polygon

from completion.edits.edit import Anchor, Edit, SurfaceEdits, Wish, outline_uv
from completion.merging.merged_surface import MergedSurface
from completion.observe.observation import Observation, PixelSet, ScanPixels
from completion.observe.refitting import refit
from scenes.checks import FloatArray, InputError
from scenes.pose import Pose
from scenes.surfaces.catalogue import Plane

_PICK_M = 0.05  # within which a place that a person names lies on a surface
_FEWEST = 12  # pixels of a part
_INNER = 0.9  # of a merged surface on the inner side of an end that one of its parts had


@dataclass(frozen=True, slots=True, eq=False)
class EditedSurface:
    """A surface with what a person says of it; working frame."""

    surface: MergedSurface
    edits: SurfaceEdits = field(default_factory=SurfaceEdits)


@dataclass(frozen=True, slots=True, eq=False)
class _Place:
    """Where edits are carried out."""

    observations: Sequence[Observation]
    reference_from_world: Pose
    flatness_m: float


def apply_edits(
    surfaces: Sequence[MergedSurface],
    edits: Sequence[Edit],
    observations: Sequence[Observation],
    world_from_reference: Pose,
    flatness_m: float,
) -> list[EditedSurface]:
    """Join and split surfaces as the edits say, in their order; note the other edits with each surface.

    Parameters
    ----------
    surfaces : sequence of MergedSurface
        As found, working frame.
    edits : sequence of Edit
        World coordinates.
    observations : sequence of Observation
        The scans.
    world_from_reference : Pose
        From the working frame to the world.
    flatness_m : float
        How far surfaces differ from their ideal form, metres.

    Returns
    -------
    list of Edited
        Largest first.

    Raises
    ------
    InputError
        No surface, or one of another kind, where an edit says; a part that determines no surface; an outline
        off its surface.
    """
    place = _Place(observations, world_from_reference.inverse(), flatness_m)
    edited = [EditedSurface(surface) for surface in surfaces]
    for edit in edits:
        results = [
            surface_at(edited, anchor, edit.source, observations, world_from_reference)
            for anchor in edit.surfaces
        ]
        numbers = list(dict.fromkeys(results))
        chosen = [edited[number] for number in numbers]
        others = [surface for number, surface in enumerate(edited) if number not in numbers]
        if edit.action == "merge":
            edited = [*others, _merge(chosen, edit, place)]
        elif edit.action == "split":
            edited = [*others, *_split(chosen[0], edit, place)]
        else:
            edited[numbers[0]] = _with_edit(chosen[0], edit, place)
    return sorted(edited, key=lambda surface: -surface.surface.n_pixels)


def surface_at(
    edited: Sequence[EditedSurface],
    anchor: Anchor,
    source: str,
    observations: Sequence[Observation],
    world_from_reference: Pose,
) -> int:
    """Return which surface was measured at an anchor, by its place among `edited`.

    Raises InputError, which begins with the `source` that names it: nothing, or one of another kind, was.
    """
    point = world_from_reference.inverse().apply(anchor.point)
    away = [
        float(np.min(np.linalg.norm(surface.surface.points(observations) - point, axis=1), initial=np.inf))
        for surface in edited
    ]
    nearest = int(np.argmin(away)) if away else -1
    x, y, z = anchor.point
    where = f"{source}: {anchor.name} should be at ({x:.3f}, {y:.3f}, {z:.3f})"
    cure = "was it meant for other scans? start from the completion.json of these"
    if nearest < 0 or away[nearest] > _PICK_M:
        gap = f"the nearest surface was measured {away[nearest]:.2f} m away" if edited else "there is none"
        raise InputError(f"{where}, but {gap}; {cure}")
    kind = edited[nearest].surface.fit.surface.kind
    if anchor.kind not in (None, kind):
        raise InputError(f"{where} and be a {anchor.kind}, but there is a {kind}; {cure}")
    return nearest


def anchor_point(surface: MergedSurface, observations: Sequence[Observation]) -> FloatArray:
    """The measured point (3,) of a surface that lies deepest inside it, working frame."""
    largest, _ = max(surface.pixels.held, key=lambda pair: len(pair[1]))
    inside = np.pad(surface.pixels[largest].mask.astype(np.uint8), 1)
    depth = cv2.distanceTransform(inside, cv2.DIST_L2, cv2.DIST_MASK_5)[1:-1, 1:-1]
    row, column = np.unravel_index(int(np.argmax(depth)), depth.shape)
    return np.asarray(observations[largest].points_at(np.array([row * depth.shape[1] + column]))[0])


def _merge(parts: Sequence[EditedSurface], edit: Edit, place: _Place) -> EditedSurface:
    """All parts as one surface, fitted anew to all their pixels from the largest one."""
    if len(parts) < 2:
        raise InputError(f"{edit.source}: all surfaces that it names are one surface already")
    largest = max((part.surface for part in parts), key=lambda surface: surface.n_pixels)
    pixels = ScanPixels.of(
        [
            PixelSet.union(several, several[0].shape)
            for several in zip(*(part.surface.pixels for part in parts), strict=True)
        ]
    )
    n_parts = sum(part.surface.n_parts for part in parts)
    surface = _refit(MergedSurface(largest.fit, pixels, n_parts), edit, place)
    several_edits = [part.edits for part in parts]
    actions = tuple(action for edits in several_edits for action in edits.actions)
    points = surface.points(place.observations)
    ends = [end for edits in several_edits for end in edits.ends]
    return EditedSurface(
        surface,
        SurfaceEdits(
            (*actions, "merge"),
            tuple(end for end in ends if np.mean(end.distance(points) > 0) > _INNER),
            tuple(wish for edits in several_edits for wish in edits.wishes),
            tuple(outline for edits in several_edits for outline in edits.openings),
        ),
    )


def _split(whole: EditedSurface, edit: Edit, place: _Place) -> list[EditedSurface]:
    """The surface as two, each fitted to its own pixels, that end where it is cut."""
    cut = _cut(whole.surface, edit, place)
    parts = []
    for side in (cut, cut.flip()):
        pixels = ScanPixels.of(
            [
                replace(held, flat=held.flat[side.distance(seen.points_at(held.flat)) > 0])
                for held, seen in zip(whole.surface.pixels, place.observations, strict=True)
            ]
        )
        n_pixels = pixels.n_pixels
        if n_pixels < _FEWEST:
            raise InputError(
                f"{edit.source}: only {n_pixels} of {whole.surface.n_pixels} measured pixels lie on one side "
                f"of its line; each part needs at least {_FEWEST}"
            )
        part = _refit(MergedSurface(whole.surface.fit, pixels, 1), edit, place)
        edits = whole.edits
        noted = replace(edits, actions=(*edits.actions, "split"), ends=(*edits.ends, side))
        parts.append(EditedSurface(part, noted))
    return parts


def _refit(surface: MergedSurface, edit: Edit, place: _Place) -> MergedSurface:
    labels = [pixels.mask.astype(np.int32) for pixels in surface.pixels]
    (fit,) = refit([surface.fit.surface], place.observations, labels, place.flatness_m, n_rounds=2)
    if fit is None:
        kind = surface.fit.surface.kind
        raise InputError(f"{edit.source}: {surface.n_pixels} measured pixels determine no {kind}")
    return replace(surface, fit=fit)


def _with_edit(surface: EditedSurface, edit: Edit, place: _Place) -> EditedSurface:
    """The surface with an edit that says how it is to be continued."""
    edits = replace(surface.edits, actions=(*surface.edits.actions, edit.action))
    if edit.action == "end":
        return replace(surface, edits=replace(edits, ends=(*edits.ends, _cut(surface.surface, edit, place))))
    outline = None if edit.outline is None else _on_surface(surface.surface, edit.outline, edit, place)
    if edit.action == "opening" and outline is not None:
        return replace(surface, edits=replace(edits, openings=(*edits.openings, outline)))
    wish = Wish(edit.action == "accept", outline)
    return replace(surface, edits=replace(edits, wishes=(*edits.wishes, wish)))


def _cut(surface: MergedSurface, edit: Edit, place: _Place) -> Plane:
    """The plane of a cut, working frame, most of the measured surface on its normal's side."""
    if isinstance(edit.cut, Plane):
        plane = edit.cut.transform(place.reference_from_world)
    else:
        start, end = _on_surface(surface, edit.cut, edit, place)
        along = end - start
        across = np.cross(along, surface.fit.surface.normal((start + end)[None] / 2)[0])
        if np.linalg.norm(across) < 0.1 * np.linalg.norm(along):
            raise InputError(
                f"{edit.source}: its line is perpendicular to the surface; draw it along the surface"
            )
        plane = Plane(start, across)
    side = np.median(plane.distance(surface.points(place.observations)))
    return plane if side >= 0 else plane.flip()


def _on_surface(surface: MergedSurface, points: FloatArray | None, edit: Edit, place: _Place) -> FloatArray:
    """Points (n, 3) that a person named, on the surface, working frame."""
    moved = place.reference_from_world.apply(np.asarray(points, dtype=np.float64))
    shape = surface.fit.surface
    off = np.abs(shape.distance(moved))
    if off.max() > _PICK_M:
        number = int(np.argmax(off))
        raise InputError(
            f"{edit.source}: point {number + 1} lies {off[number]:.2f} m off the surface; "
            f"give points within {_PICK_M} m of it"
        )
    if edit.outline is not None and not Polygon(outline_uv(shape, moved)).is_valid:
        raise InputError(f"{edit.source}: the outline crosses itself; give its corners in order")
    return moved
