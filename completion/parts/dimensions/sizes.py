# SPDX-License-Identifier: MIT
"""Sizes of single surfaces: diameters, radii, fillets, cone angles; alike ones in one row."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from completion.parts.dimensions.dimension import Kind, PartDimension
from completion.parts.dimensions.face_samples import FaceSamples
from completion.parts.dimensions.joint_surfaces import JointSurfaces
from completion.relations.equations import Placement
from completion.relations.graph import is_settled
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Cone, Cylinder, Sphere, Torus

_FULL = float(np.radians(200.0))  # that a round face covers, from which its diameter counts, not its radius
_TANGENT = float(np.cos(np.radians(25.0)))  # of the normals where a fillet meets its neighbour


class RoundFaces(NamedTuple):
    """Faces on one round surface: their places, the first the best known, and what they are."""

    places: tuple[int, ...]
    kind: Kind


def radius(at: Placement) -> float:
    """Radius of a sphere, cylinder or tube, metres."""
    return at.radius


def round_faces(known: JointSurfaces, faces: FaceSamples) -> list[RoundFaces]:
    """The cylinders, spheres and tori of a part, those of one surface together."""
    part, found = known.part, list[RoundFaces]()
    groups: dict[int, list[int]] = {}
    for place, (fit, group) in enumerate(zip(part.fits, part.groups, strict=True)):
        if isinstance(fit.surface, Cylinder | Sphere | Torus) and len(faces.of(place)) and is_settled(fit):
            groups.setdefault(group, []).append(place)
    for members in groups.values():
        members.sort(key=lambda place: (_radius_variance(known, place), place))
        found.append(RoundFaces(tuple(members), _kind_of(members, faces)))
    return found


def _radius_variance(known: JointSurfaces, place: int) -> float:
    """Variance of the radius that the points of a face give, m2."""
    at = known.at[place]
    return float((at.by_radius @ known.part.measured[place].covariance @ at.by_radius.T)[0, 0])


def is_hollow(place: int, faces: FaceSamples) -> bool:
    """Whether a round face is seen from within, as a bore is."""
    points = faces.of(place)[:1]
    surface = faces.surfaces[place]
    centre = getattr(surface, "centre", getattr(surface, "point", np.zeros(3)))
    axis = getattr(surface, "direction", np.zeros(3))
    outward = points - centre - ((points - centre) @ axis)[:, None] * axis
    if isinstance(surface, Torus):
        outward = points - centre
        level = outward - (outward @ axis)[:, None] * axis
        outward = outward - surface.radius * level / max(float(np.linalg.norm(level)), 1e-300)
    return bool(faces.sides[place] * float((surface.normal(points) * outward).sum()) < 0)


def _kind_of(members: Sequence[int], faces: FaceSamples) -> Kind:
    surface = faces.surfaces[members[0]]
    turn = faces.turn(members)
    if isinstance(surface, Sphere):
        return "sphere diameter"
    if turn < _FULL:
        return "fillet radius" if _is_fillet(members, faces) else "radius"
    if isinstance(surface, Torus):
        return "tube radius"
    return "hole diameter" if is_hollow(members[0], faces) else "outer diameter"


def _is_fillet(members: Sequence[int], faces: FaceSamples) -> bool:
    """Whether faces go over smoothly into two others at least."""
    n_smooth = 0
    for member in members:
        for other in faces.neighbours[member]:
            border = faces.beside(member, other)
            if other in members or not len(border):
                continue
            own, two = (faces.surfaces[place].normal(border) for place in (member, other))
            n_smooth += bool(np.median(np.abs(np.einsum("ij,ij->i", own, two))) > _TANGENT)
    return n_smooth >= 2


def alike(
    items: Sequence[RoundFaces], known: JointSurfaces, measure: Callable[[Placement], float] = radius
) -> list[list[RoundFaces]]:
    """Group round faces of one kind whose radii relations make equal."""
    groups: list[list[RoundFaces]] = []
    for item in items:
        for group in groups:
            first = group[0]
            if first.kind == item.kind and known.are_equal(first.places[0], item.places[0], measure):
                group.append(item)
                break
        else:
            groups.append([item])
    return groups


def size_rows(
    items: Sequence[RoundFaces], known: JointSurfaces, faces: FaceSamples, notes: dict[int, str]
) -> Iterator[PartDimension]:
    """A row for each size: radii of arcs and fillets, diameters of what goes round, rings, cone angles.

    `notes` say of the first place of holes whether they go through.
    """
    for group in alike(items, known):
        place, kind = group[0].places[0], group[0].kind
        is_across = kind in ("hole diameter", "outer diameter", "sphere diameter")
        said = sorted({notes[item.places[0]] for item in group if item.places[0] in notes})
        yield known.dimension(
            kind,
            (place,),
            (lambda at: 2 * at[0].radius) if is_across else (lambda at: at[0].radius),
            alike=[item.places[0] for item in group],
            note=", ".join(said),
            ends=_across(place, known, faces, is_across=is_across),
        )
    tori = [item for item in items if isinstance(faces.surfaces[item.places[0]], Torus)]
    for group in alike(tori, known, lambda at: at.ring_radius):
        yield known.dimension(
            "ring diameter",
            (group[0].places[0],),
            lambda at: 2 * at[0].ring_radius,
            alike=[item.places[0] for item in group],
            ends=_across(group[0].places[0], known, faces, is_across=True),
        )
    yield from _cone_rows(known, faces)


def _cone_rows(known: JointSurfaces, faces: FaceSamples) -> Iterator[PartDimension]:
    """The whole angle of each cone; of those with one angle together."""
    groups: list[list[int]] = []
    for place, surface in enumerate(faces.surfaces):
        if isinstance(surface, Cone) and len(faces.of(place)):
            for group in groups:
                if known.are_equal(group[0], place, lambda at: at.half_angle):
                    group.append(place)
                    break
            else:
                groups.append([place])
    for group in groups:
        middle = faces.of(group[0]).mean(axis=0)
        yield known.dimension(
            "cone angle", group[:1], lambda at: 2 * at[0].half_angle, unit="rad", alike=group,
            note="whole angle", ends=np.stack([middle, middle]),
        )  # fmt: skip


def _across(place: int, known: JointSurfaces, faces: FaceSamples, *, is_across: bool) -> FloatArray:
    """Ends (2, 3) of a diameter or radius at the end of a face, through a point that was measured."""
    at, points = known.at[place], faces.of(place)
    if not at.direction.any() or at.ring_radius > 0:
        point = points[0]
        return np.stack([2 * at.point - point if is_across else point, point])
    along = (points - at.point) @ at.direction
    end = points[int(np.argmax(along))]
    foot = at.point + float((end - at.point) @ at.direction) * at.direction
    return np.stack([2 * foot - end if is_across else foot, end])
