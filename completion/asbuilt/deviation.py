# SPDX-License-Identifier: MIT
"""Deviation of each face with its intervals: offset, tilt, bow, radius, and the corner farthest off."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from completion.asbuilt import limits
from completion.asbuilt.agreement import FaceBeams, FaceSurface
from completion.asbuilt.alignment import Aligned
from completion.asbuilt.faces import N_COLUMNS, DesignFaces
from completion.asbuilt.findings import FaceFinding, Interval
from scenes.checks import FloatArray

HALF_95 = 1.959964
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
    is_flat_enough: bool
    is_far: bool = False

    def is_within(self, tolerance_m: float) -> bool:
        """Whether all of it is within the tolerance, with 95 %."""
        return bool((np.abs(self.delta) + HALF_95 * self.sd <= tolerance_m).all())

    def deviates(self, tolerance_m: float, z: float) -> bool:
        """Whether some of it is beyond the tolerance by z standard deviations."""
        return bool((np.abs(self.delta) - z * self.sd > tolerance_m).any())


def judge_faces(
    beams: FaceBeams,
    surfaces: Sequence[FaceSurface],
    parts: Sequence[slice],
    aligned: Aligned,
    faces: DesignFaces,
    *,
    is_main: NDArray[np.bool_],
    support: FloatArray,
    exposed: FloatArray,
    origins: FloatArray,
    scale: float,
) -> list[Judged]:
    """Judge all faces with beams; `support` and `exposed` (F,) are shares."""
    near = [surface.sd for surface in surfaces if surface.face < len(faces)]
    median = float(np.median(near)) if near else 0.0
    row_of = {int(face): row for row, face in enumerate(aligned.faces)}
    judged = []
    for surface, part in zip(surfaces, parts, strict=True):
        if surface.face not in row_of:
            continue
        one = _judge(beams, surface, part, aligned, faces, row_of[surface.face], origins, scale)
        f = surface.face % len(faces)
        n = int(surface.is_on.sum())
        tested = (
            support[f] >= limits.LEAST_SUPPORT
            and n >= limits.FEWEST_BEAMS
            and surface.area_m2 >= limits.LEAST_MEASURED_M2 * scale**2
            and exposed[f] >= limits.LEAST_EXPOSED
        )
        finding = replace(
            one.finding, is_tested=bool(tested), support=float(support[f]), is_main=bool(is_main[f])
        )
        enough = surface.sd <= limits.MOST_RMS * max(median, 1e-9)
        judged.append(replace(one, finding=finding, is_flat_enough=bool(enough)))
    return judged


def _judge(
    beams: FaceBeams,
    surface: FaceSurface,
    part: slice,
    aligned: Aligned,
    faces: DesignFaces,
    row: int,
    origins: FloatArray,
    scale: float,
) -> Judged:
    f, on = surface.face % len(faces), np.flatnonzero(surface.is_on) + part.start
    x, covariance = aligned.own_x[row], aligned.own_covariance[row]
    is_round = faces.sign[f] != 0
    uv, columns = beams.uv[on], beams.columns[on]
    middle = surface.corners.mean(axis=1)
    if is_round:
        places = _around(uv, columns)
    else:
        at = np.concatenate([_corners(uv), [middle]])
        places = np.column_stack([np.ones(len(at)), at, np.square(at) * surface.is_bent])
    delta = places @ x
    sd = np.sqrt(np.maximum(np.einsum("ei,ij,ej->e", places, covariance, places), 0.0))
    worst = int(np.argmax(np.abs(delta) + HALF_95 * sd))
    away = faces.normal[f] if not is_round else beams.normal[on].mean(axis=0)
    along = _unit(away)
    finding = FaceFinding(
        element=int(faces.element[f]),
        kind="cylinder" if is_round else "plane",
        is_main=False,
        centre=faces.centre[f],
        normal=faces.normal[f],
        area_m2=float(faces.area[f]),
        measured_m2=min(surface.area_m2, float(faces.area[f])),
        n_beams=len(on),
        deviation=_interval(delta[worst], sd[worst], along),
        offset=_axis_shift(x, covariance, faces, f, float(middle[0]))
        if is_round
        else _linear(places[-1], x, covariance, along),
        tilt=None if is_round else _tilt(x, covariance, faces.half[f]),
        bow=_bow(x, covariance, along) if surface.is_bent else None,
        radius=_linear(np.eye(N_COLUMNS)[4], x, covariance, None) if is_round else None,
        rms_m=float(surface.sd),
        place=faces.centre[f]
        + (
            middle[0] * faces.half[f, 0] * faces.normal[f]
            if is_round
            else middle[0] * faces.half[f, 0] * faces.u[f] + middle[1] * faces.half[f, 1] * faces.v[f]
        ),
        **_histogram(beams.distance[on] - _posed(beams, on, aligned, origins), scale),
    )
    return Judged(finding, f, row, delta, sd, places, True, is_far=surface.face >= len(faces))


def _posed(beams: FaceBeams, rows: NDArray[np.int64], aligned: Aligned, origins: FloatArray) -> FloatArray:
    """What the motions of scans make of the distances (n,) of beams."""
    points, normal, scan = beams.points[rows], beams.normal[rows], beams.scan[rows]
    own, common = aligned.motion[:-1][scan], aligned.motion[-1]
    total = np.einsum("ij,ij->i", np.cross(points - origins[scan], normal), own[:, :3])
    total += np.einsum("ij,ij->i", normal, own[:, 3:])
    return np.asarray(total + np.cross(points, normal) @ common[:3] + normal @ common[3:])


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
    return _interval(column @ x, np.sqrt(max(column @ covariance @ column, 0.0)), along)


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
    size = float(np.linalg.norm(turns))
    way = turns / size if size else np.array([1.0, 0.0])
    return _interval(size, float(np.sqrt(max(way @ spread @ way, 0.0))), None)


def _histogram(distances: FloatArray, scale: float) -> dict[str, object]:
    edge = 0.05 * scale
    counts = np.histogram(np.clip(distances, -edge, edge), bins=40, range=(-edge, edge))[0]
    return {"histogram": counts.astype(np.int64), "histogram_m": (-edge, edge)}


def _unit(vector: FloatArray) -> tuple[float, float, float]:
    x, y, z = (vector / max(float(np.linalg.norm(vector)), 1e-30)).tolist()
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
