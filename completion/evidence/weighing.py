# SPDX-License-Identifier: MIT
"""Weighing of a surface's cells against all scans, which gives their evidence."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from completion.evidence.chart_grid import ChartGrid
from completion.evidence.evidence import Evidence, Label, Scans
from completion.evidence.form import Form, form_of, place_of
from completion.evidence.free_space import free_cells
from completion.evidence.limits import LEAST_COSINE, LIMB_PIXELS, NEAR_CELLS
from completion.evidence.reach import Reach, is_beyond, progress_of
from completion.evidence.sight import (
    RangeVerdict,
    ScanSight,
    along_ray,
    ball_around,
    look,
    pixel_of,
    window_of,
)
from completion.observe.rays import Triple, deviation_at, dot, minus, plus
from completion.observe.shadow import is_shadowed
from scenes.checks import BoolArray, FloatArray, read_only_view
from scenes.run.mapping import trim
from texture.engine.compiled import compiled, inlined

_BLOCK = 16  # cells: side of the blocks that are held against a scan together
_ROUNDING_M = 1e-9
_NO_RETURN, _UNLIT = int(Label.NO_RETURN), int(Label.UNLIT)
_OCCLUDED, _VISIBLE = int(Label.OCCLUDED), int(Label.VISIBLE)


def weigh(grid: ChartGrid, predicted_sd: FloatArray, scans: Scans, owner: int) -> Evidence:
    """Label the cells of a grid from all scans; a beam that went through a cell is a veto.

    Parameters
    ----------
    grid : ChartGrid
        The cells.
    predicted_sd : (rows * columns,) float
        Standard deviation of the surface along its normal at each cell, metres.
    scans : Scans
        All scans.
    owner : int
        This surface's number in `scans.owners`.
    """
    held, blocks, form = (
        _CellLabels.of(grid.centres(), predicted_sd),
        _CellBlocks.of(grid),
        form_of(grid.surface),
    )
    may_see = scans.views.may_see(ball_around(grid.bounds(), grid.cell)).tolist()
    for number, is_key in scans.order:  # of equal claims the first scan's counts
        if not may_see[number]:
            continue
        owners = scans.owners[number].ravel()
        _hold(scans.sights[number], form, scans.reach[number], blocks, owners, owner, number, is_key, held)
        trim()
    observed, is_member = held.observed.reshape(grid.shape), held.is_own.reshape(grid.shape)

    # Measured cells far from the surface's own pixels are of something else on its plane.
    near = cv2.dilate(is_member.view(np.uint8), np.ones((2 * NEAR_CELLS + 1,) * 2, np.uint8))
    observed &= near.astype(np.bool_)

    # Veto: nothing is where beams went through, but what was measured.
    vetoed = free_cells(grid, predicted_sd, scans.sights, scans.reach, scans.views)
    labels = held.labels.reshape(grid.shape)
    labels[vetoed.reshape(grid.shape) & ~observed] = Label.FREE
    return Evidence(
        labels=labels,
        observed=observed,
        is_own=is_member,
        pixel=held.pixel.reshape(grid.shape),
        scan=held.scan.reshape(grid.shape),
        occluder=np.where(labels == Label.OCCLUDED, np.maximum(held.occluder, 0).reshape(grid.shape), 0),
        through=held.through.reshape(grid.shape) & ~observed,
        limb=held.limb.reshape(grid.shape) & ~observed,
    )


class _CellLabels(NamedTuple):
    """Cells (n,) and what was found of them so far; see `Evidence`."""

    centres: FloatArray  # (n, 3) metres
    predicted_sd: FloatArray  # of the surface along its normal, metres
    labels: NDArray[np.int8]
    observed: BoolArray
    is_own: BoolArray
    pixel: NDArray[np.int64]
    scan: NDArray[np.int32]
    footprint: FloatArray  # of that pixel, times a constant
    occluder: NDArray[np.int32]  # -1 while no scan says that the cell is occluded
    through: BoolArray
    limb: BoolArray

    @classmethod
    def of(cls, centres: FloatArray, predicted_sd: FloatArray) -> _CellLabels:
        """Nothing, yet."""
        n = len(centres)
        observed, is_member, through, limb = np.zeros((4, n), dtype=np.bool_)
        return cls(
            centres=centres,
            predicted_sd=read_only_view(predicted_sd),
            labels=np.full(n, Label.OUT, np.int8),
            observed=observed,
            is_own=is_member,
            pixel=np.full(n, -1, np.int64),
            scan=np.full(n, -1, np.int32),
            footprint=np.full(n, np.inf),
            occluder=np.full(n, -1, np.int32),
            through=through,
            limb=limb,
        )


class _CellBlocks(NamedTuple):
    """Blocks of 16 x 16 cells, which are held against a scan together."""

    shape: tuple[int, int]  # rows and columns of cells
    corner: tuple[float, float]  # of cell (0, 0) in the chart, metres
    size: tuple[float, float]  # of a cell, metres
    is_hidden: BoolArray  # (rows, columns) all cells are measured or occluded, by something known
    sd: FloatArray  # (rows, columns) largest predicted deviation of the surface in those that are, metres

    @classmethod
    def of(cls, grid: ChartGrid) -> _CellBlocks:
        """Nothing is hidden, yet."""
        (u, v), (wide, tall) = grid.corner.tolist(), grid.cell.tolist()
        shape = -(-grid.shape[0] // _BLOCK), -(-grid.shape[1] // _BLOCK)
        return cls(grid.shape, (u, v), (wide, tall), np.zeros(shape, dtype=np.bool_), np.zeros(shape))


@compiled
def _hold(
    sight: ScanSight,
    form: Form,
    reach: Reach,
    blocks: _CellBlocks,
    owners: NDArray[np.int32],
    owner: int,
    number: int,
    is_key: bool,
    held: _CellLabels,
) -> None:
    """Hold the cells of a grid against one scan, block by block; `owners` are its (pixels,).

    Left out are blocks that the scan does not look at, and of a plane those that are hidden already and that
    the scan did not get to: they have nothing to learn from it. So have cells that key frames measured from
    any other frame.
    """
    eye, (rows, columns) = sight.eye, blocks.shape
    height = dot(minus(eye.origin, form.point), form.axis)
    progress = progress_of(reach, plus((0.0, 0.0, 0.0), -np.sign(height), form.axis))
    for i in range(blocks.sd.shape[0]):
        for j in range(blocks.sd.shape[1]):
            top, left = i * _BLOCK, j * _BLOCK
            bottom, right = min(top + _BLOCK, rows), min(left + _BLOCK, columns)
            wide, tall = (right - left) * blocks.size[0] / 2, (bottom - top) * blocks.size[1] / 2
            u, v = (
                blocks.corner[0] + left * blocks.size[0] + wide,
                blocks.corner[1] + top * blocks.size[1] + tall,
            )
            middle, radius = place_of(form, u, v), np.sqrt(wide * wide + tall * tall) + _ROUNDING_M
            window = window_of(eye, sight.angles, middle, radius)
            if window[1] < 0 or window[3] < 0:
                continue
            if blocks.is_hidden[i, j] and not form.is_curved:
                away = minus(middle, eye.origin)
                distance = np.sqrt(dot(away, away))
                if is_beyond(sight, reach, progress, window, distance, radius, height, blocks.sd[i, j]):
                    continue
            for row in range(top, bottom):
                cells = row * columns + left, row * columns + right
                _hold_cells(sight, form, cells, owners, owner, number, is_key, held)
            if not blocks.is_hidden[i, j]:
                _note_hidden(blocks, i, j, held)


@inlined
def _note_hidden(blocks: _CellBlocks, i: int, j: int, held: _CellLabels) -> None:
    """Note whether all cells of a block are hidden or more."""
    rows, columns = blocks.shape
    sd = 0.0
    for row in range(i * _BLOCK, min((i + 1) * _BLOCK, rows)):
        for cell in range(row * columns + j * _BLOCK, row * columns + min((j + 1) * _BLOCK, columns)):
            label = held.labels[cell]
            if label < _OCCLUDED or (label == _OCCLUDED and held.occluder[cell] < 0):
                return
            sd = max(sd, held.predicted_sd[cell])
    blocks.is_hidden[i, j], blocks.sd[i, j] = True, sd


@inlined
def _hold_cells(
    sight: ScanSight,
    form: Form,
    cells: tuple[int, int],
    owners: NDArray[np.int32],
    owner: int,
    number: int,
    is_key: bool,
    held: _CellLabels,
) -> None:
    """Hold the centres of cells, from a first one up to an end, against the pixels that see them."""
    centres, predicted_sd, labels, observed = held.centres, held.predicted_sd, held.labels, held.observed
    is_member, pixels, scans, footprints = held.is_own, held.pixel, held.scan, held.footprint
    occluder, through, at_limb = held.occluder, held.through, held.limb
    eye, ranges = sight.eye, sight.ranges
    for cell in range(cells[0], cells[1]):
        if is_member[cell] and not is_key:
            continue
        place = centres[cell, 0], centres[cell, 1], centres[cell, 2]
        pixel = pixel_of(eye, sight.angles, place)
        if pixel < 0:
            continue
        measured = ranges[pixel]
        sentence = look(eye, form, place, predicted_sd[cell], (measured, deviation_at(sight.noise, measured)))
        is_sure = sentence.allowed <= eye.max_m
        label = _NO_RETURN  # free space is claimed by the beams themselves: a cell's centre is not its beam
        if sentence.behind > sentence.allowed:
            # 1. Something stands before the cell.
            label = _OCCLUDED
            if occluder[cell] < 0:
                occluder[cell] = owners[pixel]
        elif sentence.behind >= -sentence.allowed:
            # 2. It is measured by the surface's own pixels, or surely by pixels of no surface. Of several
            #    keep the one with the smallest footprint.
            is_own = owners[pixel] == owner
            is_measured = is_own or (owners[pixel] == 0 and is_sure)
            label = _VISIBLE if is_measured or is_sure else _NO_RETURN
            is_member[cell] |= is_own
            observed[cell] |= is_measured
            footprint = sentence.distance * sentence.distance / max(sentence.cosine, LEAST_COSINE)
            if is_measured and footprint <= footprints[cell]:
                footprints[cell], pixels[cell], scans[cell] = footprint, pixel, number

        elif measured == np.inf and _is_unlit(sight, pixel, place, sentence, predicted_sd[cell]):
            # 3. Nothing came back, since something hid the cell from the projector.
            label = _UNLIT

        # 4. Note cells beside which a beam got farther, and those too oblique to tell.
        limb = sentence.distance * eye.pixel_angle / form.radius if form.is_curved else 0.0
        if np.isfinite(measured) and sentence.behind < -sentence.allowed and is_sure:
            through[cell] = True
        at_limb[cell] |= sentence.cosine < np.sqrt(min(2 * LIMB_PIXELS * limb, 1.0))

        # 5. Keep the strongest label of all scans.
        labels[cell] = max(labels[cell], label)


@inlined
def _is_unlit(
    sight: ScanSight, pixel: int, place: Triple, sentence: RangeVerdict, predicted_sd: float
) -> bool:
    """Tell whether a place that a pixel without return sees was hidden from the projector."""
    eye = sight.eye
    if eye.is_spherical or not max(sight.devices.shadow) > 0.0:
        return False
    depth = dot(eye.turn[2], place) + eye.shift[2]
    allowed = along_ray(eye, deviation_at(sight.noise, sentence.distance), predicted_sd, sentence.cosine)
    return bool(is_shadowed(sight.devices, sight.ranges, pixel, depth, allowed))
