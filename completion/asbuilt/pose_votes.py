# SPDX-License-Identifier: MIT
"""Votes for poses of scans in a design: headings by what walls face, places by an exhaustive correlation.

Facets vote where surfaces of the design face the same way, and free beams vote against places where they
would run through surfaces; all shifts at once by Fourier transforms of volumes.
"""

from __future__ import annotations

import numpy as np
import scipy
from scipy import ndimage

from completion.asbuilt.design_rays import DesignRays
from completion.asbuilt.group_rays import GroupRays
from scenes.checks import FloatArray, IntArray

_N_BINS, _SPREAD_BINS = 720, 3.0  # of headings, half a degree each
_UPRIGHT = 0.17  # |z| of normals of walls: 10 deg
_N_HEADINGS, _LEAST_PEAK, _APART_BINS = 12, 0.5, 10  # headings tried; share of the best; 5 deg
_CELL_M, _MOST_CELLS = 0.15, 6_000_000  # of volumes, which are coarser where they are large
_BLUR, _AGAINST = 0.7, 2.0  # of the design's surfaces, cells; of beams against facets
_MOST_FACET_M2 = 0.25
_FREE_STEP_M, _END_M = 0.4, 0.4  # between places on free beams, and before their ends
_N_EACH = 40  # places of a heading


def vote(design: DesignRays, rays: GroupRays) -> FloatArray:
    """Return poses (k, 3, 4) of a group in a design, most votes first."""
    low, high = design.mesh.bounds()
    eye = rays.eye.mean(axis=0)
    reach = float(np.linalg.norm(high - low))
    near = np.linalg.norm(rays.centre - eye, axis=1) < reach
    centre, normal = rays.centre[near] - eye, rays.normal[near]
    weight = np.minimum(rays.area[near], _MOST_FACET_M2)
    free = _free_places(rays) - eye
    free = free[np.linalg.norm(free, axis=1) < reach]
    radius = np.array([*[np.linalg.norm(centre[:, :2], axis=1).max()] * 2, np.abs(centre[:, 2]).max()])
    extent = high - low + 2 * radius
    cell = max(_CELL_M, float(np.cbrt(extent.prod() / _MOST_CELLS)))
    shape = tuple(scipy.fft.next_fast_len(int(n), real=True) for n in np.ceil(extent / cell) + 4)
    volumes = _design_volumes(design, low, cell, shape)
    found: list[tuple[float, FloatArray]] = []
    for heading in headings(design, rays):
        turn = _about_z(heading)
        around = centre @ turn.T
        first = np.floor(around.min(axis=0) / cell) * cell
        classes = np.square(np.maximum(_six_ways(normal @ turn.T), 0.0)) * weight[:, None]
        total = np.zeros(volumes[0].shape, np.complex64)
        for k in range(6):
            total += volumes[k] * np.conj(_transform(around, classes[:, k], (first, cell, shape)))
        if len(free):
            against = np.full(len(free), -_AGAINST * weight.sum() / len(free))
            total += volumes[6] * np.conj(_transform(free @ turn.T, against, (first, cell, shape)))
        score = scipy.fft.irfftn(total, shape)
        for index in _peaks(score):
            # shifts wrap around: the scan's corner lies at most its own extent before the design's
            steps = np.where(index * cell > (high - low) + 4 * cell, index - np.array(shape), index)
            shift = low - 2 * cell + steps * cell - first
            pose = np.concatenate([turn, (shift - turn @ eye)[:, None]], axis=1)
            found.append((float(score[tuple(index)]), pose))
    found.sort(key=lambda each: -each[0])
    return np.array([pose for _, pose in found]).reshape(-1, 3, 4)


def headings(design: DesignRays, rays: GroupRays) -> FloatArray:
    """Return turns about z (k,), radians, that bring what a group's walls face to what the design's do."""
    of_design = _azimuths(design.normals, design.mesh.face_areas())
    of_scans = _azimuths(rays.normal, rays.area)
    match = np.fft.irfft(np.fft.rfft(of_design) * np.conj(np.fft.rfft(of_scans)), _N_BINS)
    chosen: list[int] = []
    for index in np.argsort(-match, kind="stable").tolist():
        if len(chosen) == _N_HEADINGS or match[index] < _LEAST_PEAK * match.max():
            break
        if all(min((index - k) % _N_BINS, (k - index) % _N_BINS) > _APART_BINS for k in chosen):
            chosen.append(index)
    return np.array(chosen) * (2 * np.pi / _N_BINS)


def _azimuths(normals: FloatArray, areas: FloatArray) -> FloatArray:
    """Area by the azimuth of walls, smoothed."""
    walls = np.abs(normals[:, 2]) < _UPRIGHT
    azimuth = np.arctan2(normals[walls, 1], normals[walls, 0])
    index = np.round(azimuth / (2 * np.pi) * _N_BINS).astype(np.int64) % _N_BINS
    counts = np.bincount(index, areas[walls], _N_BINS)
    return np.asarray(ndimage.gaussian_filter1d(counts, _SPREAD_BINS, mode="wrap"))


def _about_z(angle: float) -> FloatArray:
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])


def _six_ways(normals: FloatArray) -> FloatArray:
    return np.concatenate([normals, -normals], axis=1)


def _free_places(rays: GroupRays) -> FloatArray:
    """Places (m, 3) on beams, well before their ends."""
    steps = np.arange(_FREE_STEP_M, max(float(rays.range_m.max()), 2 * _FREE_STEP_M), _FREE_STEP_M)
    beam, step = np.nonzero(steps[None] < rays.range_m[:, None] - _END_M)
    return np.asarray(rays.origin[beam] + steps[step, None] * rays.direction[beam])


Volume = tuple[FloatArray, float, tuple[int, ...]]
"""The corner of a volume (3,), the side of its cells, metres, and how many there are along its axes."""


def _fill(places: FloatArray, weights: FloatArray, volume: Volume) -> FloatArray:
    corner, cell, shape = volume
    index = np.floor((places - corner) / cell).astype(np.int64)
    flat = np.ravel_multi_index(tuple(index.T), shape, mode="wrap")
    return np.bincount(flat, weights, int(np.prod(shape))).reshape(shape).astype(np.float32)


def _transform(places: FloatArray, weights: FloatArray, volume: Volume) -> FloatArray:
    return np.asarray(scipy.fft.rfftn(_fill(places, weights, volume)))


def _design_volumes(
    design: DesignRays, low: FloatArray, cell: float, shape: tuple[int, ...]
) -> list[FloatArray]:
    """Transforms of where surfaces face each of six ways, and of where there are any but leaves."""
    places, face, area = _samples(design, cell / 2)
    volume = low - 2 * cell, cell, shape
    classes = np.square(np.maximum(_six_ways(design.normals[face]), 0.0)) * area[:, None]
    solid = np.where(design.is_leaf[face], 0.0, area)
    return [
        scipy.fft.rfftn(
            ndimage.gaussian_filter(np.minimum(_fill(places, each, volume) / cell**2, 1.0), _BLUR)
        )
        for each in (*classes.T, solid)
    ]


def _samples(design: DesignRays, spacing: float) -> tuple[FloatArray, IntArray, FloatArray]:
    """Places (n, 3) all over the faces, of which face (n,) each is, and the area that it stands for (n,)."""
    areas = design.mesh.face_areas()
    count = np.maximum(np.ceil(areas / spacing**2), areas > 0).astype(np.int64)
    face = np.repeat(np.arange(len(areas)), count)
    number = np.arange(len(face)) - np.repeat(np.cumsum(count) - count, count)
    # additive recurrence in two dimensions, evenly over each face: M. Roberts, 2018
    u, v = ((0.5 + number * step) % 1.0 for step in (0.7548776662466927, 0.5698402909980532))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    a, b, c = np.moveaxis(design.mesh.corners[face], 1, 0)
    return a + u[:, None] * (b - a) + v[:, None] * (c - a), face, areas[face] / count[face]


def _peaks(score: FloatArray) -> IntArray:
    """Indices (k, 3) of the largest local maxima."""
    is_peak = (score == ndimage.maximum_filter(score, 3, mode="wrap")) & (score > 0)
    index = np.argwhere(is_peak)
    order = np.argsort(-score[is_peak], kind="stable")[:_N_EACH]
    return np.asarray(index[order])
