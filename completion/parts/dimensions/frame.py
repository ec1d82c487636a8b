# SPDX-License-Identifier: MIT
"""The datum frame of a part by its main planes and axes, and its overall sizes along it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from completion.parts.dimensions.dimension import DatumFrame, Measure, PartDimension
from completion.parts.dimensions.distances import DirectionClass, are_square
from completion.parts.dimensions.face_samples import FaceSamples
from completion.parts.dimensions.joint_surfaces import JointSurfaces
from completion.relations.equations import Placement
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Cone, Cylinder, Plane
from scenes.surfaces.surface import perpendicular

_SQUARE = 1e-2  # sine: a face is the end of a part where it is square to, or round about, a direction
_NOISE_SD = 3.0  # standard deviations by which the outermost of many points lies off its surface
_LEAST_SHARE = 0.02  # of the area, that faces of one direction have whose direction is the frame's x
_AS_IN_FILE = 0.01  # radians from the file's axes, within which the frame's have their names
_LETTERS = "xyz"


def datum_frame(classes: Sequence[DirectionClass], known: JointSurfaces) -> DatumFrame:
    """The frame whose z is the direction of most area, and whose x is that of most area across it.

    Signs are those of the file's axes that they are nearest to, and so are names where the part stands along
    these. Without a direction across z, x is as near to
    an axis of the file as can be.
    """
    if not classes:
        return DatumFrame(np.eye(3), "axes of the file: no surface has a direction")
    first = classes[0].first
    across = next((kind.first for kind in classes[1:]
                   if kind.share > _LEAST_SHARE and are_square(first, kind.first, known)), None)  # fmt: skip
    z = _forward(known.at[first].direction)
    if across is None:
        x, note = np.eye(3)[int(np.argmin(np.abs(z)))], "as near to an axis of the file as can be"
    else:
        x, note = _forward(known.at[across].direction), _source(across, known)
    x = x - float(x @ z) * z
    x /= np.linalg.norm(x)
    axes = np.stack([x, np.cross(z, x), z])
    order = np.abs(axes).argmax(axis=0)  # the row of each axis of the file
    if np.abs(np.abs(axes[order]) - np.eye(3)).max() < _AS_IN_FILE:
        axes = axes[order] * np.sign(np.diag(axes[order]))[:, None]
    else:
        order = np.arange(3)
    letters = [_LETTERS[int(np.flatnonzero(order == row)[0])] for row in (2, 0)]
    return DatumFrame(axes, f"{letters[0]} {_source(first, known)}; {letters[1]} {note}")


def _source(place: int, known: JointSurfaces) -> str:
    """From which surface a direction is, in words."""
    return (
        f"along the {'normal' if known.at[place].is_plane else 'axis'} of surface {known.part.labels[place]}"
    )


def _forward(direction: FloatArray) -> FloatArray:
    """A direction with the sign that makes its largest component positive."""
    return direction * (1.0 if direction[int(np.argmax(np.abs(direction)))] >= 0 else -1.0)


def overall_rows(frame: DatumFrame, known: JointSurfaces, faces: FaceSamples) -> Iterator[PartDimension]:
    """The size of the part along each axis of its frame: between faces where these end it, else points."""
    for letter, axis in zip(_LETTERS, frame.axes, strict=True):
        along = faces.points @ axis
        size, middle = float(np.ptp(along)), faces.points[int(np.argmax(along))]
        ends = np.stack([middle - size * axis, middle])
        found = [_end_face(way, axis, known, faces) for way in (-1.0, 1.0)]
        places = [place for place in found if place is not None]
        if len(places) == 2:
            yield known.dimension("overall size", places, _between(axis), note=f"along {letter}", ends=ends)
            continue
        yield PartDimension(
            kind="overall size", value=size, sd=float("nan"), measured_sd=float("nan"), ends=ends,
            bounds=(size - 2 * _NOISE_SD * known.part.noise_m, size + faces.spacing_m),
            surfaces=tuple(known.part.labels[place] for place in places),
            note=f"along {letter}, to the outermost points",
        )  # fmt: skip


def _end_face(way: float, axis: FloatArray, known: JointSurfaces, faces: FaceSamples) -> int | None:
    """The place of the face that ends the part along an axis, one way or the other; None where none does."""
    along = way * (faces.points @ axis)
    tolerance = faces.spacing_m * 0.5 + (_NOISE_SD + 1) * known.part.noise_m
    reached = set(faces.place[along >= along.max() - tolerance].tolist()) - {-1}
    ranks = []
    for place in reached:
        surface, at = faces.surfaces[place], known.at[place]
        slope = float(abs(at.direction @ axis))
        is_end = {Plane: slope**2 >= 1 - _SQUARE**2, Cylinder: slope <= _SQUARE, Cone: False}
        end = way * float(at.point @ axis) + _reach(at, axis)
        if is_end.get(type(surface), True) and abs(end - along.max()) <= tolerance:
            ranks.append((isinstance(surface, Plane), faces.share(place), -place))
    return -max(ranks)[2] if ranks else None


def _reach(at: Placement, way: FloatArray) -> float:
    """How far a surface reaches from its point along a direction, metres."""
    ring = at.ring_radius * float(np.linalg.norm(np.cross(at.direction, way))) if at.ring_radius else 0.0
    return ring + (0.0 if at.is_plane else at.radius)


def _between(axis: FloatArray) -> Measure:
    """From one end of a part to the other along an axis, or along the normal of a plane that ends it."""

    def measure(at: Sequence[Placement]) -> float:
        plane = next((each for each in at if each.is_plane), None)
        way = axis if plane is None else plane.direction * np.sign(plane.direction @ axis)
        low, high = at
        return float((high.point - low.point) @ way) + _reach(low, way) + _reach(high, way)

    return measure


def across_of(axes: FloatArray, direction: FloatArray) -> FloatArray:
    """Two unit vectors (2, 3) across a direction, the first along the frame's x where that is possible.

    The second is a right-handed turn from it about the frame's axis that the direction is nearest to.
    """
    nearest = axes @ direction
    direction = direction * np.sign(nearest[int(np.argmax(np.abs(nearest)))])
    first = axes[0] - float(axes[0] @ direction) * direction
    length = float(np.linalg.norm(first))
    unit = first / length if length > 0.1 else perpendicular(direction)
    return np.stack([unit, np.cross(direction, unit)])
