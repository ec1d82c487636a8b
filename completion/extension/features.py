# SPDX-License-Identifier: MIT
"""Features in what is inferred of a surface: exact sides of fitted openings, and the faces of features."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from completion.boundary.hidden_regions import divide_hidden, label_regions
from completion.edits.edit import FittedOpening, KnownFace, SurfaceEdits, outline_uv
from completion.evidence.chart_grid import ChartGrid
from completion.evidence.evidence import Label, Scans
from completion.evidence.weighing import weigh
from completion.extension.extent import ExtensionRules, Extent
from completion.extension.limits import FEWEST_CELLS, LEAST_CONFIDENCE, PAST_SIDE
from completion.extension.patch import Patch, Provenance, in_hull
from completion.observe.observation import Observation
from scenes.checks import BoolArray, FloatArray
from scenes.run.mapping import trim

_RIGHT, _SIDEWAYS = 1, (1, 3)
_INWARDS = np.array([[0.0, 1.0], [-1.0, 0.0], [0.0, -1.0], [1.0, 0.0]])  # of bottom, right, top, left


def lay_openings(
    grid: ChartGrid,
    hidden: BoolArray,
    filled: BoolArray,
    confidence: FloatArray,
    *,
    open_: BoolArray,
    edits: SurfaceEdits,
    least: float,
) -> tuple[BoolArray, FloatArray, SurfaceEdits]:
    """Lay the fitted openings of a surface into what was inferred of it.

    A side that was seen holds behind the occluder too: up to it all is open, past it the surface goes on. One
    that nobody saw goes as far as the hole does without it, but an opening seen over a length s goes on for e
    more with probability s / (s + e) only (Gott 1993), save down to the floor.

    Parameters
    ----------
    grid : ChartGrid
        The cells.
    hidden, filled, open_ : (rows, columns) bool
        Cells where the surface may be, unseen; those of them where it is inferred; those that beams passed.
    confidence : (rows, columns) float
        Probability of surface.
    edits : SurfaceEdits
        With the openings.
    least : float
        Probability from which on a cell is filled.

    Returns
    -------
    filled, confidence, edits
        As given, with the openings in place; their outlines as they are laid.
    """
    if not edits.fitted:
        return filled, confidence, edits
    filled, confidence, laid = filled.copy(), confidence.copy(), []
    hole = (hidden & ~filled) | open_
    for opening in edits.fitted:
        at, size = _local(grid, opening)
        part = _touching_parts(hole, _within(at, np.zeros(2), size))
        low, high = _extended_corners(opening, at, size, part, step=float(grid.cell.max()))
        inside, past = _within(at, low, high), _past_seen(opening, at, low, high, step=float(grid.cell.max()))
        surface = np.where(
            part & hidden & past,
            PAST_SIDE,
            _end_probability(opening, at, size, (low[1], high[1])) * (hidden & ~filled),
        )
        beside = (surface >= least) & (surface > confidence)
        filled[beside], confidence[beside] = True, surface[beside]
        filled[inside & hidden] = False
        confidence[inside & hidden] = np.minimum(confidence[inside & hidden], 1 - PAST_SIDE)
        laid.append(_with_sides(opening, low, high, size))
    return filled, confidence, replace(edits, fitted=tuple(laid))


def _local(grid: ChartGrid, opening: FittedOpening) -> tuple[FloatArray, FloatArray]:
    """Places of all cells (rows, columns, 2) from the first corner, along the sides, and the size (2,)."""
    corners = outline_uv(grid.surface, opening.outline)
    sides = np.stack([corners[1] - corners[0], corners[3] - corners[0]])
    size = np.linalg.norm(sides, axis=1)
    return (grid.centres_uv() - corners[0]) @ (sides / size[:, None]).T, size


def _within(at: FloatArray, low: FloatArray, high: FloatArray) -> BoolArray:
    return np.asarray(((at > low) & (at < high)).all(axis=-1))


def _touching_parts(cells: BoolArray, others: BoolArray) -> BoolArray:
    """The parts of some cells (rows, columns) that reach into others."""
    part, _ = ndimage.label(cells)
    numbers = np.unique(part[others & cells])
    return np.asarray(np.isin(part, numbers[numbers > 0]))


def _extended_corners(
    opening: FittedOpening, at: FloatArray, size: FloatArray, hole: BoolArray, *, step: float
) -> tuple[FloatArray, FloatArray]:
    """Corners (2,), (2,) of the opening with unseen sides where the hole ends that it lies in.

    For every cell along such a side, how far the hole goes on; the median of them, as far as it may be.
    """
    low, high = np.zeros(2), size.copy()
    for side in range(4):
        inwards, outwards = opening.slack[side]
        if opening.seen[side] > 0 or inwards + outwards == 0:
            continue
        axis, sign = int(np.argmax(np.abs(_INWARDS[side]))), -_INWARDS[side].sum()
        edge = (high if sign > 0 else low)[axis]
        out, along = sign * (at[..., axis] - edge), at[..., 1 - axis]
        beside = (along > 0) & (along < size[1 - axis]) & (out > 0)
        column = np.floor(along / step).astype(np.int64)
        ends = np.full(int(np.ceil(size[1 - axis] / step)) + 1, np.inf)
        np.minimum.at(ends, column[beside & ~hole], out[beside & ~hole])
        known = ends[np.isfinite(ends)]
        reach = min(float(np.median(known)) - step / 2, outwards) if len(known) else 0.0
        reach = min(reach, size[axis]) if side in _SIDEWAYS else reach
        (high if sign > 0 else low)[axis] += sign * max(reach, 0.0)
    return low, high


def _end_probability(
    opening: FittedOpening, at: FloatArray, size: FloatArray, band: tuple[float, float]
) -> FloatArray:
    """Probability (rows, columns) that the opening has ended past a side that nobody saw; 0 elsewhere.

    Elsewhere are also places below and above the `band` of it.
    """
    out = np.zeros(at.shape[:2])
    for side in _SIDEWAYS:
        if opening.seen[side] > 0:
            continue
        beyond = at[..., 0] - size[0] if side == _RIGHT else -at[..., 0]
        past = (beyond > 0) & (at[..., 1] > band[0]) & (at[..., 1] < band[1])
        out[past] = beyond[past] / (size[0] + beyond[past])
    return out


def _past_seen(
    opening: FittedOpening, at: FloatArray, low: FloatArray, high: FloatArray, *, step: float
) -> BoolArray:
    """Cells (rows, columns) past sides that were seen, or are known to two cells, and past no other."""
    beyond = [at[..., 1] < low[1], at[..., 0] > high[0], at[..., 1] > high[1], at[..., 0] < low[0]]
    known = (opening.seen > 0) | (opening.slack.sum(axis=1) < 2 * step)
    seen = [cells for cells, is_known in zip(beyond, known, strict=True) if is_known]
    unseen = [cells for cells, is_known in zip(beyond, known, strict=True) if not is_known]
    none = np.zeros(at.shape[:2], dtype=np.bool_)
    return np.asarray(np.any([none, *seen], axis=0) & ~np.any([none, *unseen], axis=0))


def _with_sides(opening: FittedOpening, low: FloatArray, high: FloatArray, size: FloatArray) -> FittedOpening:
    """The opening with its sides at these places, and what may still be off of those that nobody saw."""
    first = opening.outline[0]
    along = (opening.outline[1] - first) / size[0], (opening.outline[3] - first) / size[1]
    places: Sequence[tuple[float, float]] = (
        (low[0], low[1]),
        (high[0], low[1]),
        (high[0], high[1]),
        (low[0], high[1]),
    )
    outline = np.stack([first + a * along[0] + b * along[1] for a, b in places])
    shifts = np.array([-low[1], high[0] - size[0], high[1] - size[1], -low[0]])
    slack = np.stack([opening.slack[:, 0] + shifts, np.maximum(opening.slack[:, 1] - shifts, 0.0)], axis=1)
    return replace(opening, outline=outline, slack=slack)


Owners = NDArray[np.int32]


def with_faces(
    scans: Scans, faces: Sequence[KnownFace], n_surfaces: int, keep: Callable[[Owners], Owners]
) -> Scans:
    """Return the scans with the pixels of faces numbered on from those of `n_surfaces` surfaces.

    `keep` puts the numbers (rows, columns) of a scan where arrays of its size are kept.
    """
    owners = list(scans.owners)
    for scan, before in enumerate(scans.owners):
        measured = [
            (number, face.surface.pixels[scan].flat)
            for number, face in enumerate(faces, start=n_surfaces + 1)
            if len(face.surface.pixels[scan])
        ]
        if not measured:
            continue
        owner = before.copy()
        for number, flat in measured:
            owner.ravel()[flat] = number
        owners[scan] = keep(owner)
        trim()
    return scans.with_owners(owners)


def extend_face(face: KnownFace, scans: Scans, number: int, rules: ExtensionRules) -> Patch:
    """Infer a face of a feature where it is hidden, within its outline.

    Its place and its outline come from the feature. A cell is filled where some scan says OCCLUDED and none
    says FREE, and nowhere else: where nothing came back, and where nobody looked, it stays unknown.

    Parameters
    ----------
    face : KnownFace
        The face, working frame.
    scans : Scans
        All scans, their pixels numbered with those of the face.
    number : int
        Its number in `scans.owners`, from 1.
    rules : ExtensionRules
        How sure the result must be, and how fine.
    """
    surface, fit = face.surface, face.surface.fit
    low, high = -face.size / 2, face.size / 2
    cell = _footprint(face, scans.observations) if rules.cell_m is None else rules.cell_m
    grid = _grid(face, max(cell, float(np.sqrt(np.prod(face.size) / rules.max_cells))))
    spread = fit.standard_deviation(grid.centres())
    evidence = weigh(grid, spread, scans, number)
    hidden = (evidence.labels == Label.OCCLUDED) & ~evidence.open & ~evidence.observed
    hidden &= (spread.reshape(grid.shape) <= rules.wishes.max_sd_m) & (
        LEAST_CONFIDENCE[rules.wishes.mode] <= PAST_SIDE
    )
    if rules.wishes.mode == "conservative":
        hidden = in_hull(evidence.observed, hidden)
    regions = divide_hidden(grid, hidden, evidence.observed, evidence.open, ())
    provenance = np.where(hidden, np.int8(Provenance.FEATURE), np.int8(-1))
    provenance[evidence.observed] = Provenance.MEASURED
    return Patch(
        source=surface,
        stated=fit,
        limits=Extent(
            chart=fit.surface,
            enclosures=(),
            cuts=(),
            neighbours=(),
            own_low=low,
            own_high=high,
            ends=np.stack([low, high]),
            end_probability=np.ones((2, 2)),
            ended=np.ones((2, 2), dtype=np.bool_),
            full_turn=False,
            encloses=False,
        ),
        grid=grid,
        evidence=evidence,
        hypothesised=hidden,
        provenance=provenance,
        confidence=np.where(evidence.observed, 1.0, PAST_SIDE * hidden),
        spread=spread.reshape(grid.shape),
        is_within=np.ones(grid.shape, dtype=np.bool_),
        edges=(),
        stretches=(),
        shadows=regions,
        labelling=label_regions(regions),
        trims=(),
        verdict=SurfaceEdits(),
        feature=face.feature,
    )


def _footprint(face: KnownFace, observations: Sequence[Observation]) -> float:
    """How wide the pixels of the nearest scan are on a face that they look at, metres."""
    plane = face.surface.fit.surface
    middle: FloatArray = plane.from_uv(np.zeros((1, 2)))[0]
    return min(
        float(np.linalg.norm(middle - seen.scan.origin)) * seen.scan.projection.pixel_angle
        for seen in observations
    )


def _grid(face: KnownFace, cell_m: float) -> ChartGrid:
    """Cells of about one size that fill the outline exactly."""
    count = np.maximum(np.ceil(face.size / cell_m - 1e-6).astype(np.int64), FEWEST_CELLS)
    chart = face.surface.fit.surface
    return ChartGrid(chart, -face.size / 2, face.size / count, (int(count[1]), int(count[0])), wraps=False)
