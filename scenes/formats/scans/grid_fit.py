# SPDX-License-Identifier: MIT
"""Grid fitting: which pinhole or spherical geometry an organised set of measured points has."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy  # its parts load when they are first used

from scenes.checks import BoolArray, FloatArray, InputError
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection, Projection, SphericalProjection
from scenes.scan.range_image import RangeImage

# A terrestrial scanner's own frame is z up, y to the left of x: sensor z = x, sensor x = -y, sensor y = -z.
SCANNER_FROM_SENSOR = Pose(np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]]))
PINHOLE_LIMIT_PX = 0.5  # median residual above which an organised cloud is no pinhole image
SPHERICAL_LIMIT_PX = 1.0
_ON_RAY_M = 1e-6  # at 1 m; a point nearer to its ideal ray than this is stored as a range alone


@dataclass(frozen=True, slots=True)
class GridFit:
    """A projection estimated from points, and how well it explains them.

    Attributes
    ----------
    projection : Projection
        Pinhole or spherical.
    residual_px : float
        Median distance in pixels between where a point was stored and where the projection sees it.
    """

    projection: Projection
    residual_px: float


def fit_grid(points: FloatArray) -> GridFit:
    """Estimate the projection of organised sensor-frame points (rows, columns, 3), NaN where there is none.

    Both models are fitted; the one with the smaller residual wins, the pinhole on equal terms.

    Raises InputError: neither model explains the points, or there are too few of them.
    """
    fits = [fit for fit in (fit_pinhole(points), fit_spherical(points)) if fit is not None]
    if not fits:
        raise InputError(
            f"{int(np.isfinite(points).all(axis=-1).sum())} points in a grid of {points.shape[0]} x "
            f"{points.shape[1]} are too few to estimate its projection (.pcd: give --intrinsics FX,FY,CX,CY)"
        )
    limits = {"pinhole": PINHOLE_LIMIT_PX, "spherical": SPHERICAL_LIMIT_PX}
    good = [fit for fit in fits if fit.residual_px <= limits[fit.projection.kind]]
    if not good:
        tried = ", ".join(f"{fit.projection.kind} {fit.residual_px:.3g} px" for fit in fits)
        raise InputError(
            f"the organised points fit no known projection (median residual: {tried}); "
            "are rows and columns swapped, or were several scans merged?"
        )
    best = min(good, key=lambda fit: fit.residual_px)
    pinhole = [fit for fit in good if fit.projection.kind == "pinhole"]
    return pinhole[0] if pinhole and pinhole[0].residual_px <= best.residual_px + 0.01 else best


def fit_pinhole(points: FloatArray) -> GridFit | None:
    """Fit a pinhole to sensor-frame points (rows, columns, 3), NaN where there is none.

    Column = fx x/z + cx and row = fy y/z + cy are fitted robustly; None where that cannot be determined.
    """
    valid = np.isfinite(points).all(axis=-1)
    ahead = valid & (np.nan_to_num(points[..., 2]) > 0)
    if ahead.sum() < 3 or ahead.sum() < 0.9 * valid.sum():
        return None
    row, column = np.nonzero(ahead)
    if np.ptp(row) == 0 or np.ptp(column) == 0:
        return None
    x, y, z = points[ahead].T
    fx, cx = _robust_line(x / z, column.astype(np.float64))
    fy, cy = _robust_line(y / z, row.astype(np.float64))
    try:
        camera = PinholeProjection(width=points.shape[1], height=points.shape[0], fx=fx, fy=fy, cx=cx, cy=cy)
    except InputError:  # no camera has such numbers
        return None
    off = np.hypot(fx * x / z + cx - column, fy * y / z + cy - row)
    return GridFit(camera, float(np.median(off)))


def _robust_line(x: FloatArray, y: FloatArray) -> tuple[float, float]:
    """Slope and offset of y over x by least squares, repeated without what lies beyond 3 deviations."""
    keep: BoolArray = np.asarray(np.isfinite(x), dtype=np.bool_)
    slope, offset = 0.0, 0.0
    for _ in range(6 * keep.any()):
        mean_x, mean_y = x[keep].mean(), y[keep].mean()
        spread = float(((x[keep] - mean_x) ** 2).sum())
        if not 0.0 < spread < np.inf:
            return 0.0, float(mean_y)
        slope = float(((x[keep] - mean_x) * (y[keep] - mean_y)).sum() / spread)
        offset = float(mean_y - slope * mean_x)
        off = np.abs(y - slope * x - offset)
        keep = off <= max(3 * 1.4826 * float(np.median(off[keep])), 1e-6)
    return slope, offset


def fit_spherical(points: FloatArray) -> GridFit | None:
    """Fit a turning scanner to sensor-frame points (rows, columns, 3), NaN where there is none.

    Each column has the median azimuth of its points, each row their median elevation; None with too few.
    Angles of rows and columns without points are interpolated or continued linearly, and both sequences
    are made strictly monotonic.
    """
    x, y, z = np.moveaxis(points, -1, 0)
    across = np.hypot(x, z)
    usable: BoolArray = np.isfinite(points).all(axis=-1) & (np.hypot(across, y) > 0)
    if usable.any(axis=0).sum() < 2 or usable.any(axis=1).sum() < 2:
        return None
    elevation = np.where(usable, np.arctan2(-y, across), np.nan)
    level = usable & (np.abs(elevation) < np.radians(85))  # an azimuth means little near the poles
    azimuth = _median_azimuths(np.where(level, np.arctan2(x, z), np.nan))
    row_elevation = _median_by_row(elevation)
    if azimuth is None:
        return None
    azimuths, elevations = _monotonic(_filled(azimuth)), _monotonic(_filled(row_elevation))
    if np.ptp(azimuths) == 0 or np.ptp(elevations) == 0 or np.ptp(azimuths) >= 2 * np.pi + 1e-9:
        return None
    turn = np.where(level, np.arctan2(x, z), np.nan) - azimuths
    off_column = ((turn + np.pi) % (2 * np.pi) - np.pi) / np.median(np.abs(np.diff(azimuths)))
    off_row = (elevation - elevations[:, None]) / np.median(np.abs(np.diff(elevations)))
    off = np.hypot(off_column, off_row)[level]
    return GridFit(SphericalProjection(azimuths, elevations), float(np.median(off)))


def _median_by_row(angles: FloatArray) -> FloatArray:
    """Median of each row's finite angles, NaN for empty rows."""
    ordered = np.sort(angles, axis=1)  # NaN last
    count = np.isfinite(angles).sum(axis=1)
    index = np.arange(len(angles))
    low, high = ordered[index, np.maximum(count - 1, 0) // 2], ordered[index, count // 2 * (count > 0)]
    median: FloatArray = np.where(count % 2 == 1, low, (low + np.where(count > 0, high, np.nan)) / 2)
    return median


def _median_azimuths(azimuth: FloatArray) -> FloatArray | None:
    """Median azimuth of each column, unwrapped along the columns; NaN for empty ones."""
    with np.errstate(invalid="ignore"):
        east, north = np.nansum(np.sin(azimuth), axis=0), np.nansum(np.cos(azimuth), axis=0)
    filled = np.isfinite(azimuth).any(axis=0)
    if filled.sum() < 2:
        return None
    middle = np.where(filled, np.arctan2(east, north), np.nan)
    offset = (azimuth - middle + np.pi) % (2 * np.pi) - np.pi
    medians = middle + _median_by_row(offset.T)
    medians[filled] = np.unwrap(medians[filled])
    return medians


def _filled(angles: FloatArray) -> FloatArray:
    """Fill NaN linearly between its neighbours, and beyond the ends with the median step."""
    index = np.arange(len(angles), dtype=np.float64)
    known = np.isfinite(angles)
    at, value = index[known], angles[known]
    if len(at) < 2:
        return np.full(len(angles), value[0] if len(at) else 0.0)
    step = float(np.median(np.diff(value) / np.diff(at)))
    filled = np.interp(index, at, value)
    filled[index < at[0]] = value[0] + (index[index < at[0]] - at[0]) * step
    filled[index > at[-1]] = value[-1] + (index[index > at[-1]] - at[-1]) * step
    return filled


def _monotonic(angles: FloatArray) -> FloatArray:
    """Return the nearest strictly monotonic sequence in the direction the angles run."""
    step = float(np.median(np.diff(angles))) if len(angles) > 1 else 0.0
    sign = -1.0 if step < 0 else 1.0
    if len(angles) > 1 and not (np.diff(angles) * sign > 0).all():
        rising = np.asarray(scipy.optimize.isotonic_regression(sign * angles).x)
        angles = sign * (rising + np.arange(len(angles)) * max(abs(step), 1e-9) * 1e-3)
    return angles


def organised_scan(
    points: FloatArray,
    projection: Projection,
    world_from_sensor: Pose,
    colour: Any,
    name: str,
    intensity: Any = None,
) -> RangeImage:
    """Return the scan of sensor-frame points (rows, columns, 3), metres, NaN where nothing came back.

    The measured points are kept (`sensor_points`) unless every one lies within 1e-6 m, at 1 m and in
    proportion beyond, of the projection's ray.
    """
    scan = RangeImage.from_points(points, projection, world_from_sensor, colour, name)
    if intensity is not None:
        scan = replace(scan, intensity=np.where(scan.valid, intensity, 0))
    ideal = np.where(scan.valid, scan.ranges, np.nan)[..., None] * projection.directions()
    off = np.linalg.norm(ideal - points, axis=-1)[scan.valid]
    if (off <= _ON_RAY_M * np.maximum(1.0, scan.ranges[scan.valid])).all():
        return replace(scan, sensor_points=None)
    return scan
