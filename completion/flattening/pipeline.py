# SPDX-License-Identifier: MIT
"""Flattening on one page: ripple goes from planes, relief stays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft, ndimage
from scipy.special import logsumexp

from completion.fitting.result import SurfaceFit
from completion.flattening import limits
from completion.flattening.flat import (
    FlatHeights,
    FlatRegion,
    FlatSurface,
    FlattenedMesh,
    FlatteningOptions,
    RegionKind,
)
from completion.flattening.mesh_movement import (
    HeightGrid,
    grid_of,
    hold_back,
    move_creases,
    move_onto,
    wrong_faces,
)
from completion.flattening.ripple import MARGIN
from completion.flattening.separation import ReliefCandidate, Separation, separate
from scenes.checks import BoolArray, FloatArray, InputError, check_faces, check_points, check_rng
from scenes.surfaces.catalogue import Plane

_WALLS = (6, 8)  # without relief, least and most
_SIDE, _CELLS = 160, 50_000  # the longest side of one; cells of all
_SCALES = np.geomspace(1e-2, 1e3, 400)  # nats: scales that a tail may have
_EXACT = 1e-3  # of the sd: a smaller middle error is none


@dataclass(frozen=True, slots=True)
class NullModel:
    """The most evident region of each of some walls without relief: its evidence in nats, `peaks`.

    Each such wall has `n_cells` cells.
    """

    peaks: tuple[float, ...]
    n_cells: int

    def p(self, evidence: float, n_cells: int) -> float:
        """How probably a wall of that many cells without relief shows a region of that evidence, or more.

        Peaks are of Gumbel's distribution, as the largest of many with exponential tails are. Its place and
        scale are what so few peaks tell, averaged over by the prior 1 / scale, by which predictions of
        location-scale families hold exactly. A wall of more cells shows more regions, but knows its ripple
        better: walls that methods are tuned on show more by the root of the number of cells.
        """
        if not self.peaks:
            return 1.0
        peaks, n = np.array(self.peaks), len(self.peaks)
        spread = max(float(np.std(peaks)), _EXACT)
        scales = spread * _SCALES
        log_sum = logsumexp(-peaks / scales[:, None], axis=1)
        log_weight = (1 - n) * np.log(scales) - peaks.sum() / scales - n * log_sum
        weight = np.exp(log_weight - log_weight.max())
        more = np.sqrt(n_cells / self.n_cells) * np.exp(np.minimum(-evidence / scales - log_sum, 700.0))
        return float(weight @ -np.expm1(-n * np.log1p(more)) / weight.sum())


NOTHING = NullModel((), 1)
"""Of walls on which nothing could stay: no evidence says anything."""


def learn_null(parts: Separation, rng: np.random.Generator) -> NullModel:
    """Make walls without relief with the ripple of a wall, and find regions on them.

    Their white noise is drawn from the whitened error itself, with its tails, and takes the ripple's
    spectrum. All that was learned from the wall is learned from each of them anew.
    """
    white = _white_noise(parts)
    shape = tuple(min(_SIDE, n) for n in _extent(parts.known))
    wide = tuple(fft.next_fast_len(n + MARGIN, real=True) for n in shape)
    n_walls = int(np.clip(_CELLS // (shape[0] * shape[1]), *_WALLS))
    gain = np.sqrt(parts.ripple.spectrum.on(wide, fall=0))
    peaks = list[float]()
    for _ in range(n_walls):
        noise = rng.choice(white, wide) * rng.choice([-1.0, 1.0], wide)
        heights = fft.irfft2(fft.rfft2(noise) * gain, s=wide)[: shape[0], : shape[1]]
        candidates = separate(heights - heights.mean(), np.ones(shape, np.bool_)).candidates
        peaks.append(max((candidate.evidence for candidate in candidates), default=0.0))
    return NullModel(tuple(peaks), shape[0] * shape[1])


def _white_noise(parts: Separation) -> FloatArray:
    """Whitened errors (n,) of unit sd, where there is no evident relief."""
    evident = tuple(
        candidate
        for candidate in parts.candidates
        if candidate.stands_out and candidate.evidence > limits.CLEAR_EVIDENCE
    )
    used = parts.known.copy()
    for candidate in evident:
        used &= ~parts.cells(candidate)
    used = (
        ndimage.binary_erosion(used, np.ones((3, 3)), iterations=limits.RIM_CELLS, border_value=1)
        if evident
        else used
    )
    if used.sum() < 0.1 * parts.known.sum():
        used = parts.known
    error = parts.ripple.extrapolate(parts.heights - parts.levels(evident), parts.known)
    white = parts.ripple.whiten(error)[used]
    white = white - np.median(white)
    sd = 1.4826 * float(np.median(np.abs(white)))
    if sd <= _EXACT * float(white.std()):  # most cells are exactly flat
        sd = max(float(white.std()), 1e-30)
    unit: FloatArray = np.clip(white / sd, -limits.FARTHEST_SD, limits.FARTHEST_SD)
    return unit


def _extent(known: BoolArray) -> tuple[int, int]:
    """Rows and columns between the first known ones and the last."""
    rows, columns = np.nonzero(known.any(axis=1))[0], np.nonzero(known.any(axis=0))[0]
    return int(np.ptp(rows)) + 1, int(np.ptp(columns)) + 1


def flatten_heights(
    heights: FloatArray,
    cell_m: float,
    options: FlatteningOptions = FlatteningOptions(),
    rng: np.random.Generator | int | None = 0,
) -> FlatHeights:
    """Take the ripple away from a height map of a plane, and leave its relief.

    After Cantzler, Fisher & Devy (2002), Improving architectural 3D reconstruction by plane and edge
    constraining, as shown in Fisher (2004), figure 3; how relief is told from ripple is ours.

    Parameters
    ----------
    heights : (rows, columns) float
        Over the plane, metres, NaN where nothing is known: in the chart of the plane, or along the rays of a
        range image whose pixels are nearly as dense everywhere.
    cell_m : float
        Side of a cell, metres.
    options : FlatteningOptions
        The level of the test, and whether relief is cleared too.
    rng : Generator, int or None
        Of the walls without relief from which p values are learned.

    Raises
    ------
    InputError
        Heights that are no field of two dimensions, or a cell that is no length.
    """
    heights = np.asarray(heights, dtype=np.float64)
    if heights.ndim != 2:
        raise InputError(f"expected heights with shape (rows, columns), got {heights.shape}")
    if not 0 < cell_m < np.inf:
        raise InputError(f"the side of a cell is a length above 0, not {cell_m} m")
    known = np.isfinite(heights)
    if min(heights.shape) < limits.LEAST_SIDE_CELLS or known.sum() < limits.LEAST_AREA_CELLS:
        rows, columns = heights.shape
        return _unchanged_heights(
            heights,
            f"{known.sum()} cells of {1000 * cell_m:.3g} mm on {rows} x {columns} are too few to tell ripple "
            f"from relief; {limits.LEAST_AREA_CELLS} on {limits.LEAST_SIDE_CELLS} x "
            f"{limits.LEAST_SIDE_CELLS} are needed",
        )

    # 1. Separate heights into levels and ripple, and learn what the ripple alone may look like.
    parts = separate(np.where(known, heights, 0.0), known)
    could_stay = [
        candidate.stands_out
        and candidate.n_cells >= limits.LEAST_RELIEF_CELLS
        and abs(candidate.height_m) > options.rounding_m
        for candidate in parts.candidates
    ]
    hidden_by_steps = options.rounding_m > 0 and not any(could_stay)
    null = NOTHING if hidden_by_steps else learn_null(parts, np.random.default_rng(rng))
    p = [null.p(candidate.evidence, int(known.sum())) for candidate in parts.candidates]

    # 2. Keep what a wall without relief would hardly show; all else is the plane.
    kept = tuple(
        candidate
        for candidate, q, could in zip(parts.candidates, p, could_stay, strict=True)
        if could and q <= options.level
    )
    level = parts.levels(kept)[: heights.shape[0], : heights.shape[1]]
    error = parts.ripple.extrapolate(parts.heights - parts.levels(kept), parts.known)
    ripple = parts.ripple.smooth(error)[: heights.shape[0], : heights.shape[1]]
    plane = known & (level == 0)
    ripple_sd = float(np.std(ripple[plane])) if plane.any() else 0.0

    # 3. The plane is flat; relief loses its ripple where that is told from its shape.
    flat = np.where(plane, 0.0, np.where(known, heights, np.nan))
    label = np.where(known, 0, -1).astype(np.int32)
    regions = list[FlatRegion]()
    for candidate, q in sorted(zip(parts.candidates, p, strict=True), key=lambda pair: pair[1]):
        if candidate in kept:
            cells = parts.cells(candidate)[: heights.shape[0], : heights.shape[1]] & known
            size = float(np.sqrt(np.mean(ripple[cells] ** 2)))
            clear = (
                options.clears_relief
                and candidate.sd_m <= limits.CLEAN_LEVEL * ripple_sd
                and size <= limits.OWN_SHAPE * ripple_sd
            )
            if clear:
                flat[cells] -= ripple[cells]
            regions.append(_region(candidate, RegionKind.RELIEF, q, cell_m, clear))
            label[cells] = len(regions)
    regions += [
        _region(candidate, RegionKind.FLATTENED, q, cell_m, True)
        for candidate, q in sorted(zip(parts.candidates, p, strict=True), key=lambda pair: pair[1])
        if candidate not in kept and candidate.evidence > min(null.peaks, default=np.inf)
    ]
    noise_sd = float(np.sqrt(parts.ripple.noise_power()))
    mean = float(np.mean(heights[plane])) if plane.any() else 0.0
    return FlatHeights(
        flat, label, ripple, tuple(regions), ripple_sd_m=ripple_sd, noise_sd_m=noise_sd, plane_m=mean
    )


def flatten_mesh(
    vertices: FloatArray,
    faces: NDArray[np.int32],
    labels: NDArray[np.int64],
    fits: Sequence[SurfaceFit],
    options: FlatteningOptions = FlatteningOptions(),
    *,
    origin: FloatArray | None = None,
    rng: np.random.Generator | int | None = 0,
) -> FlattenedMesh:
    """Take the ripple away from the planes of a mesh, and leave their relief.

    Vertices move along the normal of their plane, or, where `origin` says from where they were measured,
    along the rays; those on two or three planes go to where these meet. No face turns over or crosses
    another anew: vertices that would make one stay where they were. Along rays none can.

    Parameters
    ----------
    vertices : (n, 3) float
        Metres.
    faces : (m, 3) int
        Vertices of triangles; of points without any (0, 3).
    labels : (n,) int
        The surface of each vertex, from 1; 0 for none.
    fits : sequence of SurfaceFit
        Surface 1, 2, ...; those that are no planes are left alone.
    options : FlatteningOptions
        The level of the test, the cells.
    origin : (3,) or (n, 3) float or None
        Where the sensor stood, for range images: the pixels of a surface are the vertices, and the triangles
        between neighbouring pixels the faces.
    rng : Generator, int or None
        Of the walls without relief from which p values are learned; each plane learns from the same.

    Raises
    ------
    InputError
        Arrays whose shapes do not fit, or labels without a fit.
    """
    vertices = check_points("vertices", vertices)
    faces = check_faces(faces, len(vertices))
    labels = np.asarray(labels)
    if labels.shape != (len(vertices),):
        raise InputError(f"expected one label for each of {len(vertices)} vertices, got {labels.shape}")
    if len(labels) and labels.max() > len(fits):
        raise InputError(f"label {labels.max()} has no fit: there are {len(fits)}")
    rays = None if origin is None else np.broadcast_to(np.asarray(origin, dtype=np.float64), vertices.shape)
    seed = int(check_rng(rng).integers(2**63))
    moved, flat = vertices.copy(), np.zeros(len(vertices), np.int64)
    is_relief = np.zeros(len(vertices), np.bool_)
    planes, surfaces = dict[int, tuple[Plane, float]](), list[FlatSurface]()

    # 1. Flatten the heights of each plane, and move its vertices to them.
    for label, fit in enumerate(fits, 1):
        members = np.flatnonzero(labels == label)
        if not isinstance(fit.surface, Plane) or len(members) < 3:
            continue
        number = np.full(len(vertices), -1)
        number[members] = np.arange(len(members))
        inner = number[faces[np.all(labels[faces] == label, axis=1)]].astype(np.int32)
        grid = grid_of(vertices[members], inner, fit.surface, options.cell_m, options.most_cells)
        heights = flatten_heights(grid.heights, grid.cell_m, options, seed)
        surfaces.append(
            FlatSurface(
                label=label,
                regions=heights.regions,
                ripple_sd_m=heights.ripple_sd_m,
                noise_sd_m=heights.noise_sd_m,
                plane_m=heights.plane_m,
                cell_m=grid.cell_m,
                reason=heights.reason,
            )
        )
        if heights.reason:
            continue
        height, region = _heights_of(grid, heights, fit.surface.distance(vertices[members]))
        moved[members] = move_onto(
            vertices[members], fit.surface, height, None if rays is None else rays[members]
        )
        is_relief[members] = region > 0
        flat[members[region == 0]] = label
        planes[label] = fit.surface, fit.rms

    # 2. Creases stay creases; what would turn over or cross stays where it was.
    is_held = np.zeros(len(vertices), np.bool_)
    if rays is None:
        moved = move_creases(vertices, moved, faces, flat, planes)
        moved, is_held = hold_back(vertices, moved, faces)
    n_turned, n_crossing = wrong_faces(vertices, moved, faces, rays)

    # 3. Tell how far all that lies from its plane, before and after.
    for place, surface in enumerate(surfaces):
        members, plane = np.flatnonzero(labels == surface.label), fits[surface.label - 1].surface
        before, after = plane.distance(vertices[members]), plane.distance(moved[members])
        surfaces[place] = surface.with_distances(before, after, is_relief[members])
    return FlattenedMesh(
        vertices=moved,
        moved_m=np.linalg.norm(moved - vertices, axis=1),
        is_relief=is_relief,
        is_held=is_held,
        surfaces=tuple(surfaces),
        n_turned=n_turned,
        n_crossing=n_crossing,
    )


def _heights_of(
    grid: HeightGrid, heights: FlatHeights, height: FloatArray
) -> tuple[FloatArray, NDArray[np.int32]]:
    """New heights (n,) of vertices that were at some over the plane, and their regions, 0 for the plane."""
    place = np.clip(np.rint(grid.places).astype(np.int64), 0, np.array(grid.heights.shape) - 1)
    region = heights.label[place[:, 0], place[:, 1]]
    clear = np.array([False, *(region.is_cleared for region in heights.regions)])[np.maximum(region, 0)]
    ripple = ndimage.map_coordinates(heights.ripple, grid.places.T, order=1, mode="nearest")
    return np.where(region == 0, 0.0, np.where(clear, height - ripple, height)), region


def _region(candidate: ReliefCandidate, kind: RegionKind, p: float, cell_m: float, clear: bool) -> FlatRegion:
    """A candidate as a region."""
    return FlatRegion(
        kind,
        p,
        candidate.evidence,
        candidate.height_m,
        candidate.sd_m,
        area_m2=candidate.n_cells * cell_m**2,
        is_cleared=clear,
    )


def _unchanged_heights(heights: FloatArray, reason: str) -> FlatHeights:
    """Nothing done."""
    label = np.where(np.isfinite(heights), 0, -1).astype(np.int32)
    return FlatHeights(
        heights,
        label,
        np.zeros_like(heights),
        regions=(),
        ripple_sd_m=0.0,
        noise_sd_m=0.0,
        plane_m=0.0,
        reason=reason,
    )
