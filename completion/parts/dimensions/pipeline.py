# SPDX-License-Identifier: MIT
"""Dimensions of a part on one page: from its surfaces and their relations to a table of numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from completion.parts.dimensions.dimension import PartDimension, PartDimensions
from completion.parts.dimensions.distances import (
    DirectionClass,
    angle_rows,
    axis_rows,
    direction_classes,
    plane_rows,
)
from completion.parts.dimensions.face_samples import FaceSamples
from completion.parts.dimensions.frame import datum_frame, overall_rows
from completion.parts.dimensions.holes import (
    HolePattern,
    alike_holes,
    depth_rows,
    find_patterns,
    holes_of,
    pattern_rows,
)
from completion.parts.dimensions.joint_surfaces import JointSurfaces
from completion.parts.dimensions.measures import measure_rows
from completion.parts.dimensions.preferred import with_preferred
from completion.parts.dimensions.related_part import RelatedPart
from completion.parts.dimensions.sizes import RoundFaces, alike, round_faces, size_rows
from completion.relations.limits import MOST_RADIUS_SD
from scenes.surfaces.catalogue import Cone, Cylinder, Torus


def dimensions_of(part: RelatedPart, *, preferred: bool = True) -> PartDimensions:
    """Return the dimensions of a part, each with its 95 % interval.

    Intervals are those of the joint covariance of all surfaces, given the relations that hold. Lists stay
    short: alike sizes are one row, parallel planes a chain, holes at regular places a pattern.

    Parameters
    ----------
    part : Part
        As `model_part` gives it.
    preferred : bool
        Whether the most probable preferred value of each is told (`completion.parts.dimensions.preferred`).
    """
    # 1. Look: all surfaces with their joint covariance, points on each face, what is parallel, the frame.
    known, faces = JointSurfaces(part), FaceSamples(part)
    classes = direction_classes(known, faces)
    frame = datum_frame(classes, known)

    # 2. Holes: which there are, how they end, which of them are alike and at regular places.
    items = round_faces(known, faces)
    holes = holes_of(items, known, faces)
    sizes = alike(items, known)
    groups = alike_holes(sizes, holes, classes)
    patterns = find_patterns(sizes, classes, known, frame.axes)

    # 3. Measure: the whole, sizes, distances, angles, depths and patterns; volume and area of a mesh.
    notes = {hole.place: hole.note for hole in holes if hole.note}
    rows: list[PartDimension] = list(overall_rows(frame, known, faces))
    rows += size_rows(items, known, faces, notes)
    rows += depth_rows(groups, known, faces)
    rows += pattern_rows(patterns, known, frame.axes[0])
    rows += plane_rows(classes, known, faces)
    rows += axis_rows(classes, _nodes(classes, items, patterns, faces), known, faces)
    rows += angle_rows(classes, known, faces)
    whole, doubts = measure_rows(known)
    kept = [
        row
        for row in _without_copies(rows)
        if row.kind == "start angle" or not row.sd > MOST_RADIUS_SD * row.value
    ]
    every = (*kept, *whole)

    # 4. Read: what each was meant to be, as a hypothesis.
    return PartDimensions(with_preferred(every) if preferred else every, frame, doubts)


def _nodes(
    classes: Sequence[DirectionClass],
    items: Sequence[RoundFaces],
    patterns: Sequence[HolePattern],
    faces: FaceSamples,
) -> dict[int, list[tuple[int, ...]]]:
    """For the first of each class the axes whose distances count: one a pattern, but for arcs and fillets.

    A circle of holes about another surface's axis is placed by that.
    """
    arcs = {place for item in items if item.kind in ("fillet radius", "radius") for place in item.places}
    of = {place: pattern for pattern in patterns for place in pattern.places}
    nodes: dict[int, list[tuple[int, ...]]] = {}
    for kind in classes:
        nodes[kind.first] = []
        for line in kind.axes:
            pattern = next((of[place] for place in line if place in of), None)
            own = [
                p for p in line if isinstance(faces.surfaces[p], Cylinder | Cone | Torus) and p not in arcs
            ]
            if pattern is not None and (pattern.about >= 0 or pattern.places[0] not in line):
                continue
            if own:
                nodes[kind.first].append(pattern.places if pattern is not None else (own[0],))
    return nodes


def _without_copies(rows: Sequence[PartDimension]) -> list[PartDimension]:
    """Dimensions without those between the same surfaces as an earlier one; the more telling name stays."""
    kept: dict[frozenset[int], int] = {}
    out: list[PartDimension] = []
    for row in rows:
        key = frozenset(row.places)
        is_length = row.kind in ("overall size", "thickness", "length", "slot width", "step", "distance")
        if is_length and len(key) == 2:
            if key in kept:
                first = out[kept[key]]
                word = "" if row.kind in ("step", "distance") else f", {row.kind}"
                out[kept[key]] = replace(first, note=first.note + word)
                continue
            kept[key] = len(out)
        out.append(row)
    return out
