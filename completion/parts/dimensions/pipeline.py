# SPDX-License-Identifier: MIT
"""Dimensions of a part on one page: from its surfaces and their relations to a table of numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

from completion.parts.dimensions.blends import find_blends
from completion.parts.dimensions.chamfers import chamfer_rows
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
    stepped_holes,
)
from completion.parts.dimensions.joint_surfaces import JointSurfaces
from completion.parts.dimensions.measures import measure_rows
from completion.parts.dimensions.preferred import with_preferred
from completion.parts.dimensions.sizes import RoundFaces, alike, round_faces, size_rows
from completion.parts.division.divided_part import RelatedPart
from completion.relations.limits import MOST_RADIUS_SD
from scenes.surfaces.catalogue import Cone, Cylinder, Torus


def dimensions_of(part: RelatedPart, *, preferred: bool = True) -> PartDimensions:
    """Return the dimensions of a part, each with its 95 % interval.

    Intervals are those of the joint covariance of all surfaces, given the relations that hold. Lists stay
    short: alike sizes are one row, parallel planes a chain, holes at regular places a pattern.

    Parameters
    ----------
    part : RelatedPart
        As `model_part` gives it.
    preferred : bool
        Whether the most probable preferred value of each is told (`completion.parts.dimensions.preferred`).
    """
    # 1. Look: all surfaces with their joint covariance, points on each face, which of them blend others and
    #    so where these meet, what is parallel, the frame.
    known, faces = JointSurfaces(part), FaceSamples(part)
    blends = find_blends(known, faces)
    place = {label: number for number, label in enumerate(part.labels)}
    for blend in blends:  # behind which its faces meet
        for first, second in combinations(blend.supports, 2):
            faces.meet(place[first], place[second])
    of = {place[label]: blend for blend in blends for label in blend.labels}
    classes = direction_classes(known, faces)
    frame = datum_frame(classes, known)

    # 2. Holes: which there are, how they end, which of them are alike and at regular places.
    items = round_faces(known, faces, of)
    holes = holes_of(items, known, faces)
    sizes = alike(items, known, lambda at: at[0].radius)
    groups = alike_holes(sizes, holes, classes)
    patterns = find_patterns(sizes, classes, known, frame.axes)

    # 3. Measure: the whole, sizes, distances, angles, depths and patterns; volume and area of a mesh.
    notes = {place: hole.note for place, hole in holes.items() if hole.note}
    rows: list[PartDimension] = list(overall_rows(frame, known, faces))
    rows += size_rows(sizes, known, faces, notes, of)
    sunk = {label for row in rows if row.kind == "countersink diameter" for label in row.surfaces}
    rows += chamfer_rows([one for one in blends if sunk.isdisjoint(one.labels)], known, faces)
    rows += depth_rows(groups, known, faces)
    rows += pattern_rows(patterns, known, faces, frame.axes[0])
    rows += plane_rows(classes, known, faces)
    rows += axis_rows(classes, _nodes(classes, items, patterns, faces), known, faces)
    rows += angle_rows(classes, known, faces)
    whole, doubts = measure_rows(known)
    every = [row for row in _without_copies(rows)
             if row.kind == "start angle" or not row.sd > MOST_RADIUS_SD * row.value] + whole  # fmt: skip

    # 4. Read: what each was meant to be, as a hypothesis.
    read = with_preferred(every) if preferred else tuple(every)
    return PartDimensions(read, frame, doubts, holes=stepped_holes(holes, classes), blends=blends)


def _nodes(
    classes: Sequence[DirectionClass], items: Sequence[RoundFaces], patterns: Sequence[HolePattern],
    faces: FaceSamples,
) -> list[list[tuple[int, ...]]]:  # fmt: skip
    """For each class the axes whose distances count: one a pattern, but for arcs and fillets.

    A circle of holes about another surface's axis is placed by that.
    """
    arcs = {place for item in items if item.kind in ("fillet radius", "radius") for place in item.places}
    of = {place: pattern for pattern in patterns for place in pattern.places}
    nodes: list[list[tuple[int, ...]]] = []
    for kind in classes:
        nodes.append([])
        for line in kind.axes:
            pattern = next((of[place] for place in line if place in of), None)
            own = [
                p for p in line if isinstance(faces.surfaces[p], Cylinder | Cone | Torus) and p not in arcs
            ]
            if pattern is None:
                nodes[-1] += [(own[0],)] if own else []
            elif pattern.about < 0 and pattern.places[0] in line:
                nodes[-1].append(pattern.places)
    return nodes


def _without_copies(rows: Sequence[PartDimension]) -> list[PartDimension]:
    """Dimensions without those between the same surfaces as an earlier one; the more telling name stays."""
    kept: dict[object, PartDimension] = {}
    for number, row in enumerate(rows):
        is_length = row.kind in ("overall size", "thickness", "length", "slot width", "step", "distance")
        key = frozenset(row.places) if is_length and len(set(row.places)) == 2 else number
        if key not in kept:
            kept[key] = row
        elif row.kind not in ("step", "distance"):
            kept[key] = replace(kept[key], note=f"{kept[key].note}, {row.kind}")
    return list(kept.values())
