# SPDX-License-Identifier: MIT
"""Coplanar pieces: floors, ceilings and walls of which only pieces were seen, joined where errors allow it.

Merging joins what a hidden strip parts. A floor behind chairs comes in pieces that no strip joins; but pieces
that lie in one plane, as well as both are known, and that are the lowest level or stand upright, are of one
floor or wall far more often than of two that happen to lie so. What is between them is not decided by this.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import ndimage

from completion.merging.merged_surface import MergedSurface, largest_shares, number_pixels
from completion.observe.observation import Observation, PixelSet, ScanPixels
from completion.observe.refitting import refit_each
from completion.room import limits
from completion.room.planes import Beams, RoomPlane, level_roles
from scenes.checks import BoolArray, FloatArray, IntArray
from scenes.inclination import Up

LEVEL_UP, LEVEL_DOWN, UPRIGHT, OTHER = 1, -1, 2, 0


def join_coplanar(
    surfaces: Sequence[MergedSurface],
    looked_at: Sequence[RoomPlane | None],
    observations: Sequence[Observation],
    flatness_m: float,
    up: Up,
) -> list[MergedSurface]:
    """Return surfaces, largest first, of which pieces of one floor, ceiling or wall are one.

    Level pieces join where theirs is the lowest level that faces up, or the highest that faces down: tables
    of one height stay apart. A group is fitted anew to all its points; pieces that are no part of it by this
    fit leave it. Points of no surface that lie on a floor or wall are then taken up.

    Parameters
    ----------
    surfaces : sequence of MergedSurface
        Working frame.
    looked_at : sequence of RoomPlane or None
        Each of them as a plane, None where it is none.
    observations : sequence of Observation
        The scans.
    flatness_m : float
        By how much real surfaces stray from planes, metres.
    up : Up
        Which way is up in the working frame.
    """
    planes = [plane for plane in looked_at if plane is not None]
    kinds = [_kind(plane, up) for plane in planes]
    outermost = _outermost_levels(planes, kinds, observations, up)
    joined = [surface for surface, plane in zip(surfaces, looked_at, strict=True) if plane is None]
    for group in _coplanar_groups(planes, kinds, up):
        pieces = [planes[k] for k in group]
        if len(group) > 1 and (kinds[group[0]] == UPRIGHT or outermost & set(group)):
            joined += _fit_group(pieces, observations, flatness_m)
        else:
            joined += [piece.surface for piece in pieces]
    joined.sort(key=lambda surface: -surface.n_pixels)
    return _absorb(joined, observations, flatness_m, up)


def _kind(plane: RoomPlane, up: Up) -> int:
    """Whether a plane is level and faces up or down, upright, or neither."""
    inclination = plane.surface.fit.inclination(up.direction, up.sd_deg)
    if inclination.is_level:
        return LEVEL_UP if float(plane.normal @ up.direction) > 0 else LEVEL_DOWN
    return UPRIGHT if inclination.is_upright else OTHER


def _coplanar_groups(planes: Sequence[RoomPlane], kinds: Sequence[int], up: Up) -> list[list[int]]:
    """Planes by number, those in groups that may be one, largest first in each."""
    groups: list[list[int]] = []
    for k in sorted(range(len(planes)), key=lambda number: -planes[number].area_m2):
        candidates = [group for group in groups if kinds[group[0]] == kinds[k] != OTHER]
        heads = [planes[group[0]] for group in candidates]
        scores = _deviations_apart(planes[k], heads, kinds[k], up) if heads else np.zeros(0)
        best = int(np.argmin(scores)) if len(scores) else -1
        if best >= 0 and scores[best] < limits.COPLANAR_SD:
            candidates[best].append(k)
        else:
            groups.append([k])
    return groups


def _deviations_apart(piece: RoomPlane, larger: Sequence[RoomPlane], kind: int, up: Up) -> FloatArray:
    """By how many deviations (n,) a piece is off the planes of n larger ones of its kind; inf where untold.

    The lever from one to the other makes the tilt of the larger one count, or that of up.
    """
    normals = np.array([other.normal for other in larger])
    tilts = np.array([other.tilt_sd for other in larger])
    between = piece.middle - np.array([other.middle for other in larger])
    axes, is_turned = np.broadcast_to(up.direction, normals.shape), np.zeros(len(larger), dtype=np.bool_)
    lean = np.radians(limits.LEAN_DEG)
    if kind == UPRIGHT:
        axes = _level_part(normals, up.direction)
        cosine = axes @ _level_part(piece.normal[None], up.direction)[0]
        most = np.minimum(lean + 3 * np.hypot(piece.tilt_sd, tilts), np.radians(limits.WIDEST_TURN_DEG))
        is_turned = cosine < np.cos(most)
        tilts = np.hypot(tilts, lean / 2)
    else:
        tilts = np.minimum(np.radians(up.sd_deg), tilts + lean / 2)
    off = np.einsum("ij,ij->i", between, axes)
    lever = np.linalg.norm(between - off[:, None] * axes, axis=1)
    places = np.array([other.sd_m for other in larger])
    sd = np.sqrt(piece.sd_m**2 + places**2 + (lever * tilts) ** 2 + (lever * limits.BOW) ** 2)
    log_odds = np.log(limits.OTHERS_WITHIN_M / (np.sqrt(2 * np.pi) * sd)) - (off / sd) ** 2 / 2
    is_told = (sd <= limits.COPLANAR_M) & (log_odds >= np.log(limits.COPLANAR_ODDS)) & ~is_turned
    return np.where(is_told, np.abs(off) / sd, np.inf)


def _level_part(normals: FloatArray, up: FloatArray) -> FloatArray:
    """The level directions (n, 3) of normals (n, 3)."""
    level = normals - (normals @ up)[:, None] * up
    return np.asarray(level / np.maximum(np.linalg.norm(level, axis=1, keepdims=True), 1e-9))


def _outermost_levels(
    planes: Sequence[RoomPlane], kinds: Sequence[int], observations: Sequence[Observation], up: Up
) -> set[int]:
    """Numbers of the level planes that are floors and ceilings."""
    beams = Beams.of(observations)
    eye = float(np.mean([seen.scan.origin for seen in observations], axis=0) @ up.direction)
    level = [number for number, kind in enumerate(kinds) if kind in (LEVEL_UP, LEVEL_DOWN)]
    roles = level_roles([planes[number] for number in level], beams, up.direction, eye)
    return {number for number, role in zip(level, roles, strict=True) if role in {"floor", "ceiling"}}


def _fit_group(
    pieces: Sequence[RoomPlane], observations: Sequence[Observation], flatness_m: float
) -> list[MergedSurface]:
    """Pieces as one surface, less those that are no part of it by the fit to all of them."""
    pieces, apart = list(pieces), list[MergedSurface]()
    while len(pieces) > 1:
        pixels = _union([piece.surface.pixels for piece in pieces])
        (fit,) = refit_each([pieces[0].plane], observations, [pixels], flatness_m, n_rounds=2)
        if fit is None:
            break
        middle = np.average(
            [piece.middle for piece in pieces], axis=0, weights=[piece.area_m2 for piece in pieces]
        )
        lever = [float(np.linalg.norm(piece.middle - middle)) for piece in pieces]
        sd = [float(np.hypot(piece.sd_m, limits.BOW * lever[k])) for k, piece in enumerate(pieces)]
        off = [float(fit.surface.distance(piece.points).mean()) for piece in pieces]
        square = [float((fit.surface.distance(piece.points) ** 2).mean()) for piece in pieces]
        shifted = abs(off[0]) > limits.SHIFTED_SD * sd[0]
        rough = [
            square[k] > limits.ROUGHER * (piece.surface.fit.rms**2 + (3 * sd[k]) ** 2)
            or abs(off[k]) > limits.COPLANAR_SD * sd[k]
            for k, piece in enumerate(pieces)
        ]
        if not any(rough[1:]) and not shifted:
            n_parts = sum(piece.surface.n_parts for piece in pieces)
            return [MergedSurface(fit, pixels, n_parts), *apart]
        able = [k for k in range(1, len(pieces)) if rough[k] or not any(rough[1:])]
        worst = max(able, key=lambda k: square[k])
        apart.append(pieces.pop(worst).surface)
    return [*(piece.surface for piece in pieces), *apart]


def _union(sets: Sequence[ScanPixels]) -> ScanPixels:
    """All pixels of sets that have none in common."""
    by_scan: dict[int, list[PixelSet]] = {}
    for pixels in sets:
        for scan, held in pixels.held:
            by_scan.setdefault(scan, []).append(held)
    joined = tuple((scan, PixelSet.union(each, each[0].shape)) for scan, each in sorted(by_scan.items()))
    return ScanPixels(joined, sets[0].shapes)


def _absorb(
    surfaces: Sequence[MergedSurface], observations: Sequence[Observation], flatness_m: float, up: Up
) -> list[MergedSurface]:
    """Surfaces of which level and upright planes also hold the points of no surface that lie on them.

    They widen what is measured, and take no part in the fit: feet and skirtings pull on one side.
    """
    share, able = largest_shares(surfaces), {}
    for k, surface in enumerate(surfaces):
        is_large = share[k] > limits.ABSORBING_SHARE
        plane = RoomPlane.of(surface, observations, flatness_m) if is_large else None
        if plane is not None and plane.area_m2 > limits.ABSORBING_M2 and _kind(plane, up) != OTHER:
            able[k] = plane
    more: dict[int, list[tuple[int, PixelSet]]] = {k: [] for k in able}
    for scan, seen in enumerate(observations):
        owner = number_pixels(surfaces, scan, seen)
        free = np.flatnonzero((owner.ravel() == 0) & seen.valid.ravel())
        nearest = _nearest_plane(free, seen, able, flatness_m)
        for k in able:
            on = np.zeros(owner.size, dtype=np.bool_)
            on[free[nearest == k]] = True
            kept = _coherent(on.reshape(owner.shape), owner == k + 1, seen.valid.reshape(owner.shape))
            if kept.any():
                more[k].append((scan, PixelSet.of(kept)))
    grown = []
    for k, surface in enumerate(surfaces):
        if more.get(k):
            added = ScanPixels(tuple(more[k]), surface.pixels.shapes)
            surface = MergedSurface(surface.fit, _union([surface.pixels, added]), surface.n_parts)
        grown.append(surface)
    return sorted(grown, key=lambda surface: -surface.n_pixels)


def _nearest_plane(
    pixels: IntArray, seen: Observation, planes: dict[int, RoomPlane], flatness_m: float
) -> IntArray:
    """The plane (n,) that each of some flat pixels (n,) lies on, by number; -1 for none."""
    points, sigma = seen.points_at(pixels), seen.sigma_at(pixels)
    nearest, least = np.full(len(pixels), -1), np.full(len(pixels), limits.ON_PLANE_SD)
    for k, plane in planes.items():
        fit = plane.surface.fit
        sd = np.sqrt(sigma**2 + flatness_m**2 + fit.standard_deviation(points) ** 2)
        off = np.abs(fit.surface.distance(points)) / np.maximum(sd, 1e-9)
        is_before = float(plane.plane.distance(seen.scan.origin[None])[0]) > 0
        nearer = (off < least) & (sd < limits.ON_PLANE_M) & is_before
        nearest[nearer], least[nearer] = k, off[nearer]
    return nearest


def _coherent(on: BoolArray, members: BoolArray, valid: BoolArray) -> BoolArray:
    """Of pixels on a plane, those among others of it, in parts that touch its own or are no small specks.

    All are images (rows, columns).
    """
    result = np.zeros_like(on)
    boxes = ndimage.find_objects(on.astype(np.int8))
    if not boxes:
        return result
    box = tuple(slice(max(s.start - limits.AROUND_PX, 0), s.stop + limits.AROUND_PX) for s in boxes[0])
    on, members, valid = on[box], members[box], valid[box]
    around = ndimage.uniform_filter((on | members).astype(np.float32), limits.AROUND_PX)
    filled = ndimage.uniform_filter(valid.astype(np.float32), limits.AROUND_PX)
    kept = on & (around > 0.5 * np.maximum(filled, 0.2))
    part, _ = ndimage.label(kept | members)
    n_new, n_own = np.bincount(part.ravel(), kept.ravel()), np.bincount(part.ravel(), members.ravel())
    is_part = (n_own > 0) | (n_new >= limits.SPECK_PX)
    is_part[0] = False
    result[box] = kept & is_part[part]
    return result
