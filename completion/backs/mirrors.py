# SPDX-License-Identifier: MIT
"""Mirrors: all vertical planes are tried, the best are refined, first by score and then by least squares."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from completion.backs.limits import (
    APART,
    APART_DEG,
    CORRELATED,
    END_NEAR,
    FACING_OFFSET,
    FREE_WEIGHT,
    LEAST_PIXEL_SD,
    LIMB_FACING,
    LIMB_NEAR,
    LIMB_WEIGHT,
    N_HALVINGS,
    N_PEAKS,
    N_ROUNDS,
    OFF_PLANE,
    PIXEL_SD,
    SAME_NORMAL,
    STEP,
    STEP_DEG,
    WIDEST,
)
from completion.backs.seeing import is_possible, see, see_limbs
from completion.backs.symmetry import Sample, Symmetry, mirror_change, mirrors, move
from completion.backs.views import Scale, Setting, Sight
from scenes.checks import FloatArray

_LEAST_OFF = 0.15  # share of the points off a plane from which its score means anything
_OFFSETS = np.stack(np.meshgrid(np.arange(-2, 3), np.arange(-2, 3)), axis=-1).reshape(-1, 2)


def find_mirrors(sights: Sequence[Sight], sample: Sample, setting: Setting, scale: Scale) -> list[Symmetry]:
    """Return the mirrors that views speak for, best first, with covariance and evidence.

    Every plane of a grid is scored by S = m - 3 f + 0.4 b with doubled tolerance; peaks are refined on finer
    grids, then by least squares of the distances between mirrored and measured surface, and between limbs.
    """
    angles = np.arange(0, 180, STEP_DEG)
    offsets = np.arange(-WIDEST, WIDEST + 1e-9, STEP) * scale.size
    grid = np.stack(np.meshgrid(np.radians(angles), offsets, indexing="ij"), axis=-1).reshape(-1, 2)
    score = _scores(sights, sample, setting, scale, places=grid, fine=False)
    found = []
    for peak in _peaks(grid, score, scale.size):
        place, step = grid[peak], np.array([np.radians(STEP_DEG), STEP * scale.size])
        for _ in range(N_HALVINGS):
            step = step / 2
            around = place + _OFFSETS * step
            place = around[np.argmax(_scores(sights, sample, setting, scale, places=around, fine=True))]
        fitted, covariance = _least_squares(place, sights, sample, setting, scale)
        both = np.stack([place, fitted])
        before, after = _scores(sights, sample, setting, scale, places=both, fine=True)
        place = fitted if after >= before - OFF_PLANE else place
        found.append(_with_evidence(place, covariance, sights, sample, setting, scale=scale))
    return _distinct(found, scale.size)


def _scores(
    sights: Sequence[Sight], sample: Sample, setting: Setting, scale: Scale, *, places: FloatArray, fine: bool
) -> FloatArray:
    """S (k,) of mirrors (k, 2)."""
    n = len(sample.points) if fine else sample.n_coarse
    tolerance = scale.tolerance if fine else 2 * scale.tolerance
    points, isometries = sample.points[:n], mirrors(places, scale.middle)
    seen = see(sights, isometries, points, sample.normals[:n], tolerance)
    off = np.abs(_heights(places, points - scale.middle)) >= OFF_PLANE * scale.size
    many = np.maximum(off.sum(axis=1), 1)
    free = np.maximum(seen.free, _behind_walls(isometries, points, setting, tolerance))
    matched = np.where(off, seen.matched * (1 - free), 0).sum(axis=1) / many
    limbs = see_limbs(sights, isometries, sample.limbs if fine else sample.some_limbs, scale.size)
    score = matched - FREE_WEIGHT * np.where(off, free, 0).sum(axis=1) / many + LIMB_WEIGHT * limbs.on_limb
    return np.asarray(np.where(many >= _LEAST_OFF * n, score, -1.0), dtype=np.float64)


def _heights(places: FloatArray, points: FloatArray) -> FloatArray:
    """Distances (k, n) of points (n, 3), about the middle, before mirrors (k, 2)."""
    normal = np.stack([np.cos(places[:, 0]), np.sin(places[:, 0])])
    return np.asarray((points[:, :2] @ normal - places[:, 1]).T)


def _behind_walls(
    isometries: FloatArray, points: FloatArray, setting: Setting, tolerance: float
) -> FloatArray:
    """1 (k, n) where a moved point lies behind a wall, which no thing does, else 0."""
    behind: FloatArray = np.zeros((len(isometries), len(points)))
    for wall in setting.walls:
        normal = wall[:3] @ isometries[:, :, :3]
        height = normal @ points.T + (isometries[:, :, 3] @ wall[:3] - wall[3])[:, None]
        behind = np.maximum(behind, (height < -2 * tolerance).astype(np.float64))
    return behind


def _peaks(grid: FloatArray, score: FloatArray, size: float) -> list[int]:
    """Numbers of the best mirrors that are apart."""
    peaks: list[int] = []
    for one in np.argsort(-score, kind="stable").tolist():
        if score[one] <= 0 or len(peaks) == N_PEAKS:
            break
        if all(_are_apart(grid[one], grid[other], size) for other in peaks):
            peaks.append(one)
    return peaks


def _are_apart(one: FloatArray, other: FloatArray, size: float, share: float = 1.0) -> bool:
    turn, shift = one[0] - other[0], one[1] - other[1]
    if abs(turn) > np.pi / 2:  # the same plane with its normal the other way
        turn, shift = np.pi - abs(turn), one[1] + other[1]
    return bool(abs(turn) >= share * np.radians(APART_DEG) or abs(shift) >= share * APART * size)


def _distinct(found: list[Symmetry], size: float) -> list[Symmetry]:
    """The found mirrors without those that refinement brought to a better one, best first."""
    kept: list[Symmetry] = []
    for one in sorted(found, key=lambda one: -one.evidence["score"]):
        if all(_are_apart(one.place, other.place, size, 0.4) for other in kept):
            kept.append(one)
    return kept


def _least_squares(
    place: FloatArray, sights: Sequence[Sight], sample: Sample, setting: Setting, scale: Scale
) -> tuple[FloatArray, FloatArray]:
    """Mirror (2,) nearest to measured surface and limbs, and its covariance (2, 2).

    Residuals: a mirrored point to the plane of the nearest measured one, a mirrored limb point to the nearest
    limb across the line of sight. A flat front fixes the angle, limbs on both sides fix the offset.
    """
    tree = cKDTree(sample.points)
    trees = [
        cKDTree(sight.points[pixels]) if len(pixels) else None
        for sight, pixels in zip(sights, sample.limbs, strict=True)
    ]
    prior = np.diag([1 / np.radians(STEP_DEG) ** 2, 1 / (STEP * scale.size) ** 2])
    information = prior
    for _ in range(N_ROUNDS):
        isometry = mirrors(place[None], scale.middle)[0]
        off = np.abs(_heights(place[None], sample.points - scale.middle)[0]) >= OFF_PLANE * scale.size
        points = sample.points[off]
        moved, facing = move(isometry, points), sample.normals[off] @ isometry[:, :3].T
        near, at = tree.query(moved, distance_upper_bound=3 * scale.tolerance)
        use = np.isfinite(near)
        to = sample.normals[at[use]]
        residual = np.einsum("ij,ij->i", moved[use] - sample.points[at[use]], to)
        good = (np.einsum("ij,ij->i", facing[use], to) > SAME_NORMAL) & (np.abs(residual) < scale.tolerance)
        change = mirror_change(place, points - scale.middle)[use][good]
        slope = _slope(to[good], change)
        residual = residual[good]
        typical = 1.4826 * float(np.median(np.abs(residual))) if len(residual) else scale.tolerance
        sd = max(typical, setting.sigma_m, 1e-4 * scale.size)
        weight = 1 / (2 * CORRELATED * sd**2)  # each pair is met from both sides
        information = prior + weight * slope.T @ slope
        gradient = weight * slope.T @ residual
        for sight, pixels, limb in zip(sights, sample.limbs, trees, strict=True):
            if limb is None:
                continue
            moved = move(isometry, sight.points[pixels])
            near, at = limb.query(moved, distance_upper_bound=2 * LIMB_NEAR * scale.size)
            use = np.isfinite(near)
            other = pixels[at[use]]
            side = sight.side[other]
            turned = sight.side[pixels[use]] @ isometry[:, :3].T
            aside = np.einsum("ij,ij->i", moved[use] - sight.points[other], side)
            good = (np.einsum("ij,ij->i", turned, side) > SAME_NORMAL) & (
                np.abs(aside) < LIMB_NEAR * scale.size
            )
            change = mirror_change(place, sight.points[pixels[use]][good] - scale.middle)
            slope = _slope(side[good], change)
            weight = 1 / (2 * (PIXEL_SD * sight.pixel_m) ** 2 * np.sqrt(CORRELATED))
            information = information + weight * slope.T @ slope
            gradient = gradient + weight * slope.T @ aside[good]
        place = place - np.linalg.solve(information, gradient)
    pixel = LEAST_PIXEL_SD * min(sight.pixel_m for sight in sights)
    least = np.diag([(pixel / (scale.size / 4)) ** 2, pixel**2])  # ends are known to pixels
    return place, np.linalg.inv(information) + least


def _slope(normals: FloatArray, change: FloatArray) -> FloatArray:
    """Change (n, 2) of residuals along normals (n, 3) with angle and offset.

    Normals are noisy: those that are nearly along the mirror say nothing of its offset.
    """
    slope: FloatArray = np.einsum("ni,nij->nj", normals, change)
    slope[np.abs(slope[:, 1]) < 2 * FACING_OFFSET, 1] = 0.0
    return slope


def _with_evidence(
    place: FloatArray,
    covariance: FloatArray,
    sights: Sequence[Sight],
    sample: Sample,
    setting: Setting,
    *,
    scale: Scale,
) -> Symmetry:
    """A mirror with the numbers that its probability is made of."""
    isometries = mirrors(place[None], scale.middle)
    seen = see(sights, isometries, sample.points, sample.normals, scale.tolerance)
    free = np.maximum(seen.free, _behind_walls(isometries, sample.points, setting, scale.tolerance))[0]
    height = _heights(place[None], sample.points - scale.middle)[0]
    off = np.abs(height) >= OFF_PLANE * scale.size
    many = max(int(off.sum()), 1)
    matched = float((seen.matched[0] * (1 - free))[off].sum()) / many
    contradicted = float(free[off].sum()) / many
    limbs = see_limbs(sights, isometries, sample.limbs, scale.size)
    front, back = int((height > 0).sum()), int((height < 0).sum())
    ways = np.array([scale.middle - np.array(sight.eye.origin) for sight in sights])[:, :2]
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    symmetry = Symmetry("mirror", place, scale.middle, covariance, {})
    ends = tuple(
        pixels[np.abs(sight.side[pixels] @ symmetry.normal) > LIMB_FACING]
        for sight, pixels in zip(sights, sample.limbs, strict=True)
    )
    at_ends = see_limbs(sights, isometries, ends, scale.size)
    moved = move(isometries[0], sample.points[off])
    possible = is_possible(sights, moved, setting, max(scale.tolerance, 3 * setting.sigma_m))
    evidence = {
        "matched": matched,
        "contradicted": contradicted,
        "hidden": float(seen.hidden[0][off].sum()) / many,
        "limb": float(limbs.on_limb[0]),
        "cut": float(at_ends.on_cut[0]),
        "refuted": 1 - float(possible.mean()) if len(possible) else 0.0,
        "balance": min(front, back) / max(front, back, 1),
        "across": float(np.abs(ways @ symmetry.normal[:2]).min()),
        "sd_offset": float(np.sqrt(covariance[1, 1])) / scale.size,
        "score": matched - FREE_WEIGHT * contradicted + LIMB_WEIGHT * float(limbs.on_limb[0]),
    }
    return Symmetry("mirror", place, scale.middle, covariance, evidence | _ends(place, sights, scale))


def _ends(place: FloatArray, sights: Sequence[Sight], scale: Scale) -> dict[str, float]:
    """Whether a mirror's two ends were seen, where an occluder or the image's border cuts the thing.

    `unseen`: share of cuts in the outline near the end of a side, the larger of both; `lost`: mean signed
    distance of cuts over that of the outline. The least of all views: one that sees the thing is enough.
    """
    found = []
    for sight in sights:
        cut = _heights(place[None], sight.points[sight.cut] - scale.middle)[0]
        limb = _heights(place[None], sight.points[sight.limb & ~sight.cut] - scale.middle)[0]
        every = np.concatenate([cut, limb])
        if not len(cut):
            return {"unseen": 0.0, "lost": 0.0}
        unseen = 0.0
        for side in (-1, 1):
            near = (side * every).max() - END_NEAR * scale.size
            ends = [float((side * one > near).sum()) for one in (cut, limb)]
            unseen = max(unseen, ends[0] / sum(ends))
        found.append((unseen, abs(float(cut.sum())) / max(float(np.abs(every).sum()), 1e-9)))
    return dict(zip(("unseen", "lost"), np.min(found, axis=0).tolist(), strict=True))
