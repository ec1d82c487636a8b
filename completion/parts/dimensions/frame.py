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
from scenes.surfaces.catalogue import Cylinder, Plane, Sphere, Torus
from scenes.surfaces.surface import perpendicular

_SQUARE = 1e-2  # sine: a face is the end of a part where it is square to, or round about, a direction
_NOISE_SD = 3.0  # standard deviations by which the outermost of many points lies off its surface
_LEAST_SHARE = 0.02  # of the area, that faces of one direction have whose direction is the frame's x
_LETTERS = "xyz"


def datum_frame(classes: Sequence[DirectionClass], known: JointSurfaces) -> DatumFrame:
    """The frame whose z is the direction of most area, and whose x is that of most area across it.

    Signs are those of the file's axes that they are nearest to. Without a direction across z, x is as near to
    an axis of the file as can be.
    """
    labels = known.part.labels
    if not classes:
        return DatumFrame(np.eye(3), "axes of the file: no surface has a direction")
    first = classes[0].first
    z = _forward(known.at[first].direction)
    across = next(
        (
            kind.first
            for kind in classes[1:]
            if kind.share > _LEAST_SHARE and are_square(first, kind.first, known)
        ),
        None,
    )
    kind = "normal" if known.at[first].is_plane else "axis"
    note = f"z along the {kind} of surface {labels[first]}"
    if across is None:
        x = np.eye(3)[int(np.argmin(np.abs(z)))]
        note += "; x as near to an axis of the file as can be"
    else:
        x = _forward(known.at[across].direction)
        note += (
            f"; x along the {'normal' if known.at[across].is_plane else 'axis'} of surface {labels[across]}"
        )
    x = x - float(x @ z) * z
    x /= np.linalg.norm(x)
    return DatumFrame(np.stack([x, np.cross(z, x), z]), note)


def _forward(direction: FloatArray) -> FloatArray:
    """A direction with the sign that makes its largest component positive."""
    return direction * (1.0 if direction[int(np.argmax(np.abs(direction)))] >= 0 else -1.0)


def overall_rows(frame: DatumFrame, known: JointSurfaces, faces: FaceSamples) -> Iterator[PartDimension]:
    """The size of the part along each axis of its frame: between faces where these end it, else points."""
    if not len(faces.points):
        return
    for letter, axis in zip(_LETTERS, frame.axes, strict=True):
        along = faces.points @ axis
        low, high = float(along.min()), float(along.max())
        middle = faces.points[int(np.argmax(along))]
        ends = np.stack([middle - (high - low) * axis, middle])
        found = [_end_face(way, axis, known, faces) for way in (-1.0, 1.0)]
        note = f"along {letter}"
        if found[0] is not None and found[1] is not None:
            yield known.dimension("overall size", (found[0], found[1]), _between(axis), note=note, ends=ends)
            continue
        noise = known.part.noise_m
        yield PartDimension(
            kind="overall size",
            value=high - low,
            low=high - low - 2 * _NOISE_SD * noise,
            high=high - low + faces.spacing_m,
            sd=float("nan"),
            measured_sd=float("nan"),
            unit="m",
            surfaces=tuple(known.part.labels[place] for place in found if place is not None),
            ends=ends,
            basis="bounds",
            note=f"{note}, to the outermost points",
        )


def _end_face(way: float, axis: FloatArray, known: JointSurfaces, faces: FaceSamples) -> int | None:
    """The place of the face that ends the part along an axis, one way or the other; None where none does."""
    along = way * (faces.points @ axis)
    most = float(along.max())
    tolerance = faces.spacing_m * 0.5 + (_NOISE_SD + 1) * known.part.noise_m
    best: tuple[bool, float, int] | None = None
    for place in range(len(faces.surfaces)):
        points = faces.of(place)
        if not len(points) or float((way * (points @ axis)).max()) < most - tolerance:
            continue
        end = _support(known.at[place], faces.surfaces[place].kind, axis, way)
        if end is None or abs(end - most) > tolerance:
            continue
        rank = (isinstance(faces.surfaces[place], Plane), faces.share(place), -place)
        best = rank if best is None or rank > best else best
    return None if best is None else -best[2]


def _support(at: Placement, kind: str, axis: FloatArray, way: float) -> float | None:
    """How far a surface reaches along an axis one way, metres; None where it does not end there."""
    slope = float(abs(at.direction @ axis))
    reach = 0.0
    if kind == Plane.kind:
        if np.sqrt(max(1 - slope**2, 0.0)) > _SQUARE:
            return None
    elif kind == Cylinder.kind:
        if slope > _SQUARE:
            return None
        reach = at.radius
    elif kind == Torus.kind:
        reach = at.ring_radius * float(np.sqrt(max(1 - slope**2, 0.0))) + at.radius
    elif kind == Sphere.kind:
        reach = at.radius
    else:
        return None
    return way * float(at.point @ axis) + reach


def _between(axis: FloatArray) -> Measure:
    """From one end of a part to the other along an axis, or along the normal of a plane that ends it."""

    def measure(at: Sequence[Placement]) -> float:
        plane = next((each for each in at if each.is_plane), None)
        way = axis if plane is None else plane.direction * np.sign(plane.direction @ axis)
        ends = []
        for sign, each in zip((-1.0, 1.0), at, strict=True):
            reach = 0.0 if each.is_plane else each.radius
            if each.ring_radius > 0:
                reach += each.ring_radius * float(np.linalg.norm(np.cross(each.direction, way)))
            ends.append(float(each.point @ way) + sign * reach)
        return ends[1] - ends[0]

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
