# SPDX-License-Identifier: MIT
"""Doorways: a storey's plan, above its furniture and below its lintels, parted where it is narrow or low."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from skimage.segmentation import watershed

from nbv.visibility.standing.columns import Columns
from scenes.checks import BoolArray, FloatArray
from scenes.rays.raycast import RayCaster

_EYE_M = 1.9  # above the floor: over furniture, under the heads of doors
_FURNITURE_M = 1.5  # from the nearest floor: farther cells are not over furniture
_MOST_HEADROOM_M = 6.0
_LINTEL_M = 0.12  # by which the head of a doorway lies lower than the ceilings beside it
_WALL_M = 0.7  # the thickest wall with a doorway
_DOOR_M = 2.6  # the highest head of a doorway
_WIDE_DOOR_M, _GATE_M = 2.0, 2.2  # from this width on the head is no higher than that
_NARROW_M = 0.5  # half the width of a doorway without lintel
_WIDER = 2.0  # rooms on both its sides are so much wider


def part_at_doorways(columns: Columns, floor: BoolArray, caster: RayCaster) -> NDArray[np.int64]:
    """Number (k,) the parts of a storey's floor spans (n,) between doorways, from 1; 0 for doorways.

    What counts is the plan 1.9 m above the floor. A doorway is where the headroom is lower than on both
    sides over no more than a wall's thickness, or the plan half as wide as on both sides. Where floor was
    not seen nothing is taken to stand but what is seen to.
    """
    plan = _Plan(columns, floor)
    air = plan.air(caster)
    headroom = plan.under_sheets(air, caster)
    doors = _under_lintels(np.where(air, headroom, 0.0), air, columns.cell_m)
    parts = _parted_where_narrow(air & ~doors, columns.cell_m)
    return np.asarray(parts.ravel()[columns.cell[floor]], dtype=np.int64)


class _Plan:
    """A storey's plan: heights (x, y) of its floor, and the headroom above, metres."""

    def __init__(self, columns: Columns, floor: BoolArray) -> None:
        self.columns = columns
        known = np.full(columns.shape, np.nan)
        known.ravel()[columns.cell[floor]] = columns.bottom[floor]
        away, nearest = ndimage.distance_transform_edt(
            np.isnan(known), sampling=columns.cell_m, return_indices=True
        )
        height = known[tuple(nearest)]
        self.height: FloatArray = np.where(away <= _FURNITURE_M, height, np.nan)
        eye = (self.height.ravel() + _EYE_M)[columns.cell]
        holds = (columns.bottom < eye) & (columns.top > eye + 0.05)
        headroom = np.zeros(columns.shape)
        room = np.minimum(columns.top, eye + _MOST_HEADROOM_M) - (eye - _EYE_M)
        headroom.ravel()[columns.cell[holds]] = np.minimum(room[holds], _MOST_HEADROOM_M)
        if columns.is_partial:
            unseen = np.diff(columns.start) == 0
            unseen[columns.cell[holds & np.isinf(columns.top)]] = True
            headroom = self._over_unseen(headroom, unseen.reshape(columns.shape))
        self.headroom: FloatArray = headroom

    def _over_unseen(self, headroom: FloatArray, unseen: BoolArray) -> FloatArray:
        """Return the headroom, where floor or ceiling was not seen that of the nearest cell with both."""
        known = (headroom > 0) & ~unseen
        if not known.any():
            return headroom
        nearest = ndimage.distance_transform_edt(~known, return_distances=False, return_indices=True)
        return np.where(unseen & ~np.isnan(self.height), headroom[tuple(nearest)], headroom)

    def air(self, caster: RayCaster) -> BoolArray:
        """Tell which cells (x, y) are open at eye height, and have no wall to a cell beside."""
        air = self.headroom > 0
        return air & ~self._stopped(air, np.full(air.shape, _EYE_M), caster)

    def under_sheets(self, air: BoolArray, caster: RayCaster) -> FloatArray:
        """Return the headroom (x, y), lower under a head of a doorway that is thinner than a cell.

        It hangs at least as low as the highest of doors, or as the ceiling less what makes a lintel.
        """
        headroom = self.headroom
        for head in (_DOOR_M, _GATE_M):
            level = np.minimum(self.headroom - _LINTEL_M / 2, head)
            under = self._stopped(air & (level > _EYE_M), level, caster)
            headroom = np.where(
                under, np.minimum(headroom, np.minimum(self.headroom - _LINTEL_M, head)), headroom
            )
        return headroom

    def _stopped(self, among: BoolArray, above: FloatArray, caster: RayCaster) -> BoolArray:
        """Tell the cells (x, y) with surface between them and one beside, so high above the floor, metres."""
        columns, number = self.columns, np.arange(among.size).reshape(among.shape)
        walled = np.zeros(among.size, np.bool_)
        for one, other in ((number[:-1], number[1:]), (number[:, :-1], number[:, 1:])):
            pair = (among.ravel()[one] & among.ravel()[other]).ravel()
            first, second = one.ravel()[pair], other.ravel()[pair]
            level = np.minimum(*((self.height + above).ravel()[side] for side in (first, second)))
            ends = [np.column_stack([columns.places(side), level]) for side in (first, second)]
            stopped = caster.blocked(ends[0], ends[1])
            walled[first[stopped]] = True
            walled[second[stopped]] = True
        return walled.reshape(among.shape)


def _under_lintels(headroom: FloatArray, air: BoolArray, cell_m: float) -> BoolArray:
    """Tell the cells (x, y) under the heads of doorways."""
    found = np.zeros(air.shape, np.bool_)
    reach = int(np.ceil(_WALL_M / cell_m)) + 1
    for axis in range(2):
        before, after = (
            ndimage.maximum_filter1d(headroom, reach + 1, axis=axis, origin=shift, mode="constant")
            for shift in (reach // 2, -(reach // 2))
        )
        lower = np.minimum(before, after) - headroom >= _LINTEL_M
        found |= air & lower & (headroom <= _DOOR_M)
    label, _ = ndimage.label(found, np.ones((3, 3)))
    for number, box in enumerate(ndimage.find_objects(label), start=1):
        sides = sorted((side.stop - side.start) * cell_m for side in box)
        inside = label[box] == number
        head = float(np.median(headroom[box][inside]))
        if sides[0] > _WALL_M + 2 * cell_m or (sides[1] > _WIDE_DOOR_M and head > _GATE_M):
            found[box][inside] = False
    return found


def _parted_where_narrow(air: BoolArray, cell_m: float) -> NDArray[np.int64]:
    """Number the parts (x, y) of a plan, cut at narrow places between wide ones."""
    clear = np.asarray(ndimage.distance_transform_edt(np.pad(air, 1)))[1:-1, 1:-1] * cell_m
    basin = watershed(-clear, mask=air)
    return _merged(basin, clear)


def _merged(basin: NDArray[np.int64], clear: FloatArray) -> NDArray[np.int64]:
    """Join basins that no doorway parts, from the widest pass down."""
    n = int(basin.max(initial=0)) + 1
    peak = np.zeros(n)
    np.maximum.at(peak, basin.ravel(), clear.ravel())
    passes: dict[tuple[int, int], float] = {}
    for one, other in ((np.s_[:-1], np.s_[1:]), (np.s_[:, :-1], np.s_[:, 1:])):
        first, second = basin[one].ravel(), basin[other].ravel()
        width = np.minimum(clear[one], clear[other]).ravel()
        meets = (first != second) & (first > 0) & (second > 0)
        for a, b, w in zip(first[meets].tolist(), second[meets].tolist(), width[meets].tolist(), strict=True):
            key = (min(a, b), max(a, b))
            passes[key] = max(passes.get(key, 0.0), w)
    parent = list(range(n))

    def root(k: int) -> int:
        while parent[k] != k:
            parent[k] = parent[parent[k]]
            k = parent[k]
        return k

    for (a, b), least in sorted(passes.items(), key=lambda item: (-item[1], item[0])):
        one_root, other_root = sorted((root(a), root(b)))
        narrow = least <= _NARROW_M and min(peak[one_root], peak[other_root]) >= _WIDER * least
        if one_root != other_root and not narrow:
            parent[other_root] = one_root
            peak[one_root] = max(peak[one_root], peak[other_root])
    roots = np.array([root(k) for k in range(n)])
    return np.asarray(np.unique(roots, return_inverse=True)[1].reshape(-1)[basin], dtype=np.int64)
