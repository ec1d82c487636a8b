# SPDX-License-Identifier: MIT
"""Sizes of single surfaces: diameters, radii, fillets, cone angles; alike ones in one row."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from completion.parts.dimensions.dimension import Blend, Kind, Measure, PartDimension
from completion.parts.dimensions.face_samples import FaceSamples
from completion.parts.dimensions.joint_surfaces import JointSurfaces, grouped
from completion.relations.equations import Placement
from completion.relations.graph import is_settled
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Cone, Cylinder, Plane, Sphere, Torus

_FULL = float(np.radians(200.0))  # that a round face covers, from which its diameter counts, not its radius
_SQUARE = float(np.cos(np.radians(25.0)))  # of a countersink's axis and the normal of its mouth
_SAME_SD, _EXACT = 4.0, 1e-7  # standard deviations, and share of the part's size, within which two are one


class RoundFaces(NamedTuple):
    """Faces on one round surface: their places, the first the best known, and what they are."""

    places: tuple[int, ...]
    kind: Kind


def round_faces(known: JointSurfaces, faces: FaceSamples, blends: Mapping[int, Blend]) -> list[RoundFaces]:
    """The cylinders, spheres and tori of a part, those of one surface together; `blends` by their places.

    Blends are known by what they touch, however little of a turn they are.
    """
    groups: dict[int, list[int]] = {}
    for place, (fit, group) in enumerate(zip(known.part.fits, known.part.groups, strict=True)):
        if not isinstance(fit.surface, Cylinder | Sphere | Torus) or not len(faces.of(place)):
            continue
        if is_settled(fit) or place in blends:
            groups.setdefault(group, []).append(place)

    def variance(place: int) -> float:
        by_radius = known.at[place].by_radius[0]
        return float(by_radius @ known.part.measured[place].covariance @ by_radius)

    ordered = [sorted(members, key=lambda place: (variance(place), place)) for members in groups.values()]
    return [RoundFaces(tuple(members), _kind_of(members, faces, blends)) for members in ordered]


def _kind_of(members: Sequence[int], faces: FaceSamples, blends: Mapping[int, Blend]) -> Kind:
    surface = faces.surfaces[members[0]]
    if not blends.keys().isdisjoint(members):
        return "fillet radius"
    if isinstance(surface, Sphere):
        return "sphere diameter"
    if faces.turn(members) < _FULL:
        return "radius"
    if isinstance(surface, Torus):
        return "tube radius"
    return "hole diameter" if faces.is_hollow(members[0]) else "outer diameter"


def alike(items: Sequence[RoundFaces], known: JointSurfaces, measure: Measure) -> list[list[RoundFaces]]:
    """Group round faces of one kind of which relations make a number equal."""

    def are_one(one: RoundFaces, two: RoundFaces) -> bool:
        return one.kind == two.kind and known.are_equal(one.places[:1], two.places[:1], measure)

    return grouped(items, are_one)


def size_rows(
    sizes: Sequence[Sequence[RoundFaces]], known: JointSurfaces, faces: FaceSamples, notes: Mapping[int, str],
    blends: Mapping[int, Blend],
) -> Iterator[PartDimension]:  # fmt: skip
    """A row for each size: radii of arcs and fillets, diameters of what goes round, rings, cone angles.

    `sizes` are round faces of equal radii together; `notes` say of holes whether they go through. Radii are
    those of the best known of their blends, where relations do not tell them better.
    """
    for group in sizes:
        own = [blends[place] for item in group for place in item.places if place in blends]
        said = sorted({notes[item.places[0]] for item in group if item.places[0] in notes})
        said += dict.fromkeys(blend.note for blend in own)
        row = _round_row(group[0].kind, group, lambda at: at.radius, (known, faces), ", ".join(said))
        best = min(own, key=lambda blend: blend.sd_m, default=None)
        is_better = best is not None and not row.sd < best.sd_m
        yield row if best is None or not is_better else replace(row, value=best.size_m, sd=best.sd_m)
    tori = [item for size in sizes for item in size if isinstance(faces.surfaces[item.places[0]], Torus)]
    for group in alike(sorted(tori, key=lambda item: min(item.places)), known, lambda at: at[0].ring_radius):
        yield _round_row("ring diameter", group, lambda at: at.ring_radius, (known, faces))
    cones = [place for place, surface in enumerate(faces.surfaces)
             if isinstance(surface, Cone) and len(faces.of(place))]  # fmt: skip
    for places in grouped(cones, lambda one, two: known.are_equal([one], [two], _whole_angle)):
        ends = np.repeat(faces.of(places[0]).mean(axis=0)[None], 2, axis=0)
        row = known.dimension("cone angle", places[:1], _whole_angle, alike=places, ends=ends)
        yield _as_measured(row, places, known)
    mouths = [
        (cone, plane)
        for cone in cones
        for plane in sorted(faces.neighbours[cone] if faces.is_hollow(cone) else ())
        if isinstance(faces.surfaces[plane], Plane) and _is_mouth(known.at[cone], known.at[plane])
    ]

    def are_one(one: tuple[int, int], two: tuple[int, int]) -> bool:  # no relation says how deep a cone is
        found = known.estimate([*one, *two], lambda at: _mouth_diameter(at[:2]) - _mouth_diameter(at[2:]))
        return bool(abs(found.value[0]) <= _SAME_SD * found.sd + _EXACT * known.size_m)

    for pairs in grouped(mouths, are_one):
        at, radius = known.at[pairs[0][0]], _mouth_diameter([known.at[place] for place in pairs[0]]) / 2
        middle = at.point + (radius - at.radius) / np.tan(at.half_angle) * at.direction
        ends = np.stack([middle - radius * at.across[0], middle + radius * at.across[0]])
        yield known.dimension(
            "countersink diameter", pairs[0], _mouth_diameter, alike=[pair[0] for pair in pairs], ends=ends
        )


def _whole_angle(at: Sequence[Placement]) -> float:
    return 2 * at[0].half_angle


def _as_measured(row: PartDimension, places: Sequence[int], known: JointSurfaces) -> PartDimension:
    """An angle that a round value alone determines, as its cones measured it: such a value is a hypothesis.

    One that was stated stays.
    """
    graph = known.part.relations
    is_stated = graph is not None and any(
        one.is_given and one.kind == "half_angle" for one in graph.relations
    )
    if is_stated or not row.is_determined:
        return row
    surfaces = [known.part.measured[place].surface for place in places]
    angles = [2 * surface.half_angle for surface in surfaces if isinstance(surface, Cone)]
    found = known.estimate(places, lambda at: 2 * np.mean([one.half_angle for one in at]))
    return replace(row, value=float(np.mean(angles)), sd=float(np.sqrt(found.measured_covariance[0, 0])))


def _is_mouth(cone: Placement, plane: Placement) -> bool:
    """Whether a cone opens in a plane: it is square to its axis, and crosses it where the cone is wider."""
    is_wide = _mouth_diameter((cone, plane)) > 2 * cone.radius
    return bool(is_wide and abs(cone.direction @ plane.direction) > _SQUARE)


def _mouth_diameter(at: Sequence[Placement]) -> float:
    """Diameter of a cone, the first, where a plane, the second, crosses its axis."""
    cone, plane = at
    height = plane.direction @ (plane.point - cone.point) / (plane.direction @ cone.direction)
    return float(2 * (cone.radius + height * np.tan(cone.half_angle)))


def _round_row(
    kind: Kind, group: Sequence[RoundFaces], radius: Callable[[Placement], float],
    of: tuple[JointSurfaces, FaceSamples], note: str = "",
) -> PartDimension:  # fmt: skip
    """A radius, or a diameter where the kind is one, drawn at the end of a face through a measured point."""
    known, faces = of
    place, factor = group[0].places[0], 2.0 if kind.endswith("diameter") else 1.0
    at, points = known.at[place], faces.of(place)
    end, foot = points[0], at.point
    if at.ring_radius > 0:
        level = end - foot - float((end - foot) @ at.direction) * at.direction
        ring = foot + at.ring_radius * level / max(float(np.linalg.norm(level)), 1e-300)
        end, foot = (ring, foot) if kind == "ring diameter" else (end, ring)
    elif at.direction.any():
        along = (points - at.point) @ at.direction
        end = points[int(np.argmax(along))]
        foot = at.point + float(along.max()) * at.direction
    ends: FloatArray = np.stack([foot + (factor - 1) * (foot - end), end])
    return known.dimension(
        kind, (place,), lambda at: factor * radius(at[0]), alike=[item.places[0] for item in group],
        note=note, ends=ends,
    )  # fmt: skip
