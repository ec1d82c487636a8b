# SPDX-License-Identifier: MIT
"""Station: points that lost their pixel grid, as the range image of a scanner that stood in a known place."""

from __future__ import annotations

import numpy as np
import scipy  # its parts load when they are first used
from numpy.typing import NDArray

from scenes import limits
from scenes.checks import BoolArray, ColourArray, FloatArray, InputError, IntArray, check_point, check_points
from scenes.io.checks.guard import check_size
from scenes.io.formats.angle_grid import (
    AngleGrid,
    find_grid,
    is_filled,
    neighbour_steps,
    swept_beams,
    swept_poles,
)
from scenes.pose import Pose
from scenes.scan.colour import colour_type
from scenes.scan.projection import SphericalProjection
from scenes.scan.range_image import POINTS_SENSOR, RangeImage, saturation_start, saturation_warning

_WIDER = 1.2  # from one try to the next


def scan_from_station(
    points: object,
    origin: object,
    name: str = "cloud",
    colour: NDArray[np.float32] | ColourArray | None = None,
    beam: NDArray[np.int64] | None = None,
) -> RangeImage:
    """Return the points as one scan from `origin`, whose `sensor` says that it was made of points.

    The image is spherical. Where the points lie on a grid of angles about x, y, z or the axis that rows
    or columns of points run about, each has its pixel; the grid's steps may be uneven, so that each beam of a
    spinning lidar is a row (`scenes.io.formats.angle_grid`). Else the pixels are as small as leaves hardly
    any of them empty between others. Single empty ones take the nearest point. Each pixel keeps the point
    nearest to its middle exactly as it was measured; others had no return. `sensor` tells how many points
    were kept, `warnings` why not nearly all. Left out with a warning are repeated points, ranges that only
    say that the scanner's number was full, and returns of what carries the scanner: those nearer than any
    others, nearer than 2.5 m, on more than one side of it, with next to nothing up to 1.5 times their range.

    Parameters
    ----------
    points : (n, 3) float
        World coordinates, metres, z up.
    origin : (3,) float
        Where the scanner stood, metres.
    name : str
        What to call the scan.
    colour : (n, 3) uint8 or float32, optional
        sRGB of each point, 0..255 or in 0..1.
    beam : (n,) int, optional
        The number of the beam of each point, of a lidar with several that turns about z.

    Raises
    ------
    InputError
        Fewer than 100 points; points that lie behind each other as seen from there, so that no one scan from
        there took them.
    """
    stood, cloud = check_point("origin", origin), check_points("points", points)
    _check_number(len(cloud))
    away = np.linalg.norm(cloud - stood, axis=1)
    start = saturation_start(away[away > 0])
    real = (away > 0) & (away < start)
    _check_number(int(real.sum()))
    swept = swept_poles((cloud[real] - stood) / away[real, None])
    if beam is None and (swept_in := swept_beams((cloud[real] - stood) / away[real, None])) is not None:
        beam = np.zeros(len(cloud), np.int64)
        beam[real] = swept_in
    order, sentences = _usable(real, cloud, stood)
    if start < np.inf:
        sentences.insert(0, saturation_warning(len(away) - int(real.sum()), start, len(away)))
    cloud, ranges = cloud[order], away[order]
    rays = (cloud - stood) / ranges[:, None]
    grid = find_grid(rays, [*np.eye(3)[[2, 0, 1]], *swept], None if beam is None else beam[order])
    bins = _bin_pixels(rays, ranges, stood) if grid is None else grid
    down = -bins.pole
    pose = Pose.from_parts(np.column_stack([np.cross(down, bins.forward), down, bins.forward]), stood)
    seen = pose.inverse().apply(cloud)
    kept = _nearest(bins, rays)
    chosen = np.full(bins.projection.shape, -1)
    chosen[bins.row[kept], bins.column[kept]] = kept
    filled = 0 if bins.is_own else _fill_single(chosen, bins, rays, is_row=grid is not None)
    if len(kept) < limits.NEARLY_ALL * len(cloud):
        sentences.append(
            f"{len(kept)} of {len(cloud)} points were kept ({len(kept) / len(cloud):.0%}), one a pixel, "
            f"and {filled} single empty pixels took the nearest: the points lie on no grid of angles "
            "about x, y or z; to keep all take the scan as the scanner wrote it (structured .e57, .ptx)"
        )
    elif filled > (1 - limits.NEARLY_ALL) * len(kept):
        sentences.append(
            f"{len(kept)} of {len(cloud)} points were kept, one a pixel, and {filled} single empty pixels "
            "between them took the nearest"
        )
    image = np.where((chosen < 0)[..., None], np.nan, seen[chosen])
    painted = None
    if colour is not None:
        members = np.asarray(colour)[order]
        painted = np.where((chosen < 0)[..., None], 0, members[chosen]).astype(colour_type(colour))
    scan = RangeImage.from_points(image, bins.projection, pose, painted, name)
    x, y, z = stood
    sensor = f"{POINTS_SENSOR} from ({x:.10g}, {y:.10g}, {z:.10g}), {len(kept)} of {len(cloud)} kept"
    return scan.with_facts(sensor=sensor).add_warnings(sentences)


def _usable(real: BoolArray, cloud: FloatArray, stood: FloatArray) -> tuple[IntArray, list[str]]:
    """Of the `real` (n,) points those neither repeated nor of what carries the scanner, by number, and why.

    They are sorted by their places, so that the file's order does not matter.
    """
    order = np.asarray(np.lexsort(cloud.T), dtype=np.int64)
    order = order[real[order]]
    sentences, n_all = list[str](), len(order)
    new = np.concatenate([[True], (np.diff(cloud[order], axis=0) != 0).any(axis=1)])
    order = order[new]
    if len(order) < n_all:
        sentences.append(f"{n_all - len(order)} of {n_all} points repeat others and were left out")
    away = cloud[order] - stood
    reach = _carrier_reach(away)
    near = np.linalg.norm(away, axis=1) <= reach
    if reach > 0:
        sentences.append(
            f"{int(near.sum())} of {len(order)} returns lie within {reach:.2g} m around the scanner, apart "
            "from all others: they are of what carries it and were left out"
        )
    return order[~near], sentences


def _carrier_reach(away: FloatArray) -> float:
    """How far what carries the scanner reaches, by points (n, 3) about its place, metres; 0 for none.

    A tripod, a robot or the roof of a car is near, on more than one side of the vertical through the scanner,
    and parted from the rest by a gap of ranges. A desk beside it is on one side, and floors have no gap.
    """
    ranges = np.linalg.norm(away, axis=1)
    held = np.sort(ranges)
    ends = np.geomspace(limits.CARRIER_M, max(held[0], 1e-3 * limits.CARRIER_M), 60)
    for reach in ends / limits.CARRIER_GAP:
        n_near, n_all = np.searchsorted(held, [reach, limits.CARRIER_GAP * reach], side="right")
        is_apart = n_all - n_near <= limits.CARRIER_STRAYS * len(held)
        if n_near < limits.FEWEST_POINTS or n_near > len(held) / 2 or not is_apart:
            continue
        near = away[ranges <= reach]
        sector = np.floor((np.arctan2(near[:, 1], near[:, 0]) / np.pi + 1) * 6).astype(np.int64) % 12
        taken = np.bincount(sector, minlength=12) >= 0.01 * len(near)
        widest = max(np.diff(np.flatnonzero(np.tile(taken, 2))), default=12)
        if widest <= 6:
            return float(held[n_near - 1])
    return 0.0


def _check_number(n_points: int) -> None:
    if n_points < limits.FEWEST_POINTS:
        raise InputError(
            f"{n_points} points are too few for a scan; at least {limits.FEWEST_POINTS} are needed"
        )


def _angles(bins: AngleGrid, rays: FloatArray) -> FloatArray:
    """Azimuth and elevation (n, 2) of unit rays (n, 3)."""
    right = np.cross(bins.forward, bins.pole)
    return np.column_stack([
        np.arctan2(rays @ right, rays @ bins.forward), np.arcsin(np.clip(rays @ bins.pole, -1.0, 1.0))
    ])  # fmt: skip


def _middles(bins: AngleGrid) -> tuple[FloatArray, FloatArray]:
    return bins.projection.azimuths, bins.projection.elevations


def _nearest(bins: AngleGrid, rays: FloatArray) -> NDArray[np.int64]:
    """The point of each pixel that is nearest to its middle, as numbers."""
    azimuths, elevations = _middles(bins)
    off = _angles(bins, rays) - np.column_stack([azimuths[bins.column], elevations[bins.row]])
    off[:, 0] = (off[:, 0] + np.pi) % (2 * np.pi) - np.pi
    order = np.lexsort((np.hypot(*off.T), bins.flat))
    _, first = np.unique(bins.flat[order], return_index=True)
    return np.asarray(order[first])


def _fill_single(chosen: IntArray, bins: AngleGrid, rays: FloatArray, *, is_row: bool) -> int:
    """Write the nearest point into empty pixels (-1) whose neighbours on all sides are filled; count them.

    Of a row that is a beam, the neighbours are those in the row.
    """
    inside = np.pad(chosen >= 0, 1)
    around = inside[1:-1, :-2] & inside[1:-1, 2:]
    around &= is_row | (inside[:-2, 1:-1] & inside[2:, 1:-1])
    row, column = np.nonzero(around & (chosen < 0))
    if len(row):
        azimuths, elevations = _middles(bins)
        tree = scipy.spatial.cKDTree(_angles(bins, rays))
        chosen[row, column] = tree.query(np.column_stack([azimuths[column], elevations[row]]))[1]
    return len(row)


def _pole(rays: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Upright, and level towards the points; straight at them where all are on one side."""
    middle, upward = rays.mean(axis=0), np.array([0.0, 0.0, 1.0])
    length = float(np.linalg.norm(middle))
    if not (length > 1e-6 and (rays @ middle).min() > limits.NARROW * length):
        middle = np.array([middle[0], middle[1], 0.0])
        middle = middle if np.linalg.norm(middle) > 1e-6 else np.eye(3)[0]
    turned = Pose.looking_at(np.zeros(3), middle, upward).rotation
    return -turned[:, 1], turned[:, 2]


def _bin_pixels(rays: FloatArray, ranges: FloatArray, stood: FloatArray) -> AngleGrid:
    """Pixels wide enough to be filled, starting from the steps between neighbouring points.

    Where many would hold points behind each other, as of trees, with gaps of sky, smaller ones are taken
    that are less filled, if they keep half of the points.

    Raises InputError: too many hold points behind each other all the same.
    """
    pole, forward = _pole(rays)
    none = np.zeros(0, np.int64)
    whole = AngleGrid(pole, SphericalProjection(np.zeros(1), np.zeros(1)), forward, none, none)
    angles = _angles(whole, rays)
    step = neighbour_steps(angles)
    sides = np.ptp(angles, axis=0)
    while np.prod(np.maximum(sides / step, 1)) > limits.SPARSE * len(angles) + limits.SPARSE_PIXELS:
        step = step * _WIDER  # most of so many pixels would be empty
    smaller = None
    while True:
        bins = _bins(whole, angles, step)
        filled = bins.filled
        if smaller is None and is_filled(filled, limits.FILLED):
            smaller = bins
        if is_filled(filled, limits.NEARLY_ALL) or min(filled.shape) < 8:
            break
        step = step * _WIDER
    share = _share_apart(bins.flat, ranges)
    if share <= limits.MOST_APART:
        return bins
    keeps_half = smaller is not None and smaller.kept >= 0.5
    if smaller is not None and keeps_half and _share_apart(smaller.flat, ranges) <= limits.MOST_APART / 2:
        return smaller
    x, y, z = stood
    raise InputError(
        f"{100 * share:.0f} % of the directions from ({x:.10g}, {y:.10g}, {z:.10g}) meet points behind "
        "each other, which no one scan from there measured; was it another place, or are scans merged?"
    )


def _bins(whole: AngleGrid, angles: FloatArray, step: FloatArray) -> AngleGrid:
    low, high = angles.min(axis=0), angles.max(axis=0)
    count = np.maximum(np.ceil((high - low) / step), 1).astype(np.int64)
    check_size(int(count[1]), int(count[0]))
    size = np.maximum((high - low) / count, 1e-12)
    column, row = np.minimum(np.floor((angles - low) / size).astype(np.int64), count - 1).T
    azimuths, elevations = (low[k] + (np.arange(count[k]) + 0.5) * size[k] for k in (0, 1))
    projection = SphericalProjection(azimuths, elevations[::-1])
    return AngleGrid(whole.pole, projection, whole.forward, count[1] - 1 - row, column, is_own=False)


def _share_apart(pixel: IntArray, ranges: FloatArray) -> float:
    """Share of the filled pixels that hold points far behind each other."""
    order = np.argsort(pixel, kind="stable")
    start = np.flatnonzero(np.diff(pixel[order], prepend=-1))
    near = np.minimum.reduceat(ranges[order], start)
    far = np.maximum.reduceat(ranges[order], start)
    return float(np.mean(far > (1 + limits.RANGES_APART) * near))
