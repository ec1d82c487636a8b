# SPDX-License-Identifier: MIT
"""Deviation of each face with its intervals: offset, tilt, bow, radius, and the corner farthest off."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from completion.asbuilt import limits
from completion.asbuilt.agreement import FaceBeams, FaceSurface
from completion.asbuilt.alignment import Aligned
from completion.asbuilt.faces import N_COLUMNS, DesignFaces
from completion.asbuilt.findings import HALF_95, FaceFinding, Interval
from scenes.checks import FloatArray

_HISTOGRAM_M = 0.05
_OCTANTS = 8  # around a cylinder, where it is judged if it was measured there


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """A face with its finding, and the deviations at its corners.

    Attributes
    ----------
    finding : FaceFinding
        What was found.
    face, row : int
        Its number in the design, and its place in `Aligned.faces`.
    delta, sd : (e,) float
        Deviation and standard deviation at the places where it is judged, metres.
    columns : (e, 5) float
        Those places.
    is_flat_enough : bool
        Whether its beams lie about one surface as those of other faces do.
    is_far : bool
        Whether they ended far from the face: they may be of it if it was displaced.
    """

    finding: FaceFinding
    face: int
    row: int
    delta: FloatArray
    sd: FloatArray
    columns: FloatArray
    is_flat_enough: bool = True
    is_far: bool = False

    def is_within(self, tolerance_m: float) -> bool:
        """Whether all of it is within the tolerance, with 95 %."""
        return bool((np.abs(self.delta) + HALF_95 * self.sd <= tolerance_m).all())

    def deviates(self, tolerance_m: float, z: float) -> bool:
        """Whether some of it is beyond the tolerance by z standard deviations."""
        return bool((np.abs(self.delta) - z * self.sd > tolerance_m).any())


@dataclass(frozen=True, slots=True, eq=False)
class Agreed:
    """Beams of faces, the surface of each and where its beams are, the alignment.

    `origins` (s, 3) is where scans stood, metres.
    """

    beams: FaceBeams
    surfaces: tuple[FaceSurface, ...]
    parts: tuple[slice, ...]
    aligned: Aligned
    origins: FloatArray

    def posed(self, rows: NDArray[np.int64]) -> FloatArray:
        """What the motions of scans make of the distances (n,) of some beams."""
        beams, motion = self.beams, self.aligned.motion
        points, normal, scan = beams.points[rows], beams.normal[rows], beams.scan[rows]
        own, common = motion[:-1][scan], motion[-1]
        total = np.einsum("ij,ij->i", np.cross(points - self.origins[scan], normal), own[:, :3])
        total += np.einsum("ij,ij->i", normal, own[:, 3:])
        return np.asarray(total + np.cross(points, normal) @ common[:3] + normal @ common[3:])


@dataclass(frozen=True, slots=True, eq=False)
class FaceStanding:
    """Of F faces: which `is_main` of their elements, the `support` by beams, and the `exposed` share."""

    is_main: NDArray[np.bool_]
    support: FloatArray
    exposed: FloatArray


def judge_faces(agreed: Agreed, faces: DesignFaces, standing: FaceStanding, scale: float) -> list[Judged]:
    """Judge all faces with beams."""
    near = [surface.sd for surface in agreed.surfaces if surface.face < len(faces)]
    median = float(np.median(near)) if near else 0.0
    row_of = {int(face): row for row, face in enumerate(agreed.aligned.faces)}
    judged = []
    for surface, part in zip(agreed.surfaces, agreed.parts, strict=True):
        if surface.face not in row_of:
            continue
        f, row = surface.face % len(faces), row_of[surface.face]
        one = _judge(agreed, surface, np.flatnonzero(surface.is_on) + part.start, faces, row)
        support = float(standing.support[f])
        tested = is_shown(surface, support, float(standing.exposed[f]), scale)
        finding = replace(
            one.finding, is_tested=tested, support=support, is_main=bool(standing.is_main[f]),
            histogram=_histogram(agreed, surface, part, scale), histogram_m=_edges(scale),
        )  # fmt: skip
        enough = surface.sd <= limits.MOST_RMS * max(median, 1e-9)
        judged.append(replace(one, finding=finding, is_flat_enough=bool(enough)))
    return judged


def is_shown(surface: FaceSurface, support: float, exposed: float, scale: float) -> bool:
    """Tell whether a face is shown well enough to be tested."""
    return bool(
        support >= limits.LEAST_SUPPORT
        and surface.is_on.sum() >= limits.FEWEST_BEAMS
        and surface.area_m2 >= limits.LEAST_MEASURED_M2 * scale**2
        and exposed >= limits.LEAST_EXPOSED
    )


def _judge(
    agreed: Agreed, surface: FaceSurface, on: NDArray[np.int64], faces: DesignFaces, row: int
) -> Judged:
    f, beams = surface.face % len(faces), agreed.beams
    x, covariance = agreed.aligned.own_x[row], agreed.aligned.own_covariance[row]
    is_round = faces.sign[f] != 0
    ends = np.quantile(beams.uv[on], [limits.CORNERS, 1 - limits.CORNERS], axis=0).T  # of what was measured
    place, middle = faces.centre[f], ends.mean(axis=1)
    if is_round:
        place = place + middle[0] * faces.half[f, 0] * faces.normal[f]
        places, along = _around(beams.uv[on], beams.columns[on]), _unit(beams.normal[on].mean(axis=0))
    else:
        at = np.concatenate([_corners(beams.uv[on]), [middle]])
        places = np.column_stack([np.ones(len(at)), at, np.square(at) * surface.is_bent])
        along = _unit(faces.normal[f])
        place = place + (middle * faces.half[f]) @ np.stack([faces.u[f], faces.v[f]])
    delta = places @ x
    sd = np.sqrt(np.maximum(np.einsum("ei,ij,ej->e", places, covariance, places), 0.0))
    worst = int(np.argmax(np.abs(delta) + HALF_95 * sd))
    middle_offset = _linear(places[-1], x, covariance, along)
    finding = FaceFinding(
        element=int(faces.element[f]),
        kind="cylinder" if is_round else "plane",
        is_main=False,
        centre=faces.centre[f],
        normal=faces.normal[f],
        area_m2=float(faces.area[f]),
        measured_m2=min(surface.area_m2, float(faces.area[f])),
        n_beams=len(on),
        deviation=_interval(float(delta[worst]), float(sd[worst]), along),
        offset=_axis_shift(x, covariance, faces, f, float(middle[0])) if is_round else middle_offset,
        tilt=None if is_round else _tilt(x, covariance, faces.half[f]),
        bow=_bow(x, covariance, along) if surface.is_bent else None,
        radius=_linear(np.eye(N_COLUMNS)[4], x, covariance, None) if is_round else None,
        rms_m=float(surface.sd),
        place=place,
    )
    return Judged(finding, f, row, delta, sd, columns=places, is_far=surface.face >= len(faces))


def _corners(uv: FloatArray) -> FloatArray:
    """Middles (8, 2) of the outermost twentieth of what was measured, in eight directions over a plane."""
    turns = np.arange(8) * np.pi / 4
    along = uv @ np.stack([np.cos(turns), np.sin(turns)])
    edge = np.quantile(along, 1 - limits.CORNERS, axis=0)
    return np.array([uv[along[:, k] >= edge[k]].mean(axis=0) for k in range(8)])


def _around(uv: FloatArray, columns: FloatArray) -> FloatArray:
    """Places (e, 5) at both ends of a cylinder, in each octant that has beams."""
    low, high = np.quantile(uv[:, 0], [limits.CORNERS, 1 - limits.CORNERS])
    octant = np.floor((uv[:, 1] + 1) / 2 * _OCTANTS).astype(int) % _OCTANTS
    count = np.bincount(octant, minlength=_OCTANTS)
    rows = []
    for k in np.flatnonzero(count >= max(5, 0.02 * len(uv))):
        mean = columns[octant == k][:, [0, 1, 4]].mean(axis=0)
        rows += [[mean[0], mean[1], s * mean[0], s * mean[1], mean[2]] for s in (low, high)]
    return np.array(rows or [columns.mean(axis=0)])


def _bow(x: FloatArray, covariance: FloatArray, along: tuple[float, float, float]) -> Interval:
    """Rise of the middle over both ends, along u or v, whichever is larger, as if all were bent alike."""
    column = np.zeros(N_COLUMNS)
    column[3 + int(np.abs(x[4]) > np.abs(x[3]))] = -1.0
    return _linear(column, x, covariance, along)


def _interval(value: float, sd: float, along: tuple[float, float, float] | None) -> Interval:
    return Interval(float(value), float(value - HALF_95 * sd), float(value + HALF_95 * sd), along)


def _linear(
    column: FloatArray,
    x: FloatArray,
    covariance: FloatArray,
    along: tuple[float, float, float] | None,
) -> Interval:
    return _interval(float(column @ x), float(np.sqrt(max(float(column @ covariance @ column), 0.0))), along)


def _axis_shift(x: FloatArray, covariance: FloatArray, faces: DesignFaces, f: int, place: float) -> Interval:
    """Shift of a cylinder's axis at a place along it, -1 to 1, along the direction that it went."""
    shift = x[:2] + place * x[2:4]
    size = float(np.linalg.norm(shift))
    way = shift / size if size else np.array([1.0, 0.0])
    along = _unit(way[0] * faces.u[f] + way[1] * faces.v[f])
    return _linear(np.array([*way, *(place * way), 0.0]), x, covariance, along)


def _tilt(x: FloatArray, covariance: FloatArray, half: FloatArray) -> Interval:
    """Angle of a plane to the design's, radians, at most a right one."""
    turns = x[1:3] / half
    spread = covariance[1:3, 1:3] / np.outer(half, half)
    size = float(np.hypot(*turns))
    way = turns / size if size else np.array([1.0, 0.0])
    return _interval(size, float(np.sqrt(max(float(way @ spread @ way), 0.0))), None)


def _edges(scale: float) -> tuple[float, float]:
    """First and last edge of a histogram, metres."""
    return -_HISTOGRAM_M * scale, _HISTOGRAM_M * scale


def _histogram(agreed: Agreed, surface: FaceSurface, part: slice, scale: float) -> NDArray[np.int64]:
    """Beams on a face by their deviation, (40,)."""
    rows = np.flatnonzero(surface.is_on) + part.start
    low, high = _edges(scale)
    distances = np.clip(agreed.beams.distance[rows] - agreed.posed(rows), low, high)
    return np.histogram(distances, bins=40, range=(low, high))[0].astype(np.int64)


def _unit(vector: FloatArray) -> tuple[float, float, float]:
    x, y, z = (vector / max(float(np.sqrt(vector @ vector)), 1e-30)).tolist()
    return x, y, z


def thickness_of(a: Judged, b: Judged, aligned: Aligned, faces: DesignFaces) -> Interval | None:
    """Measured minus designed thickness between two faces that look away from each other, where both are.

    What scans share drops out, since both are estimated together. None where no part of one lies opposite a
    part of the other.
    """
    fa, fb = a.face, b.face
    place = (a.finding.place + b.finding.place) / 2
    columns = []
    for f in (fa, fb):
        away = place - faces.centre[f]
        uv = np.array([away @ faces.u[f], away @ faces.v[f]]) / faces.half[f]
        if (np.abs(uv) > 1.0).any():
            return None
        columns.append(np.array([1.0, *uv, 0.0, 0.0]))
    blocks = np.block([[aligned.among(k, other) for other in (a.row, b.row)] for k in (a.row, b.row)])
    prior = np.diag(np.repeat(aligned.prior[[a.row, b.row]], N_COLUMNS))
    joint = np.concatenate(columns)
    x = np.concatenate([aligned.x[a.row], aligned.x[b.row]])
    kept = np.array([0, 1, 2, N_COLUMNS, N_COLUMNS + 1, N_COLUMNS + 2])  # of planes
    blocks, prior, joint, x = blocks[np.ix_(kept, kept)], prior[np.ix_(kept, kept)], joint[kept], x[kept]
    inverse = np.linalg.inv(blocks)
    values, vectors = np.linalg.eigh(inverse - prior)
    own = vectors @ np.diag(1.0 / np.maximum(values, values[-1] * 1e-9)) @ vectors.T
    return _linear(joint, own @ inverse @ x, own, _unit(faces.normal[fa]))
