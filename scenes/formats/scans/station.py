# SPDX-License-Identifier: MIT
"""Station: points that lost their pixel grid, as the range image of a scanner that stood in a known place."""

from __future__ import annotations

import numpy as np
import scipy  # its parts load when they are first used
from numpy.typing import NDArray

from scenes.checks import ColourArray, FloatArray, InputError, check_point, check_points
from scenes.formats.guard import check_size
from scenes.formats.scans.angle_grid import AngleGrid, find_grid, is_filled, neighbour_steps, swept_poles
from scenes.pose import Pose
from scenes.scan.colour import colour_type
from scenes.scan.projection import SphericalProjection
from scenes.scan.range_image import RangeImage
from scenes.scan.saturation import saturation_start, saturation_warning

_FILLED = 0.95  # of the pixels between filled ones that must have a point
_KEPT = 0.95  # of the points, below which it is said why not
_FEWEST = 100  # points
_WIDER = 1.2  # from one try to the next
_SPARSE, _FEW = 1000, 1_000_000  # pixels for each point, and in all cases, beyond which no image is tried
_APART, _MOST_APART = 0.2, 0.3  # relative: ranges in one pixel, and the share of such pixels
_NARROW = np.cos(np.radians(60.0))  # half angle up to which the image's middle is put where the points are


def scan_from_station(
    points: object,
    origin: object,
    name: str = "cloud",
    colour: NDArray[np.float32] | ColourArray | None = None,
) -> RangeImage:
    """Return the points as one scan from `origin`, whose `sensor` says that it was made of points.

    The image is spherical. Where the points lie on a grid of angles about x, y, z or the axis that rows
    or columns of points run about, each has its pixel. Else the pixels are as small as leaves hardly any of
    them empty between others; single empty ones take the nearest point. Each pixel keeps the point nearest to
    its middle exactly as it was measured; others had no return. `sensor` tells how many points were kept,
    `warnings` why not nearly all. Ranges that only say that the scanner's number was full are left out, with
    a warning.

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
    order = np.lexsort(cloud.T)  # so that the file's order does not matter
    order = order[real[order]]
    cloud, ranges = cloud[order], away[order]
    rays = (cloud - stood) / ranges[:, None]
    grid = find_grid(rays, [*np.eye(3)[[2, 0, 1]], *swept])
    bins = _binned(rays) if grid is None else grid
    _check_single(bins.flat, ranges, stood)
    down = -bins.pole
    pose = Pose.from_parts(np.column_stack([np.cross(down, bins.forward), down, bins.forward]), stood)
    seen = pose.inverse().apply(cloud)
    kept = _nearest(bins, rays)
    told = [] if start == np.inf else [saturation_warning(len(away) - int(real.sum()), start, len(away))]
    chosen = np.full(bins.projection.shape, -1)
    chosen[bins.row[kept], bins.column[kept]] = kept
    if grid is None:
        filled = _fill_single(chosen, bins, rays)
        if len(kept) < _KEPT * len(cloud):
            told.append(
                f"{len(kept)} of {len(cloud)} points were kept ({len(kept) / len(cloud):.0%}), one a pixel, "
                f"and {filled} single empty pixels took the nearest: the points lie on no grid of angles "
                "about x, y or z; to keep all take the scan as the scanner wrote it (structured .e57, .ptx)"
            )
    image = np.where((chosen < 0)[..., None], np.nan, seen[chosen])
    painted = None
    if colour is not None:
        own = np.asarray(colour)[order]
        painted = np.where((chosen < 0)[..., None], 0, own[chosen]).astype(colour_type(colour))
    scan = RangeImage.from_points(image, bins.projection, pose, painted, name)
    x, y, z = stood
    sensor = (
        f"points projected to a spherical image from ({x:.10g}, {y:.10g}, {z:.10g}), {len(kept)} of "
        f"{len(cloud)} kept"
    )
    return scan.restated(sensor=sensor, warnings=tuple(told))


def _check_number(n_points: int) -> None:
    if n_points < _FEWEST:
        raise InputError(f"{n_points} points are too few for a scan; at least {_FEWEST} are needed")


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


def _fill_single(chosen: NDArray[np.int64], bins: AngleGrid, rays: FloatArray) -> int:
    """Write the nearest point into empty pixels (-1) whose neighbours on all sides are filled; count them."""
    inside = np.pad(chosen >= 0, 1)
    around = inside[:-2, 1:-1] & inside[2:, 1:-1] & inside[1:-1, :-2] & inside[1:-1, 2:]
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
    if not (length > 1e-6 and (rays @ middle).min() > _NARROW * length):
        middle = np.array([middle[0], middle[1], 0.0])
        middle = middle if np.linalg.norm(middle) > 1e-6 else np.eye(3)[0]
    turned = Pose.looking_at(np.zeros(3), middle, upward).rotation
    return -turned[:, 1], turned[:, 2]


def _binned(rays: FloatArray) -> AngleGrid:
    """Pixels wide enough to be filled, starting from the steps between neighbouring points."""
    pole, forward = _pole(rays)
    none = np.zeros(0, np.int64)
    whole = AngleGrid(pole, SphericalProjection(np.zeros(1), np.zeros(1)), forward, none, none)
    angles = _angles(whole, rays)
    step = neighbour_steps(angles)
    sides = np.ptp(angles, axis=0)
    while np.prod(np.maximum(sides / step, 1)) > _SPARSE * len(angles) + _FEW:
        step = step * _WIDER  # most of so many pixels would be empty
    while True:
        bins = _bins(whole, angles, step)
        filled = np.zeros(bins.projection.shape, dtype=np.bool_)
        filled[bins.row, bins.column] = True
        if is_filled(filled, _FILLED) or min(filled.shape) < 8:
            return bins
        step = step * _WIDER


def _bins(whole: AngleGrid, angles: FloatArray, step: FloatArray) -> AngleGrid:
    low, high = angles.min(axis=0), angles.max(axis=0)
    count = np.maximum(np.ceil((high - low) / step), 1).astype(np.int64)
    check_size(int(count[1]), int(count[0]))
    size = np.maximum((high - low) / count, 1e-12)
    column, row = np.minimum(np.floor((angles - low) / size).astype(np.int64), count - 1).T
    azimuths, elevations = (low[k] + (np.arange(count[k]) + 0.5) * size[k] for k in (0, 1))
    projection = SphericalProjection(azimuths, elevations[::-1])
    return AngleGrid(whole.pole, projection, whole.forward, count[1] - 1 - row, column)


def _check_single(pixel: NDArray[np.int64], ranges: FloatArray, stood: FloatArray) -> None:
    """Raise InputError where too many pixels hold points far behind each other."""
    order = np.argsort(pixel, kind="stable")
    start = np.flatnonzero(np.diff(pixel[order], prepend=-1))
    near = np.minimum.reduceat(ranges[order], start)
    far = np.maximum.reduceat(ranges[order], start)
    share = float(np.mean(far > (1 + _APART) * near))
    if share > _MOST_APART:
        x, y, z = stood
        raise InputError(
            f"{100 * share:.0f} % of the directions from ({x:.10g}, {y:.10g}, {z:.10g}) meet points behind "
            "each other, which no one scan from there measured; was it another place, or are scans merged?"
        )
