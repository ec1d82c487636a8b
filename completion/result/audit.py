# SPDX-License-Identifier: MIT
"""Audit: re-measure on the finished mesh, by ray casting, how much hypothesis stands in observed free space.

It shares no code with the extension: it knows scans and triangles, neither charts nor labels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from completion.observe.observation import Observation
from completion.observe.rays import Rays, dot, ray_at
from completion.observe.tolerance import Tolerance
from scenes.checks import FloatArray, Value
from scenes.mesh.labelled_mesh import triangle_areas
from scenes.rays.raycast import RayCaster
from scenes.run.mapping import trim
from texture.engine.compiled import compiled

_TILE = 16  # pixels: side of the squares whose beams are left out together
_TILES = 512  # that are cast at a time
_PIECES = 32  # along the longest side of a mesh, each with a sphere around it
_SLACK = 1e-6  # of rounding, metres and radians


@dataclass(frozen=True, slots=True, eq=False)
class AuditResult(Value):
    """What the beams say of a hypothesised mesh.

    Attributes
    ----------
    violation_m2 : float
        Area of the faces that observed beams went through, square metres.
    faces : (k,) int64
        Those faces.
    overlap_m2 : float
        Area that was inferred of several surfaces at once, square metres.
    """

    violation_m2: float
    faces: NDArray[np.int64]
    overlap_m2: float = 0.0


class Bundles(NamedTuple):
    """The beams of a scan in n squares of 16 x 16 pixels, in reading order."""

    axis: FloatArray  # (n, 3) unit direction of each
    cosine: FloatArray  # (n,) of the angle from it within which its beams lie
    sine: FloatArray  # (n,)
    far: FloatArray  # (n,) its farthest range, metres; 0 where nothing came back
    around: FloatArray  # (5,) axis of a cone around all, its angle, and the farthest range; radians, metres
    ends: FloatArray  # (rows, columns) how far each beam surely got, metres; inf where nothing came back


def bundle(seen: Observation) -> Bundles:
    """Return the beams of a scan in bundles."""
    ends = seen.beam_ends()
    axis, cosine, sine, far = _bundles(seen.rays, ends)
    around = _cone_around(axis[far > 0], cosine[far > 0], far)
    return Bundles(axis, cosine, sine, far, around=around, ends=ends)


def _cone_around(axis: FloatArray, cosine: FloatArray, far: FloatArray) -> FloatArray:
    """Axis and angle of a cone around some bundles, and the farthest range."""
    middle, angle = axis.sum(axis=0), np.pi
    length = float(np.linalg.norm(middle))
    if length > _SLACK:
        middle = middle / length
        off = np.arccos(np.clip(axis @ middle, -1.0, 1.0)) + np.arccos(np.clip(cosine, -1.0, 1.0))
        angle = min(float(off.max()) + _SLACK, np.pi)
    return np.array([*middle, angle, far.max(initial=0.0)])


def audit(
    vertices: FloatArray,
    faces: NDArray[np.int32],
    vertex_sd: FloatArray,
    observations: Sequence[Observation],
    bundles: Sequence[Bundles],
    *,
    tolerance: Tolerance,
) -> AuditResult:
    """Cast the measured beams against a mesh and count the faces that they went through.

    A beam goes through a face when it meets it nearer than what it measured by more than the tolerance
    k sqrt(sigma^2 + (s / cos)^2) + t / cos, with s the face's predicted standard deviation and flatness
    together and t the registration error. Without noise one beam convicts a face; with noise it takes two
    beams on faces that share a vertex. Beams that surely pass beside the mesh or end before it are not cast.
    Mixed beams count as far as they are sure to have got.

    Parameters
    ----------
    vertices, faces : (n, 3) float, (m, 3) int
        The hypothesised mesh, same frame as the scans: that of one surface, so that none hides another.
    vertex_sd : (n,) float
        Predicted standard deviation at the vertices, metres.
    observations : sequence of Observation
        All scans.
    bundles : sequence of Bundles
        Of each scan.
    tolerance : Tolerance
        Along the ray; a beam whose tolerance exceeds `max_m` says nothing.
    """
    if not len(faces):
        return AuditResult(0.0, np.zeros(0, np.int64))
    caster, spheres = RayCaster(vertices, faces, n_threads=1), _spheres(vertices, faces)
    beams, noisy = np.zeros(len(faces), np.int64), any(seen.is_noisy for seen in observations)
    for number in _facing_scans(observations, bundles, vertices[np.unique(faces)]):
        seen, of_scan = observations[number], bundles[number]
        within, ends = tolerance.of_pose(seen.pose_error_m), of_scan.ends
        chosen = _towards(of_scan, seen.rays.origin, *spheres)
        for tile in np.array_split(chosen, -(-len(chosen) // _TILES)) if len(chosen) else ():
            pixels = _returning_pixels(tile, ends)
            hits = caster.first_hit(seen.scan.origin[None], seen.rays_at(pixels), coherent=True)
            met = np.flatnonzero(hits.hit)
            face, measured = hits.face[met], ends.ravel()[pixels[met]]
            sd = vertex_sd[faces[face]].max(axis=1)
            allowed = within.along_ray(seen.noise.deviation(measured), sd, hits.incidence_cosine[met])
            through = (measured - hits.ranges[met] > allowed) & (allowed <= tolerance.max_m)
            beams += np.bincount(face[through], minlength=len(faces))
            trim()
    convicted = beams > 0
    if noisy and convicted.any():
        at_vertex = np.bincount(faces.ravel(), np.repeat(beams, 3), minlength=len(vertices))
        convicted &= at_vertex[faces].max(axis=1) >= 2
    area = float(triangle_areas(vertices[faces[convicted]]).sum())
    return AuditResult(area, np.flatnonzero(convicted))


def _facing_scans(
    observations: Sequence[Observation], bundles: Sequence[Bundles], points: FloatArray
) -> list[int]:
    """Which scans have beams that may get into a sphere around points (n, 3)."""
    low, high = points.min(axis=0), points.max(axis=0)
    radius = float(np.linalg.norm(high - low)) / 2 + _SLACK
    way = (low + high) / 2 - np.array([seen.rays.origin for seen in observations])
    around, distance = np.array([bundle.around for bundle in bundles]), np.linalg.norm(way, axis=1)
    along = np.einsum("ij,ij->i", around[:, :3], way) / np.maximum(distance, radius)
    beside = np.arccos(np.clip(along, -1.0, 1.0)) > (
        around[:, 3] + np.arcsin(radius / np.maximum(distance, radius)) + _SLACK
    )
    reaches = around[:, 4] >= distance - radius
    return np.flatnonzero(reaches & ~(beside & (distance > radius))).tolist()


def _spheres(vertices: FloatArray, faces: NDArray[np.int32]) -> tuple[FloatArray, FloatArray]:
    """Centres (k, 3), radii (k,) of spheres that hold all faces, each some whose first corners lie near."""
    first = vertices[faces[:, 0]]
    low, high = first.min(axis=0), first.max(axis=0)
    side = (high - low).max() / _PIECES * (1 + _SLACK) + _SLACK
    cell = ((first - low) / side).astype(np.int64)
    box, n = (cell[:, 0] * _PIECES + cell[:, 1]) * _PIECES + cell[:, 2], _PIECES**3
    count = np.bincount(box, minlength=n)
    sums = np.column_stack([np.bincount(box, first[:, axis], n) for axis in range(3)])
    centre = sums / np.maximum(count, 1)[:, None]
    square = np.zeros(n)
    for corner in range(3):
        away = np.square(vertices[faces[:, corner]] - centre[box])
        np.maximum.at(square, box, away[:, 0] + away[:, 1] + away[:, 2])
    held = np.flatnonzero(count)
    return centre[held], np.sqrt(square[held]) + _SLACK


@compiled
def _bundles(rays: Rays, ranges: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Axes, cosines and sines of the spread, and farthest ranges of the squares of an image."""
    rows, columns = (ranges.shape[0] + _TILE - 1) // _TILE, (ranges.shape[1] + _TILE - 1) // _TILE
    axis, far = np.zeros((rows * columns, 3)), np.zeros(rows * columns)
    cosine, sine = np.ones(rows * columns), np.zeros(rows * columns)
    for square in range(rows * columns):
        top, left = square // columns * _TILE, square % columns * _TILE
        bottom, right = min(top + _TILE, ranges.shape[0]), min(left + _TILE, ranges.shape[1])
        x, y, z = 0.0, 0.0, 0.0
        for i in range(top, bottom):
            for j in range(left, right):
                if np.isfinite(ranges[i, j]):
                    a, b, c = ray_at(rays, i, j)
                    x, y, z = x + a, y + b, z + c
                    far[square] = max(far[square], ranges[i, j])
        length = np.sqrt(x * x + y * y + z * z)
        if length < _SLACK:
            cosine[square] = -1.0  # beams to all sides, or none
            continue
        x, y, z = x / length, y / length, z / length
        axis[square, 0], axis[square, 1], axis[square, 2] = x, y, z
        least = 1.0
        for i in range(top, bottom):
            for j in range(left, right):
                if np.isfinite(ranges[i, j]):
                    least = min(least, dot((x, y, z), ray_at(rays, i, j)))
        angle = np.arccos(max(least, -1.0)) + _SLACK
        cosine[square], sine[square] = np.cos(angle), np.sin(angle)
    return axis, cosine, sine, far


@compiled
def _towards(
    bundles: Bundles, origin: tuple[float, float, float], centres: FloatArray, radii: FloatArray
) -> NDArray[np.int64]:
    """The squares (k,) of whose beams some may meet one of the spheres before they end."""
    most, farthest, n = len(radii), bundles.far.max(), 0
    way, cosine, sine, near = np.empty((most, 3)), np.empty(most), np.empty(most), np.empty(most)
    for sphere in range(most):
        for axis in range(3):
            way[n, axis] = centres[sphere, axis] - origin[axis]
        distance = np.sqrt(way[n, 0] ** 2 + way[n, 1] ** 2 + way[n, 2] ** 2)
        near[n] = distance - radii[sphere]
        if near[n] > farthest:
            continue
        if near[n] > 0.0:
            way[n] /= distance
            sine[n] = radii[sphere] / distance
            cosine[n] = np.sqrt(1.0 - sine[n] * sine[n])
        n += 1
    chosen, count = np.empty(len(bundles.far), np.int64), 0
    for square in range(len(bundles.far)):
        for k in range(n):
            if bundles.far[square] < near[k]:
                continue
            if near[k] > 0.0 and bundles.cosine[square] > -cosine[k]:  # else together more than half a turn
                along = 0.0
                for axis in range(3):
                    along += bundles.axis[square, axis] * way[k, axis]
                if along < bundles.cosine[square] * cosine[k] - bundles.sine[square] * sine[k]:
                    continue
            chosen[count] = square
            count += 1
            break
    return chosen[:count]


@compiled
def _returning_pixels(squares: NDArray[np.int64], ranges: FloatArray) -> NDArray[np.int32]:
    """Flat pixels (n,) of some squares that brought something back."""
    pixels, count = np.empty(squares.size * _TILE * _TILE, np.int32), 0
    columns = (ranges.shape[1] + _TILE - 1) // _TILE
    for k in range(squares.size):
        top, left = squares[k] // columns * _TILE, squares[k] % columns * _TILE
        for i in range(top, min(top + _TILE, ranges.shape[0])):
            for j in range(left, min(left + _TILE, ranges.shape[1])):
                if np.isfinite(ranges[i, j]):
                    pixels[count] = i * ranges.shape[1] + j
                    count += 1
    return pixels[:count]
