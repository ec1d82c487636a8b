# SPDX-License-Identifier: MIT
"""Refitting: surfaces from all their pixels at once, errors along the rays, each weighted by its variance."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numba import int64
from numpy.typing import NDArray

from completion.fitting.chart import axis_frame
from completion.fitting.result import SurfaceFit
from completion.observe.limits import FEWEST_BLOCKS, GRAZING_COSINE, LARGEST_RADIUS, MOST_CONDITION
from completion.observe.observation import LabelledBeams, Observation, ScanPixels
from completion.observe.packed_surfaces import gap_to, pack
from completion.observe.rays import Noise, Rays, Triple, deviation_at, ray_at
from scenes.checks import FloatArray
from scenes.run.mapping import trim
from scenes.surfaces.catalogue import Cylinder, Plane, Surface
from texture.engine.compiled import compiled, inlined

_LEVEL = 1e-6  # |cosine| below which a ray does not meet a plane


@dataclass(frozen=True, slots=True, eq=False)
class RefitEquations:
    """Normal equations of one surface: J'WJ, J'We, e'We, J'J, sum of squared distances, number of pixels."""

    matrix: FloatArray
    vector: FloatArray
    cost: float
    square: float
    n: int

    def step(self) -> FloatArray | None:
        """The Gauss-Newton step (k,); None where the pixels determine no surface."""
        scale = np.sqrt(np.diag(self.matrix))
        if self.n <= len(self.vector) or not (scale > 0).all():
            return None
        values, vectors = np.linalg.eigh(self.matrix / np.outer(scale, scale))
        if not values[-1] < MOST_CONDITION * values[0]:
            return None
        return np.asarray(vectors @ ((self.vector / scale) @ vectors / values) / scale)

    def replicate(self, times: int) -> RefitEquations:
        """The sums of so many times as many pixels like these."""
        return RefitEquations(
            self.matrix * times, self.vector * times, self.cost * times, self.square * times, self.n * times
        )


def add_up(
    surfaces: Sequence[Surface | None], beams: Iterable[LabelledBeams], flatness_m: float
) -> list[RefitEquations]:
    """Return the normal equations of every surface, in one pass over each set of beams."""
    n = len(surfaces)
    matrix, vector, sums = np.zeros((n, 5, 5)), np.zeros((n, 5)), np.zeros((n, 3))
    charts: dict[Triple, FloatArray] = {}  # by where beams start
    for beam in beams:
        trim()
        origin = beam.rays.origin
        if origin not in charts:
            start = np.array(origin)
            charts[origin] = np.array([_chart(surface, start) for surface in surfaces]).reshape(n, 14)
        pixels, labels = np.ascontiguousarray(beam.pixel), np.ascontiguousarray(beam.label)
        beams_read = pixels, labels, charts[origin], beam.ranges, beam.rays, beam.noise
        _add_rays(*beams_read, flatness_m, GRAZING_COSINE, matrix, vector, sums)
    matrix += np.tril(matrix, -1).transpose(0, 2, 1)
    size = [3 if isinstance(surface, Plane) else 5 for surface in surfaces]
    return [
        RefitEquations(
            matrix[i, :k, :k], vector[i, :k], float(sums[i, 0]), float(sums[i, 1]), int(sums[i, 2])
        )
        for i, k in enumerate(size)
    ]


def _chart(surface: Surface | None, origin: FloatArray) -> FloatArray:
    """Kind (0 plane, 1 cylinder, -1 none), sensor in the frame, frame by rows, radius with its sign."""
    if isinstance(surface, Plane):
        frame = np.stack([surface.u_direction, surface.v_direction, surface.normal_direction])
        return np.concatenate([[0.0], frame @ (origin - surface.point), frame.ravel(), [0.0]])
    if isinstance(surface, Cylinder):
        frame = axis_frame(surface.direction)
        signed = -surface.radius if surface.concave else surface.radius
        return np.concatenate([[1.0], frame @ (origin - surface.point), frame.ravel(), [signed]])
    return np.full(14, -1.0)


@compiled
def _add_rays(
    pixels: NDArray[np.int32],
    labels: NDArray[np.int32],
    charts: FloatArray,
    ranges: FloatArray,
    rays: Rays,
    noise: Noise,
    flat: float,
    least: float,
    matrix: FloatArray,
    vector: FloatArray,
    sums: FloatArray,
) -> None:
    """Add up, by label, the normal equations of the rays and their squares: weighted, plain, and how many.

    Neighbours mostly have one label: its sums are at hand along such a run.
    """
    last = 0
    while last < labels.size:
        first, label = last, labels[last] - 1
        while last < labels.size and labels[last] - 1 == label:
            last += 1
        if label < 0 or charts[label, 0] < 0.0:
            continue
        subset, chart, items = pixels[first:last], charts[label], (matrix[label], vector[label], sums[label])
        if chart[0] == 0.0:
            _add_to_plane(subset, chart, ranges, rays, noise, flat, items)
        else:
            _add_to_cylinder(subset, chart, ranges, rays, noise, flat, least, items)


@inlined
def _add_to_plane(
    pixels: NDArray[np.int32],
    chart: FloatArray,
    ranges: FloatArray,
    rays: Rays,
    noise: Noise,
    flat: float,
    arrays: tuple[FloatArray, FloatArray, FloatArray],
) -> None:
    """Add the rays of some pixels to a plane's sums: offset, and the slopes along its two axes."""
    matrix, vector, sums = arrays
    cost, square, count = sums[0], sums[1], sums[2]
    v0, v1, v2 = vector[0], vector[1], vector[2]
    m00, m10, m11 = matrix[0, 0], matrix[1, 0], matrix[1, 1]
    m20, m21, m22 = matrix[2, 0], matrix[2, 1], matrix[2, 2]
    row, columns = -1, ranges.shape[1]
    for pixel in pixels:
        column = pixel - row * columns
        if not 0 <= column < columns:
            row, column = pixel // columns, pixel % columns
        dx, dy, dz = _ray_in_frame(chart, ray_at(rays, row, column))
        if abs(dz) < _LEVEL:
            continue
        reach, measured = -chart[3] / dz, ranges[row, column]
        u, v = chart[1] + reach * dx, chart[2] + reach * dy
        error, sigma = measured - reach, deviation_at(noise, measured)
        weight = 1.0 / (sigma * sigma * dz * dz + flat * flat + 1e-30)
        gap = error * dz
        cost += weight * gap * gap
        square += gap * gap
        count += 1.0
        wu, wv = weight * u, weight * v
        v0 += weight * gap
        v1 += wu * gap
        v2 += wv * gap
        m00 += weight
        m10 += wu
        m11 += wu * u
        m20 += wv
        m21 += wv * u
        m22 += wv * v
    sums[0], sums[1], sums[2] = cost, square, count
    vector[0], vector[1], vector[2] = v0, v1, v2
    matrix[0, 0], matrix[1, 0], matrix[1, 1] = m00, m10, m11
    matrix[2, 0], matrix[2, 1], matrix[2, 2] = m20, m21, m22


@inlined
def _add_to_cylinder(
    pixels: NDArray[np.int32],
    chart: FloatArray,
    ranges: FloatArray,
    rays: Rays,
    noise: Noise,
    flat: float,
    least: float,
    arrays: tuple[FloatArray, FloatArray, FloatArray],
) -> None:
    """Add the rays of some pixels to a cylinder's sums: axis across, its slopes, and the radius."""
    (matrix, vector, sums), terms, columns = arrays, np.zeros(5), ranges.shape[1]
    ox, oy, oz, radius = chart[1], chart[2], chart[3], abs(chart[13])
    for pixel in pixels:
        row, column = pixel // columns, pixel % columns
        dx, dy, dz = _ray_in_frame(chart, ray_at(rays, row, column))
        measured, across = ranges[row, column], dx * dx + dy * dy
        middle = -(ox * dx + oy * dy) / max(across, 1e-18)
        fx, fy = ox + middle * dx, oy + middle * dy
        depth = radius * radius - fx * fx - fy * fy
        if depth <= 0.0 or across < 1e-12:
            continue
        half = np.sqrt(depth / across)
        reach = middle - half if chart[13] > 0 else middle + half
        u, v, z = (ox + reach * dx) / radius, (oy + reach * dy) / radius, oz + reach * dz
        slope = u * dx + v * dy
        if abs(slope) < least:
            continue
        error, sigma = measured - reach, deviation_at(noise, measured)
        weight = 1.0 / (sigma * sigma * slope * slope + flat * flat + 1e-30)
        gap = error * slope
        sums[0] += weight * gap * gap
        sums[1] += gap * gap
        sums[2] += 1.0
        terms[0], terms[1], terms[2], terms[3], terms[4] = u, v, z * u, z * v, 1.0
        for a in range(5):
            weighted = weight * terms[a]
            vector[a] += weighted * gap
            for b in range(a + 1):
                matrix[a, b] += weighted * terms[b]


@inlined
def _ray_in_frame(chart: FloatArray, ray: Triple) -> Triple:
    """A ray in the frame of a surface."""
    x, y, z = ray
    return (
        chart[4] * x + chart[5] * y + chart[6] * z,
        chart[7] * x + chart[8] * y + chart[9] * z,
        chart[10] * x + chart[11] * y + chart[12] * z,
    )


_BLOCK = 10  # pixels: neighbours within so many have residuals alike


def block_sums(
    surfaces: Sequence[Surface | None], beams: Iterable[LabelledBeams], flatness_m: float
) -> FloatArray:
    """Return of each surface (n, 4): n * mean^2 of each block's residuals, blocks; squares, pixels.

    The beams of each scan are in the order of its pixels. None has no residuals.
    """
    sums = np.zeros((len(surfaces), 4))
    for beam in beams:
        trim()
        origin = np.array(beam.rays.origin)
        models = np.array(
            [np.full(9, np.nan) if surface is None else pack(surface, origin) for surface in surfaces]
        ).reshape(len(surfaces), 9)
        rays = beam.pixel, beam.label, models, beam.ranges, beam.rays, beam.noise
        _add_blocks(*rays, flatness_m, _BLOCK, sums)
    return sums


def residual_correlation(sums: FloatArray) -> FloatArray:
    """By how much the residuals' means over blocks vary more than independent ones would, at least 1 (n,).

    From `block_sums` (n, 4). Surfaces with too few blocks to tell take what holds for all together.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        excess = (sums[:, 0] / sums[:, 1]) / (sums[:, 2] / sums[:, 3])
        total = sums.sum(axis=0)
        together = (total[0] / total[1]) / (total[2] / total[3])
    excess_of_scan = np.where(
        sums[:, 1] >= FEWEST_BLOCKS, excess, together if total[1] >= FEWEST_BLOCKS else 1.0
    )
    return np.fmax(excess_of_scan, 1.0)


@compiled
def _add_blocks(
    pixels: NDArray[np.int32],
    labels: NDArray[np.int32],
    models: FloatArray,
    ranges: FloatArray,
    rays: Rays,
    noise: Noise,
    flat: float,
    side: int,
    sums: FloatArray,
) -> None:
    """Add up `block_sums` of some pixels, a band of blocks after the other."""
    columns, n = ranges.shape[1], models.shape[0]
    total, count = np.zeros(n), np.zeros(n, np.int64)
    present, normal = np.empty(side * side, np.int64), np.zeros(3)
    begin = np.empty((columns - 1) // side + 3, np.int64)
    ordered = np.empty(side * columns, np.int64)
    first = int64(0)
    while first < pixels.size:
        band = pixels[first] // columns // side
        last = _sort_band(pixels, labels, first, band, columns, side, begin, ordered)
        for block in range(band % 2, begin.size - 2, 2):  # like the dark squares of a chessboard
            n_present = 0
            for k in ordered[begin[block] : begin[block + 1]]:
                label, i, j = labels[k] - 1, pixels[k] // columns, pixels[k] % columns
                x, y, z = ray_at(rays, i, j)
                gap, cosine = gap_to(models, label, x, y, z, ranges[i, j], normal)
                if not cosine > 0.0:
                    continue
                sigma = deviation_at(noise, ranges[i, j])
                residual = gap / np.sqrt(sigma * sigma * cosine * cosine + flat * flat + 1e-30)
                if count[label] == 0:
                    present[n_present] = label
                    n_present += 1
                count[label] += 1
                total[label] += residual
                sums[label, 2] += residual * residual
                sums[label, 3] += 1.0
            for index in range(n_present):
                label = present[index]
                if 2 * count[label] >= side * side:
                    sums[label, 0] += total[label] * total[label] / count[label]
                    sums[label, 1] += 1.0
                total[label], count[label] = 0.0, 0
        first = last


@inlined
def _sort_band(
    pixels: NDArray[np.int32],
    labels: NDArray[np.int32],
    first: int,
    band: int,
    columns: int,
    side: int,
    begin: NDArray[np.int64],
    ordered: NDArray[np.int64],
) -> int:
    """Write which labelled pixels of a band of rows lie in its blocks, and where each block's begin.

    They start at `first` and keep their order. Returned is where the next band starts.
    """
    begin[:] = 0
    last, limit = first, (band + 1) * side * columns
    while last < pixels.size and pixels[last] < limit:
        if labels[last] > 0:
            begin[pixels[last] % columns // side + 2] += 1
        last += 1
    for block in range(2, begin.size):
        begin[block] += begin[block - 1]
    for k in range(first, last):
        if labels[k] > 0:
            block = pixels[k] % columns // side
            ordered[begin[block + 1]] = k
            begin[block + 1] += 1
    return last


_THINNING = 3  # of the pixels that covariances are read from
_FEW = 2_000  # pixels of a surface that are not thinned


def refit(
    surfaces: Sequence[Surface],
    observations: Sequence[Observation],
    labels: Sequence[NDArray[np.int32]],
    flatness_m: float,
    n_rounds: int = 1,
) -> list[SurfaceFit | None]:
    """Fit planes and cylinders to their pixels by Gauss-Newton on the errors along the rays.

    Orthogonal distances pull a cylinder's radius in, since the foot of a noisy point moves sideways; along
    the known ray the place that was meant stays put. Pixels are weighted by the inverse variance of the
    range and of the surface's own flatness, seen along the ray.

    Parameters
    ----------
    surfaces : sequence of Plane or Cylinder
        Where to begin, working frame.
    observations : sequence of Observation
        The scans.
    labels : sequence of (rows, columns) int32
        For each, the surface of each pixel, from 1; 0 for none.
    flatness_m : float
        How far surfaces stray from their ideal form, metres.
    n_rounds : int
        Steps before the one whose covariance is returned.

    Returns
    -------
    list of SurfaceFit or None
        Covariances inflated by how much the residuals' means over blocks of pixels exceed independent ones;
        None where the pixels determine no such surface.
    """
    beams = [
        LabelledBeams.of(observation, label) for observation, label in zip(observations, labels, strict=True)
    ]
    return _with_inflation(*_improve_and_sum(surfaces, beams, flatness_m, n_rounds))


def refit_each(
    surfaces: Sequence[Surface],
    observations: Sequence[Observation],
    pixels: Sequence[ScanPixels],
    flatness_m: float,
    n_rounds: int = 1,
) -> list[SurfaceFit | None]:
    """`refit` from the pixels of each surface in each of the n scans, (n,), one surface after another.

    A pixel may belong to several surfaces. No memory of the size of an image is taken, nor of the pixels that
    a surface has in all scans.
    """
    placed: list[Surface | None] = []
    sums: list[RefitEquations] = []
    blocks = np.zeros((len(surfaces), 4))
    for k, (surface, pixel) in enumerate(zip(surfaces, pixels, strict=True)):
        beams = _BeamsOfOne(observations, pixel)
        (surface_none,), (equations,), blocks[k : k + 1] = _improve_and_sum(
            [surface], beams, flatness_m, n_rounds
        )
        placed.append(surface_none)
        sums.append(equations)
    return _with_inflation(placed, sums, blocks)


@dataclass(frozen=True, slots=True, eq=False)
class _BeamsOfOne:
    """The beams that met one surface, made scan by scan each time that they are gone through."""

    observations: Sequence[Observation]
    pixels: ScanPixels

    def __iter__(self) -> Iterator[LabelledBeams]:
        """Return the beams of each scan that has any."""
        for scan, sample in self.pixels.held:
            trim()
            yield LabelledBeams.at(self.observations[scan], sample.flat)


def _improve_and_sum(
    surfaces: Sequence[Surface], beams: Iterable[LabelledBeams], flatness_m: float, n_rounds: int
) -> tuple[list[Surface | None], list[RefitEquations], FloatArray]:
    """The surfaces after some steps, their normal equations there, and their `block_sums` (n, 4)."""
    placed = improve(surfaces, beams, flatness_m, n_rounds)
    return placed, _thinned_sums(placed, beams, flatness_m), block_sums(placed, beams, flatness_m)


def _with_inflation(
    placed: Sequence[Surface | None], sums: Sequence[RefitEquations], blocks: FloatArray
) -> list[SurfaceFit | None]:
    """The fits, their covariances inflated by what the means over blocks (n, 4) say."""
    return [
        None if surface is None or equations.step() is None else _fit(surface, equations, growth)
        for surface, equations, growth in zip(placed, sums, residual_correlation(blocks), strict=True)
    ]


def improve(
    surfaces: Sequence[Surface], beams: Iterable[LabelledBeams], flatness_m: float, n_rounds: int = 1
) -> list[Surface | None]:
    """The surfaces after some Gauss-Newton steps, None where a step loses one.

    Each step goes through the beams again.
    """
    placed: list[Surface | None] = list(surfaces)
    for _ in range(n_rounds):
        sums = add_up(placed, beams, flatness_m)
        placed = [_step_surface(surface, equations) for surface, equations in zip(placed, sums, strict=True)]
    return placed


def _thinned_sums(
    surfaces: Sequence[Surface | None], beams: Iterable[LabelledBeams], flatness_m: float
) -> list[RefitEquations]:
    """Normal equations from a share of the pixels, from all of them for small surfaces.

    Those that a grid's stride leaves of a narrow surface may stand in one line.
    """
    sample = map(_every_third, beams)
    sums = [equations.replicate(_THINNING) for equations in add_up(surfaces, sample, flatness_m)]
    small = np.array([number for number, equations in enumerate(sums) if equations.n < _FEW], dtype=np.int64)
    if len(small):
        every = add_up(surfaces, (beam.of_surfaces(small + 1) for beam in beams), flatness_m)
        sums = [every[k] if sums[k].n < _FEW else sums[k] for k in range(len(sums))]
    return sums


def _every_third(beams: LabelledBeams) -> LabelledBeams:
    """The beams of every third pixel of the scan, whichever of its pixels there are."""
    kept = beams.pixel % _THINNING == 0
    return replace(beams, pixel=beams.pixel[kept], label=beams.label[kept])


def _fit(surface: Surface, sums: RefitEquations, inflation: float) -> SurfaceFit:
    """The fit, its covariance by the weighted residuals themselves."""
    freedom = sums.n - len(sums.vector)
    covariance = np.asarray(sums.cost / freedom * np.linalg.inv(sums.matrix) * inflation, dtype=np.float64)
    rms = float(np.sqrt(sums.square / freedom))
    return SurfaceFit(surface, rms, covariance, sums.n, inflation=float(inflation))


def _step_surface(surface: Surface | None, sums: RefitEquations) -> Surface | None:
    """The surface after a step, None where it is lost."""
    if surface is None:
        return None
    if not isinstance(surface, Plane | Cylinder):
        raise TypeError(f"cannot refit a {type(surface).__name__}")
    step = sums.step()
    if step is None:
        return None
    if isinstance(surface, Plane):
        offset, by_u, by_v = step
        normal = surface.normal_direction - by_u * surface.u_direction - by_v * surface.v_direction
        return Plane(surface.point + offset * surface.normal_direction, normal, surface.u_direction)
    radius = surface.radius + step[4]
    if not 0 < radius < LARGEST_RADIUS * surface.radius:
        return None
    x, y, z = axis_frame(surface.direction)
    point = surface.point + step[0] * x + step[1] * y
    return Cylinder(point, z + step[2] * x + step[3] * y, radius, None, surface.concave)
