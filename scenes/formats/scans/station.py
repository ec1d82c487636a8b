# SPDX-License-Identifier: MIT
"""Station: points that lost their pixel grid, as the range image of a scanner that stood in a known place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy  # its parts load when they are first used
from numpy.typing import NDArray

from scenes.checks import ColourArray, FloatArray, InputError, check_point, check_points
from scenes.formats.guard import check_size
from scenes.pose import Pose
from scenes.scan.colour import colour_type
from scenes.scan.projection import SphericalProjection
from scenes.scan.range_image import RangeImage

_N_SAMPLE = 20_000  # points whose neighbours are looked at
_FILLED = 0.95  # of the pixels between filled ones that must have a point
_WIDER = 1.2  # from one try to the next
_SPARSE, _FEW = 1000, 1_000_000  # pixels for each point, and in all cases, beyond which no image is tried
_APART, _MOST_APART = 0.2, 0.3  # relative: ranges in one pixel, and the share of such pixels
_NARROW = np.cos(np.radians(60.0))  # half angle up to which the image's middle is put where the points are


@dataclass(frozen=True, slots=True, eq=False)
class _Bins:
    """Pixels that points fall into."""

    projection: SphericalProjection
    row: NDArray[np.int64]
    column: NDArray[np.int64]

    @property
    def flat(self) -> NDArray[np.int64]:
        return self.row * self.projection.shape[1] + self.column


def scan_from_station(
    points: object,
    origin: object,
    name: str = "cloud",
    colour: NDArray[np.float32] | ColourArray | None = None,
) -> RangeImage:
    """Return the points as one scan from `origin`, whose `sensor` says that it was made of points.

    The image is spherical, its pixels as small as leaves hardly any of them empty between others. Each keeps
    the point nearest to its middle exactly as it was measured; pixels without one had no return.

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
    order = np.lexsort(cloud.T)  # so that the file's order does not matter
    order = order[np.linalg.norm(cloud[order] - stood, axis=1) > 0]
    cloud = cloud[order]
    if len(cloud) < 100:
        raise InputError(f"{len(cloud)} points are too few for a scan; at least 100 are needed")
    pose = _pose(cloud, stood)
    seen = pose.inverse().apply(cloud)
    angles = np.column_stack([
        np.arctan2(seen[:, 0], seen[:, 2]),
        np.arctan2(-seen[:, 1], np.hypot(seen[:, 0], seen[:, 2])),
    ])  # fmt: skip
    bins = _binned(angles)
    ranges = np.linalg.norm(seen, axis=1)
    _check_single(bins.flat, ranges, stood)
    middle = np.column_stack([bins.projection.azimuths[bins.column], bins.projection.elevations[bins.row]])
    off = np.hypot(*(angles - middle).T)
    nearest = np.lexsort((off, bins.flat))
    _, first = np.unique(bins.flat[nearest], return_index=True)
    kept = nearest[first]
    image = np.full((*bins.projection.shape, 3), np.nan)
    image[bins.row[kept], bins.column[kept]] = seen[kept]
    painted = None
    if colour is not None:
        painted = np.zeros((*bins.projection.shape, 3), colour_type(colour))
        painted[bins.row[kept], bins.column[kept]] = np.asarray(colour)[order[kept]]
    scan = RangeImage.from_points(image, bins.projection, pose, painted, name)
    x, y, z = stood
    return scan.restated(sensor=f"points projected to a spherical image from ({x:.10g}, {y:.10g}, {z:.10g})")


def _pose(points: FloatArray, stood: FloatArray) -> Pose:
    """Upright towards the points; straight at them where they are all on one side."""
    rays = points - stood
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    middle = rays.mean(axis=0)
    length = float(np.linalg.norm(middle))
    if length > 1e-6 and (rays @ middle).min() > _NARROW * length:
        return Pose.looking_at(stood, stood + middle)
    level = np.array([middle[0], middle[1], 0.0])
    return Pose.looking_at(stood, stood + (level if np.linalg.norm(level) > 1e-6 else np.eye(3)[0]))


def _binned(angles: FloatArray) -> _Bins:
    """Pixels wide enough to be filled, starting from the steps between neighbouring points."""
    step = _steps(angles)
    sides = np.ptp(angles, axis=0)
    while np.prod(np.maximum(sides / step, 1)) > _SPARSE * len(angles) + _FEW:
        step = step * _WIDER  # most of so many pixels would be empty
    while True:
        bins = _bins(angles, step)
        filled = np.zeros(bins.projection.shape, dtype=np.bool_)
        filled[bins.row, bins.column] = True
        between = scipy.ndimage.binary_closing(np.pad(filled, 2), np.ones((3, 3)))[2:-2, 2:-2]
        if filled.sum() >= _FILLED * between.sum() or min(filled.shape) < 8:
            return bins
        step = step * _WIDER


def _bins(angles: FloatArray, step: FloatArray) -> _Bins:
    low, high = angles.min(axis=0), angles.max(axis=0)
    count = np.maximum(np.ceil((high - low) / step), 1).astype(np.int64)
    check_size(int(count[1]), int(count[0]))
    size = np.maximum((high - low) / count, 1e-12)
    column, row = np.minimum(np.floor((angles - low) / size).astype(np.int64), count - 1).T
    azimuths, elevations = (low[k] + (np.arange(count[k]) + 0.5) * size[k] for k in (0, 1))
    return _Bins(SphericalProjection(azimuths, elevations[::-1]), count[1] - 1 - row, column)


def _steps(angles: FloatArray) -> FloatArray:
    """Median angle (2,) to the next point sideways and upwards, radians."""
    flat = angles.copy()
    flat[:, 0] *= np.cos(angles[:, 1])
    sample = np.linspace(0, len(flat) - 1, min(_N_SAMPLE, len(flat))).astype(np.int64)
    _, near = scipy.spatial.cKDTree(flat).query(flat[sample], k=9)
    way = np.abs(flat[near[:, 1:]] - flat[sample, None])
    is_level = way[..., 0] >= way[..., 1]
    found = []
    for axis, chosen in ((0, is_level), (1, ~is_level)):
        nearest = np.where(chosen & (way[..., axis] > 1e-9), way[..., axis], np.inf).min(axis=1)
        known = nearest[np.isfinite(nearest)]
        found.append(float(np.median(known)) if len(known) else np.inf)
    smaller = min(found) if np.isfinite(min(found)) else 1e-3
    return np.array([one if np.isfinite(one) else smaller for one in found])


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
