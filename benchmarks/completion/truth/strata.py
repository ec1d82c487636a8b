# SPDX-License-Identifier: MIT
"""Strata: the kinds of occlusion that hidden area is told apart by, never pooled into one number."""

from __future__ import annotations

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from benchmarks.completion.truth.cells import TrueCells, grown, pieces
from benchmarks.completion.truth.sight import Sight
from scenes.surfaces.catalogue import Cylinder

_MIN_PART_M2 = 0.0025  # smaller visible parts do not make a surface broken


class Stratum(IntEnum):
    """Why a part of a surface is hidden, after Dell'Acqua & Fisher 2002; 0 for area of no such part."""

    NONE = 0  # inferred on a surface of which nothing is hidden, or on no true surface
    INTERIOR = 1  # S1, surface-preserving: an occluder hides part of it, the rest stays one region
    BREAKING = 2  # S2, surface-breaking: the visible rest falls apart
    BOUNDARY = 3  # S3, boundary-breaking: part of the surface's own boundary is hidden too
    SELF = 4  # S4: the side of a cylinder that shows its back to all scans
    OPENING = 6  # S6: an opening's outline is partly hidden


def strata_of(cells: TrueCells) -> NDArray[np.int8]:
    """Return the stratum of every reachable hidden cell, -1 for all other cells.

    The back of a cylinder is S4. What one object hides of the rest of a surface, in one piece, is of one
    stratum: S6 where the piece borders on a hidden part of an opening; S2 where it borders on two visible
    parts; S3 where it borders on where the surface ends; else S1.
    """
    result = np.full(cells.chart.grid.shape, -1, np.int8)
    visible = _large_parts(cells)
    hidden_opening = cells.chart.in_opening & (cells.sight == Sight.HIDDEN)
    wraps = cells.chart.grid.wraps
    open_ = cells.reachable
    if isinstance(cells.chart.grid.surface, Cylinder):
        result[open_ & cells.faces_away] = Stratum.SELF
        open_ = open_ & ~cells.faces_away
    for occluder in np.unique(cells.occluder[open_]):
        shadows = pieces(open_ & (cells.occluder == occluder), wraps)
        for number in np.unique(shadows[shadows > 0]):
            shadow = shadows == number
            rim = grown(shadow, wraps) & ~shadow
            if (rim & hidden_opening).any():
                stratum = Stratum.OPENING
            elif len(np.unique(visible[rim & (visible > 0)])) > 1:
                stratum = Stratum.BREAKING
            elif (rim & ~cells.chart.present).any():
                stratum = Stratum.BOUNDARY
            else:
                stratum = Stratum.INTERIOR
            result[shadow] = stratum
    return result


def _large_parts(cells: TrueCells) -> NDArray[np.int32]:
    """Number of the visible part that each cell belongs to, 0 for small parts and cells of none."""
    part = pieces(cells.visible, cells.chart.grid.wraps)
    large = np.bincount(part.ravel()) * cells.chart.grid.cell_area >= _MIN_PART_M2
    large[0] = False
    return np.where(large[part], part, 0)
