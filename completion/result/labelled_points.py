# SPDX-License-Identifier: MIT
"""Labelled points: measured or inferred area as a mesh whose every vertex says where it comes from.

Measured points come some rows of a scan at a time, in little memory.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from completion.boundary.meshing import ChartMesh
from completion.boundary.range_mesh import mesh_range_image
from completion.extension.patch import Patch, Provenance
from completion.observe.observation import Observation
from completion.texturing.chart_texture import ChartTexture
from scenes.checks import ColourArray, FloatArray, Value
from scenes.mesh.labelled_mesh import triangle_areas
from scenes.run.mapping import trim
from scenes.scan.colour import colour_bytes

PROVENANCE_NAMES = {str(member.value): member.name.lower().replace("_", "-") for member in Provenance}
"""Names of the provenances in files, by their numbers as text."""
GREY = 160
"""sRGB of what has no colour."""
_OF_VERTICES = ("vertices", "surface", "provenance", "sd", "confidence", "colour")


@dataclass(frozen=True, slots=True, eq=False)
class LabelledPoints(Value):
    """A mesh whose every vertex says where it comes from.

    Attributes
    ----------
    vertices : (n, 3) float
        Metres.
    faces : (m, 3) int32
        Triangles.
    surface : (n,) int32
        Number of the surface, from 1; 0 for none.
    provenance : (n,) int32
        A `Provenance`.
    sd : (n,) float
        Predicted standard deviation, metres.
    confidence : (n,) float
        Probability that the surface is there; 1 for what was measured.
    colour : (n, 3) uint8
        sRGB.
    """

    vertices: FloatArray
    faces: NDArray[np.int32]
    surface: NDArray[np.int32]
    provenance: NDArray[np.int32]
    sd: FloatArray
    confidence: FloatArray
    colour: ColourArray

    @property
    def of_vertices(self) -> tuple[str, ...]:
        """What is told of each vertex."""
        return _OF_VERTICES

    @property
    def area_m2(self) -> float:
        """Area of the triangles, square metres."""
        return mesh_area(self.vertices, self.faces)

    def part(self, kept: NDArray[np.bool_]) -> LabelledPoints:
        """Return some of the faces (m,) with the vertices that they use, in their order."""
        faces, is_used = self.faces[kept], np.zeros(len(self.vertices), np.bool_)
        is_used[faces] = True
        number = np.cumsum(is_used, dtype=np.int32) - 1
        columns = {name: getattr(self, name)[is_used] for name in _OF_VERTICES}
        return LabelledPoints(faces=number[faces], **columns)


def mesh_area(vertices: FloatArray, faces: NDArray[np.integer[Any]]) -> float:
    """Area in square metres of triangles (m, 3) of vertices (n, 3) in metres."""
    return float(triangle_areas(vertices[faces]).sum())


def hypothesised_parts(
    patches: Sequence[Patch], meshes: Sequence[ChartMesh], textures: Sequence[ChartTexture | None]
) -> Iterator[LabelledPoints]:
    """Yield the inferred cells of each surface, working frame, in the colours of its texture.

    `meshes` are the inferred cells of each patch, every cell by itself; `textures` may be fewer. Surfaces of
    which nothing was inferred are left out.
    """
    for index, (patch, mesh) in enumerate(zip(patches, meshes, strict=True)):
        if len(mesh.faces):
            texture = textures[index] if index < len(textures) else None
            yield _inferred_points(patch, index + 1, mesh, texture)
            trim()


def _inferred_points(
    patch: Patch, number: int, mesh: ChartMesh, texture: ChartTexture | None
) -> LabelledPoints:
    """Inferred cells of one surface; where faces meet in a vertex, the largest value counts."""
    n = len(mesh.vertices)
    provenance, confidence = np.zeros(n, np.int32), np.zeros(n)
    of_face = patch.provenance.ravel()[mesh.face_cell].astype(np.int32)
    np.maximum.at(provenance, mesh.faces.ravel(), np.repeat(of_face, 3))
    np.maximum.at(confidence, mesh.faces.ravel(), np.repeat(patch.confidence.ravel()[mesh.face_cell], 3))
    colour = np.full((n, 3), GREY, np.uint8)
    if texture is not None:
        colour = texture.colour_at(patch.grid.uv_of(*mesh.cells.T))
    return LabelledPoints(
        vertices=mesh.vertices,
        faces=mesh.faces,
        surface=np.full(n, number, np.int32),
        provenance=provenance,
        sd=patch.stated.standard_deviation(mesh.vertices),
        confidence=confidence,
        colour=colour,
    )


def join_points(parts: Sequence[LabelledPoints]) -> LabelledPoints:
    """Return all parts as one mesh, in their order."""
    if len(parts) == 1:
        return parts[0]
    none, real, places = np.zeros(0, np.int32), np.zeros(0), np.zeros((0, 3))
    colour, faces = places.astype(np.uint8), places.astype(np.int32)
    nothing = LabelledPoints(places, faces, none, none, real, confidence=real, colour=colour)
    every, start = (nothing, *parts), np.cumsum([0, 0, *(len(part.vertices) for part in parts)])
    shifted = [part.faces + offset for part, offset in zip(every, start, strict=False)]
    columns: dict[str, Any] = {
        n: np.concatenate([getattr(points, n) for points in every]) for n in _OF_VERTICES
    }
    return LabelledPoints(faces=np.concatenate(shifted).astype(np.int32), **columns)


Shifts = Sequence[NDArray[np.float32]]
"""By how many metres the pixels (rows, columns) of each scan are moved along their rays; empty for none."""
_BAND = 1 << 18  # pixels that are meshed at a time
_STEP = 6.0  # pixels' footprints, and standard deviations, that neighbours may be apart
_MOST_FACES = 600_000  # of what belongs to no surface
_MOST_POINTS = 10_000_000  # what programs that show points still turn smoothly


@dataclass(frozen=True, slots=True, eq=False)
class _Band:
    """Some rows of a scan, and the row after them, to which their triangles go on."""

    points: LabelledPoints
    n_own: int  # vertices before the row after


@dataclass(frozen=True, slots=True, eq=False)
class Remainder(Value):
    """What belongs to no surface.

    Attributes
    ----------
    points : LabelledPoints
        The points, and those beside them, with the triangles at the former, working frame.
    error_m : (n,) float
        What the scans cannot tell apart at each: two standard deviations of the range, or half the distance
        of pixels there if that is larger, metres.
    step : int
        Of every how many rows and columns they are.
    """

    points: LabelledPoints
    error_m: FloatArray
    step: int


def observed_parts(
    observations: Sequence[Observation],
    owners: Sequence[NDArray[np.int32]],
    step: int = 1,
    shifts: Shifts = (),
) -> Iterator[LabelledPoints]:
    """Yield measured points of all scans, of every step-th row and column, working frame.

    Some rows of a scan come at a time.

    Triangles are numbered from the part's first vertex on; the last ones of a part have corners in the next.
    `owners`, (rows, columns) for each scan, hold the number of the surface of each pixel; 0 for none.
    `shifts`, the same or none at all, hold by how many metres each pixel is moved along its ray.
    """
    for seen, owner, shift in zip(observations, owners, _of_each(shifts, observations), strict=True):
        for band in _bands(seen, owner, step, shift):
            held = band.points
            yield replace(held, **{name: getattr(held, name)[: band.n_own] for name in held.of_vertices})
            trim()


def observed_step(observations: Sequence[Observation]) -> int:
    """Of every how many rows and columns ten million points come at most."""
    n_measured = 0
    for seen in (
        observations
        if sum(observation.scan.ranges.size for observation in observations) > _MOST_POINTS
        else ()
    ):
        n_measured += int(np.count_nonzero(seen.valid))
        trim()
    return max(1, int(np.ceil(np.sqrt(n_measured / _MOST_POINTS))))


def observed_mesh(
    observations: Sequence[Observation], owners: Sequence[NDArray[np.int32]], shifts: Shifts = ()
) -> LabelledPoints:
    """Return all measured points of all scans as one mesh, working frame.

    `owners` and `shifts`, (rows, columns) for each scan, as for `observed_parts`.
    """
    return join_points(list(observed_parts(observations, owners, shifts=shifts)))


def remainder(
    observations: Sequence[Observation], owners: Sequence[NDArray[np.int32]], shifts: Shifts = ()
) -> Remainder:
    """Return the points that belong to no surface, with the triangles at them, working frame.

    Where these would be more than six hundred thousand, it is made of every k-th row and column.
    `owners` and `shifts`, (rows, columns) for each scan, as for `observed_parts`.
    """
    n_free = sum(map(_n_free, observations, owners))
    stride = max(1, int(np.ceil(np.sqrt(2 * n_free / _MOST_FACES))))
    parts, errors = [], [np.zeros(0)]
    for seen, owner, shift in zip(observations, owners, _of_each(shifts, observations), strict=True):
        for band in _bands(seen, owner, stride, shift):
            first, second, third = (band.points.surface == 0)[band.points.faces.T]
            parts.append(band.points.part(first | second | third))
            distance = np.linalg.norm(parts[-1].vertices - seen.scan.origin, axis=1)
            half = distance * (seen.scan.projection.pixel_angle * stride / 2)
            errors.append(np.maximum(2 * parts[-1].sd, half))
            trim()
    return Remainder(join_points(parts), np.concatenate(errors), stride)


def _n_free(seen: Observation, owner: NDArray[np.int32]) -> int:
    """How many measured pixels belong to no surface."""
    trim()
    return int(np.count_nonzero((owner == 0) & seen.valid))


def _of_each(shifts: Shifts, observations: Sequence[Observation]) -> Sequence[NDArray[np.float32] | None]:
    """The shifts of each scan; None where nothing is moved."""
    return shifts or [None] * len(observations)


def _bands(
    seen: Observation, owner: NDArray[np.int32], stride: int, shift: NDArray[np.float32] | None
) -> Iterator[_Band]:
    """Every stride-th row and column of a scan, so many rows at a time."""
    rows, columns = (np.arange(0, size, stride) for size in owner.shape)
    at_a_time = max(1, _BAND // len(columns))
    for first in range(0, len(rows), at_a_time):
        pixel = rows[first : first + at_a_time + 1, None] * owner.shape[1] + columns
        band = _band(seen, owner, pixel, min(at_a_time, len(rows) - first), stride)
        yield band if shift is None else _shift_band(band, seen, shift.ravel()[pixel].ravel(), pixel.ravel())


def _shift_band(
    band: _Band, seen: Observation, shift: NDArray[np.float32], pixel: NDArray[np.int64]
) -> _Band:
    """A band whose flat pixels (n,) move by so many metres (n,) along their rays; triangles stay."""
    valid = np.isfinite(seen.scan.ranges.ravel()[pixel])
    moved = band.points.vertices + shift[valid, None] * seen.rays_at(pixel[valid])
    return replace(band, points=replace(band.points, vertices=moved))


def _band(
    seen: Observation, owner: NDArray[np.int32], pixel: NDArray[np.int64], n_rows: int, stride: int
) -> _Band:
    """The mesh of flat pixels (rows, columns), of which `n_rows` rows are its own."""
    ranges = seen.scan.ranges.ravel()[pixel]
    valid = np.isfinite(ranges)
    footprint = np.where(valid, ranges, 0.0) * (seen.scan.projection.pixel_angle * stride)
    points, sigma = seen.points_at(pixel.ravel()), seen.noise.deviation(ranges.ravel())
    allowed = _STEP * footprint + _STEP * sigma.reshape(pixel.shape)
    faces = mesh_range_image(points.reshape(*pixel.shape, 3), valid, allowed, seen.scan.origin)
    used = np.flatnonzero(valid)
    number = np.full(valid.size, -1, np.int32)
    number[used] = np.arange(len(used), dtype=np.int32)
    held = pixel.ravel()[used]
    colour = np.full((len(used), 3), GREY, np.uint8)
    if seen.scan.colour is not None:
        colour = colour_bytes(seen.scan.colour.reshape(-1, 3)[held])
    mesh = LabelledPoints(
        vertices=points[used],
        faces=number[faces],
        surface=owner.ravel()[held],
        provenance=np.full(len(used), Provenance.MEASURED, np.int32),
        sd=sigma[used],
        confidence=np.ones(len(used)),
        colour=colour,
    )
    return _Band(mesh, int(np.count_nonzero(valid[:n_rows])))
