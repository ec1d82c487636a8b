# SPDX-License-Identifier: MIT
"""Evidence: what all scans say about each place on a surface, observed free space being a veto."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label as connected_parts

from completion.evidence.reach import Reach, reach_of
from completion.evidence.sight import ScanSight, Views, sight_of
from completion.observe.observation import Observation
from completion.observe.tolerance import Tolerance
from scenes.checks import BoolArray, Value


class Label(IntEnum):
    """What the scans say of a place, weakest first; the strongest label of all scans counts."""

    OUT = 0  # in no scan's field of view
    NO_RETURN = 1  # looked at without an echo, or too obliquely to tell: evidence of nothing
    UNLIT = 2  # looked at without an echo, where something nearer hid it from the projector
    OCCLUDED = 3  # something nearer stood before it
    VISIBLE = 4  # measured there
    FREE = 5  # a beam went through: nothing can be there


@dataclass(frozen=True, slots=True, eq=False)
class Evidence(Value):
    """Labels of a chart grid's cells.

    Attributes
    ----------
    labels : (rows, columns) int8
        A `Label` for each cell.
    observed : (rows, columns) bool
        Cells where the surface was measured: by its own pixels or by pixels of no surface within tolerance.
    is_own : (rows, columns) bool
        Cells measured by its own pixels; only these are samples of its texture.
    pixel : (rows, columns) int64
        Flat pixel that sees each observed cell best, of key frames if one does, -1 elsewhere.
    scan : (rows, columns) int32
        The scan it belongs to, -1 elsewhere.
    occluder : (rows, columns) int32
        Number of the surface that stands before each occluded cell, by the last scan that says so, of key
        frames if one does; 0 for none known.
    through : (rows, columns) bool
        Cells that some beam seems to have passed: the pixel at their centre measured farther. That is too
        little for a veto, but the surface is not hidden there, nor did nothing come back.
    limb : (rows, columns) bool
        Cells so oblique to some scan that its beams may have met what lies behind as well. Free space there
        does not tell whether the surface goes on.
    """

    labels: NDArray[np.int8]
    observed: BoolArray
    is_own: BoolArray
    pixel: NDArray[np.int64]
    scan: NDArray[np.int32]
    occluder: NDArray[np.int32]
    through: BoolArray
    limb: BoolArray

    @property
    def open(self) -> BoolArray:
        """Cells (rows, columns) that beams passed, by a veto or seemingly, the limb apart."""
        return np.asarray(((self.labels == Label.FREE) | self.through) & ~self.limb, dtype=np.bool_)

    def rings_passed(self) -> BoolArray:
        """Tell at which rows (rows,) of a cylinder's chart beams say that it is not there, or has ended.

        A pipe or a column has one cross-section along its axis. Where beams passed more of a ring than was
        measured of it, the pipe is not there, and its hidden back is not either; nor are rings beyond, unless
        some part of it was measured again.
        """
        passed = np.count_nonzero(self.labels == Label.FREE, axis=1)
        measured = np.count_nonzero(self.is_own, axis=1)
        part, n_parts = connected_parts(passed <= measured)
        is_measured = np.bincount(part, measured, minlength=n_parts + 1) > 0
        is_measured[0] = False
        return np.asarray(~is_measured[part], dtype=np.bool_)


@dataclass(frozen=True, slots=True, eq=False)
class Scans(Value):
    """All scans, and what is needed to hold a surface against them."""

    observations: tuple[Observation, ...]  # the scans, working frame
    owners: tuple[NDArray[np.int32], ...]  # (rows, columns): surface of each pixel, from 1; 0 for none
    tolerance: Tolerance  # along the ray
    keys: tuple[int, ...] | None = None  # numbers of the key frames, ascending; None: all are
    sights: tuple[ScanSight, ...] = ()  # each scan as compiled loops read it; made where not given
    reach: tuple[Reach, ...] = ()  # of each scan; made where not given
    views: Views = field(init=False)  # of all scans

    def __post_init__(self) -> None:
        if not self.sights:
            sights = tuple(sight_of(seen, self.tolerance) for seen in self.observations)
            object.__setattr__(self, "sights", sights)
        if not self.reach:
            object.__setattr__(self, "reach", tuple(map(reach_of, self.observations)))
        eyes, farthest = (
            (sight.eye for sight in self.sights),
            (float(reach.far.max()) for reach in self.reach),
        )
        object.__setattr__(self, "views", Views.of(eyes, farthest))

    def with_owners(self, owners: Sequence[NDArray[np.int32]]) -> Scans:
        """Return the same scans with their pixels (rows, columns) numbered by other surfaces."""
        return replace(self, owners=tuple(owners))

    @property
    def order(self) -> tuple[tuple[int, bool], ...]:
        """All scans, and whether each is a key frame: these come first, the last one at the head."""
        keys = range(len(self.observations)) if self.keys is None else self.keys
        others = sorted(set(range(len(self.observations))) - set(keys), reverse=True)
        return (*((number, True) for number in reversed(keys)), *((number, False) for number in others))
