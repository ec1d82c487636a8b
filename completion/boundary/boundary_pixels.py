# SPDX-License-Identifier: MIT
"""Boundary pixels of a surface's regions, told apart by what their neighbours saw."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from completion.boundary.limits import NEAR_STEPS, OBLIQUE_SHARE, RAGGED_SHARE
from completion.fitting.result import SurfaceFit
from completion.observe.observation import Observation, ScanPixels
from completion.observe.tolerance import Tolerance
from scenes.checks import BoolArray, FloatArray
from scenes.run.mapping import trim
from scenes.surfaces.catalogue import Surface

_STEPS = ((0, 1), (0, -1), (1, 0), (-1, 0))


class BoundaryKind(IntEnum):
    """Why a region ends at a boundary pixel (Dell'Acqua & Fisher 2002: true and false boundaries)."""

    CONTIGUOUS = 0  # the neighbour lies on the surface too, but on another one as well: a crease
    OWN_EDGE = 1  # the neighbouring beam went past the surface
    OCCLUDED = 2  # the neighbouring beam met something nearer
    LIMB = 3  # the neighbouring ray passes the surface altogether: it turns away there
    NO_RETURN = 4  # nothing came back
    FRAME = 5  # the image ends


@dataclass(frozen=True, slots=True, eq=False)
class BoundaryPixels:
    """Places half way between the last pixel of a region and the next."""

    uv: FloatArray  # (n, 2) chart coordinates, metres
    step: FloatArray  # (n, 2) way to the next pixel, metres: `uv` may be off by half to either side
    kind: NDArray[np.int8]  # (n,) a `BoundaryKind`

    def only(self, keep: BoolArray) -> BoundaryPixels:
        """Return the points that `keep` (n,) marks."""
        return BoundaryPixels(self.uv[keep], self.step[keep], self.kind[keep])

    def in_chart(self, chart: Surface, other: Surface) -> BoundaryPixels:
        """Return the points in another chart of the same surface."""
        ends = [other.to_uv(chart.from_uv(self.uv + sign * self.step / 2)) for sign in (-1.0, 1.0)]
        step = ends[1] - ends[0]
        if np.isfinite(other.period):
            step[:, 0] -= other.period * np.rint(step[:, 0] / other.period)
        return BoundaryPixels(other.to_uv(chart.from_uv(self.uv)), step, self.kind)


def find_boundary_pixels(
    fit: SurfaceFit,
    pixels: ScanPixels,
    observations: Sequence[Observation],
    tolerance: Tolerance,
    keys: Sequence[int] | None = None,
) -> BoundaryPixels:
    """Classify every boundary pixel of a surface from its pixels, in all scans or in the key frames `keys`.

    A range is compared with the surface's own along the neighbouring ray, never with the range of the last
    pixel: a fixed step in range would fire at grazing incidence. Places are in the chart of the fit's
    surface. One that no key frame measured has the boundary that the others saw.
    """
    measured = [number for number, _ in pixels.held]
    chosen = measured if keys is None else sorted(set(measured) & set(keys)) or measured
    none = BoundaryPixels(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0, np.int8))
    parts = [none] + [
        _pixels_beside(fit, last, observations[number], step, tolerance)
        for number in chosen
        for step, last in zip(_STEPS, _last_pixels(pixels[number].mask), strict=True)
        if len(last)
    ]
    return BoundaryPixels(
        np.concatenate([part.uv for part in parts]),
        np.concatenate([part.step for part in parts]),
        np.concatenate([part.kind for part in parts]),
    )


def ended_sides(boundary: BoundaryPixels, low: FloatArray, high: FloatArray) -> FloatArray:
    """Find the sides of the measured rectangle, `low` to `high` (2,), along most of which a surface ends.

    It ends where the neighbouring beam went past it, or brought nothing back: a wall before the open sky, or
    beyond the scanner's range. At a single pixel that says nothing, for something dark may stand there. Where
    most of a straight side is so, the hidden part of that side ends there too.

    Returns
    -------
    (2, 2) float
        Where the low and the high side (rows) along u and v (columns) end, metres; NaN where they were not
        seen to.
    """
    result = np.full((2, 2), np.nan)
    size = np.linalg.norm(boundary.step, axis=1)
    ends = np.isin(boundary.kind, (BoundaryKind.OWN_EDGE, BoundaryKind.NO_RETURN)) & (size > 0)
    for row, side in enumerate((low, high)):
        for axis in (0, 1):
            slack = NEAR_STEPS * size + RAGGED_SHARE * (high - low)[axis]
            near = ends & (np.abs(boundary.uv[:, axis] - side[axis]) <= slack)
            if near.any():
                pixel = float(np.quantile(size[near], 0.75))
                along = np.unique(np.floor(boundary.uv[near, 1 - axis] / pixel))
                if len(along) * pixel > (high - low)[1 - axis] / 2:
                    result[row, axis] = np.median(boundary.uv[near, axis])
    return result


def seen_ends(boundary: BoundaryPixels, low: float, high: float) -> FloatArray:
    """Share (2,) of the boundary at the low and the high end along v at which a surface was seen to end.

    It ends where the neighbouring beam went past it, and where the neighbour lies on it still, on something
    that touches it there. Behind what stands clear before it, where nothing came back, and where the image
    ends, it may go on.
    """
    size = np.linalg.norm(boundary.step, axis=1)
    across = (size > 0) & (np.abs(boundary.step[:, 1]) >= np.abs(boundary.step[:, 0]))
    across |= boundary.kind == BoundaryKind.FRAME
    ends = np.isin(boundary.kind, (BoundaryKind.OWN_EDGE, BoundaryKind.CONTIGUOUS))
    result = np.zeros(2)
    for row, end in enumerate((low, high)):
        near = across & (np.abs(boundary.uv[:, 1] - end) <= NEAR_STEPS * size + OBLIQUE_SHARE * (high - low))
        result[row] = np.count_nonzero(near & ends) / max(int(np.count_nonzero(near)), 1)
    return result


def _last_pixels(mask: BoolArray) -> list[NDArray[np.int64]]:
    """Pixels (n, 2) of a mask whose neighbour at each of the steps is not in it, found in its box."""
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return [np.zeros((0, 2), np.int64)] * len(_STEPS)
    corner = np.array([rows[0], columns[0]])
    box = mask[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    return [corner + np.argwhere(box & ~_shift_mask(box, step)) for step in _STEPS]


def _pixels_beside(
    fit: SurfaceFit, last: NDArray[np.int64], seen: Observation, step: tuple[int, int], tolerance: Tolerance
) -> BoundaryPixels:
    trim()
    chart = fit.surface
    beyond = last + step
    inside = ((beyond >= 0) & (beyond < seen.scan.shape)).all(axis=1)
    kind = np.full(len(last), BoundaryKind.FRAME, np.int8)
    uv, way = chart.to_uv(seen.points_at(_flat(last, seen))), np.zeros((len(last), 2))
    p, q = last[inside], beyond[inside]
    ray_p, ray_q = seen.rays_at(_flat(p, seen)), seen.rays_at(_flat(q, seen))
    origin = seen.scan.origin
    here, there = chart.ray_ranges(origin, ray_p), chart.ray_ranges(origin, ray_q)
    meets = np.isfinite(here) & np.isfinite(there)
    on_p = origin + np.where(meets, here, 0.0)[:, None] * ray_p
    on_q = origin + np.where(meets, there, 0.0)[:, None] * ray_q
    kind[inside] = _kinds(fit, seen, pixel=q, expected=there, points=on_q, rays=ray_q, tolerance=tolerance)
    kind[inside] = np.where(meets, kind[inside], BoundaryKind.LIMB)
    from_, to = chart.to_uv(on_p), chart.to_uv(on_q)
    jump = to - from_
    if np.isfinite(chart.period):
        jump[:, 0] -= chart.period * np.rint(jump[:, 0] / chart.period)
    uv[inside] = np.where(meets[:, None], from_ + jump / 2, uv[inside])
    way[inside] = np.where(meets[:, None], jump, 0.0)
    return BoundaryPixels(uv, way, kind)


def _kinds(
    fit: SurfaceFit,
    seen: Observation,
    pixel: NDArray[np.int64],
    expected: FloatArray,
    points: FloatArray,
    rays: FloatArray,
    tolerance: Tolerance,
) -> NDArray[np.int8]:
    """What the beams of `pixel` (n, 2) say of a surface that their rays meet at the range `expected` (n,)."""
    measured, sigma = seen.scan.ranges[tuple(pixel.T)], seen.sigma_at(_flat(pixel, seen))
    cosine = np.abs(np.einsum("ij,ij->i", rays, fit.surface.normal(points)))
    allowed = tolerance.of_pose(seen.pose_error_m).along_ray(sigma, fit.standard_deviation(points), cosine)
    beyond = measured - np.where(np.isfinite(expected), expected, 0.0)
    kind = np.select(
        [beyond > allowed, beyond < -allowed],
        [BoundaryKind.OWN_EDGE, BoundaryKind.OCCLUDED],
        BoundaryKind.CONTIGUOUS,
    )
    return np.where(np.isfinite(measured), kind, BoundaryKind.NO_RETURN).astype(np.int8)


def _flat(pixel: NDArray[np.int64], seen: Observation) -> NDArray[np.int64]:
    """Flat numbers (n,) of pixels (n, 2)."""
    return np.asarray(pixel[:, 0] * seen.scan.shape[1] + pixel[:, 1], dtype=np.int64)


def _shift_mask(mask: BoolArray, step: tuple[int, int]) -> BoolArray:
    """At each pixel the mask's value one step on, False beyond the image."""
    padded = np.pad(mask, 1)
    rows, columns = mask.shape
    return padded[1 + step[0] : 1 + step[0] + rows, 1 + step[1] : 1 + step[1] + columns]
