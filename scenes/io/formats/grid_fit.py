# SPDX-License-Identifier: MIT
"""Grid fitting: which pinhole or spherical geometry an organised set of measured points has."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy  # its parts load when they are first used

from scenes.checks import BoolArray, FloatArray, InputError, IntArray
from scenes.io.formats.grid_order import in_other_order, own_pixel_distance
from scenes.limits import BETTER, ON_RAY_M, PINHOLE_LIMIT_PX, SPHERICAL_LIMIT_PX, STEEP
from scenes.pose import Pose
from scenes.scan.pixels import crop_pixels, finite_points, mend_pixels, move_points, ranges_of, row_blocks
from scenes.scan.projection import PinholeProjection, Projection, SphericalProjection
from scenes.scan.range_image import RangeImage

# A terrestrial scanner's own frame is z up, y to the left of x: sensor z = x, sensor x = -y, sensor y = -z.
SCANNER_FROM_SENSOR = Pose(np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]]))
_AXES = {
    "": Pose.identity(),
    "the camera axes of OpenGL, ARKit and Blender (x right, y up, z backwards)": Pose(
        np.diag([1.0, -1.0, -1.0, 1.0])
    ),
    "the axes of vehicles (x forward, y left, z up)": SCANNER_FROM_SENSOR,
}
_MOST_JUDGED = 4_000_000  # pixels whose distances tell how well a grid fits: of more every k-th row is taken
_MOST_FACED = 400_000  # pixels, in every k-th column, that tell which side of a pole rows are on
_FEWEST_BEYOND = 0.01  # share of the points that is beyond a pole where rows pass it
_OPPOSITE = 0.9  # share of a row's points, and of columns, that agree where rows pass over a pole
_FOREIGN_PX = 3.0  # from their own pixels: points that are not in order
_GATHERED = 1 << 20  # pixels of columns that are looked at together


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


@dataclass(frozen=True, slots=True, eq=False)
class AxesFit:
    """A projection estimated from points whose sensor may have other axes than ours.

    Attributes
    ----------
    projection : Projection
        Pinhole or spherical.
    points : (rows, columns, 3) float
        In our sensor frame: x right, y down, z forward.
    theirs_from_ours : Pose
        The rotation from our sensor frame to that of the file.
    axes : str
        Whose axes the file's sensor frame has, "" for ours.
    """

    projection: Projection
    points: FloatArray
    theirs_from_ours: Pose
    axes: str


def fit_axes(points: FloatArray, viewpoint: Pose) -> AxesFit:
    """Estimate the projection of organised points (rows, columns, 3), and which axes their sensor has.

    Points are in the sensor's frame, or in the world, where the sensor stands at `viewpoint`. The sensor's
    axes are ours, OpenGL's or a vehicle's: others than ours count where ours explain nothing, or where a
    pinhole fits at least twice as well.

    Raises InputError: nothing explains the points, or there are too few of them.
    """
    starts = [Pose.identity(), viewpoint][: 1 if np.allclose(viewpoint.matrix, np.eye(4)) else 2]
    best: AxesFit | None = None
    residual, causes = np.inf, list[InputError]()
    for axes, turn in _AXES.items():
        for number, start in enumerate(starts):
            place = (start @ turn).inverse()
            moved = move_points(points, place) if axes or number else points
            try:
                fit = fit_grid(moved) if best is None else fit_pinhole(moved)
            except InputError as error:
                causes.append(error)
                continue
            if fit is None or (best is not None and fit.residual_px * BETTER > residual):
                continue
            best, residual = AxesFit(fit.projection, moved, turn, axes), fit.residual_px
            if fit.projection.kind == "pinhole":
                return best
    if best is None:
        raise InputError(f"{causes[0]} (tried too: {', '.join(filter(None, _AXES))})")
    return best


def fit_pinhole(points: FloatArray) -> GridFit | None:
    """Fit a pinhole to sensor-frame points (rows, columns, 3), NaN where there is none.

    Column = fx x/z + cx and row = fy y/z + cy are fitted robustly; None where that cannot be determined.
    """
    ahead, n_valid = np.zeros(points.shape[:2], np.bool_), 0
    for rows in row_blocks(points.shape, points):
        valid = finite_points(points[rows])
        ahead[rows] = valid & (points[rows][..., 2] > 0)
        n_valid += int(np.count_nonzero(valid))
    if ahead.sum() < 3 or ahead.sum() < 0.9 * n_valid:
        return None
    row, column = np.nonzero(ahead)
    if np.ptp(row) == 0 or np.ptp(column) == 0:
        return None
    x, y, z = np.asarray(points[ahead], np.float64).T
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
    are made strictly monotonic. Columns after a full turn are no part of the projection.
    """
    usable = _usable(points)
    if usable.any(axis=0).sum() < 2 or usable.any(axis=1).sum() < 2:
        return None
    row_elevation = np.full(len(points), np.nan)
    for rows in row_blocks(points.shape, points):
        row_elevation[rows] = _medians(_elevation(points[rows]), usable[rows])
    azimuth = _median_azimuths(points, usable)
    if azimuth is None:
        return None
    azimuths, elevations = _monotonic(_fill_gaps(azimuth)), _monotonic(_fill_gaps(row_elevation))
    if np.ptp(azimuths) == 0 or np.ptp(elevations) == 0:
        return None
    wide, high = (np.median(np.abs(np.diff(angles))) for angles in (azimuths, elevations))
    azimuths = azimuths[np.abs(azimuths - azimuths[0]) < 2 * np.pi - wide / 2]
    points, usable = points[:, : len(azimuths)], usable[:, : len(azimuths)]
    poles = [np.empty(0)]
    step = -(-usable.size // _MOST_JUDGED)
    for rows in row_blocks(points.shape, points):
        stretch = slice(rows.start + -rows.start % step, rows.stop, step)
        elevation = _elevation(points[stretch])
        off_column = _turn(_azimuth(points[stretch]) - azimuths) / wide
        off_row = (elevation - elevations[stretch, None]) / high
        poles.append(np.hypot(off_column, off_row)[_level(elevation, usable[stretch])])
    off = np.concatenate(poles)
    if not len(off):
        return None
    return GridFit(SphericalProjection(azimuths, elevations), float(np.median(off, overwrite_input=True)))


def _usable(points: FloatArray) -> BoolArray:
    """Tell which points (rows, columns, 3) have a direction."""
    usable = np.empty(points.shape[:2], np.bool_)
    for rows in row_blocks(points.shape, points):
        away = points[rows] != 0
        usable[rows] = finite_points(points[rows]) & (away[..., 0] | away[..., 1] | away[..., 2])
    return usable


def _elevation(points: FloatArray) -> FloatArray:
    x, y, z = np.moveaxis(np.asarray(points, np.float64), -1, 0)
    return np.asarray(np.arctan2(-y, np.hypot(x, z)))


def _azimuth(points: FloatArray) -> FloatArray:
    x, _, z = np.moveaxis(np.asarray(points, np.float64), -1, 0)
    return np.asarray(np.arctan2(x, z))


def _turn(angles: FloatArray) -> FloatArray:
    """The same angles within -pi..pi."""
    return (angles + np.pi) % (2 * np.pi) - np.pi


def _level(elevation: FloatArray, usable: BoolArray) -> BoolArray:
    """Tell which points have an azimuth."""
    return np.asarray(usable & (np.abs(elevation) < STEEP), dtype=np.bool_)


def _medians(angles: FloatArray, known: BoolArray) -> FloatArray:
    """Median of each row's known angles, NaN for rows without."""
    pairs = zip(angles, known, strict=True)
    return np.array([np.median(row[use]) if use.any() else np.nan for row, use in pairs])


def _median_azimuths(points: FloatArray, usable: BoolArray) -> FloatArray | None:
    """Median azimuth of each column, unwrapped along the columns; NaN for empty ones."""
    medians = np.full(points.shape[1], np.nan)
    step = max(_GATHERED // len(points), 1)
    for start in range(0, points.shape[1], step):
        columns = slice(start, start + step)
        part = _of_columns(points, columns)
        level, azimuth = _level(_elevation(part), usable[:, columns]), _azimuth(part)
        with np.errstate(invalid="ignore"):
            east, north = (np.where(level, f(azimuth), 0.0).sum(axis=0) for f in (np.sin, np.cos))
        middle = np.arctan2(east, north)
        medians[columns] = middle + _medians(_turn(azimuth - middle).T, level.T)
    filled = np.isfinite(medians)
    if filled.sum() < 2:
        return None
    medians[filled] = np.unwrap(medians[filled])
    return medians


def _of_columns(points: FloatArray, columns: slice) -> FloatArray:
    """A copy of some columns of points, no more of which than a few rows are in memory meanwhile."""
    part = np.empty((len(points), *points[:1, columns].shape[1:]), points.dtype)
    for rows in row_blocks(points.shape, points):
        part[rows] = points[rows, columns]
    return part


def _fill_gaps(angles: FloatArray) -> FloatArray:
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


def fitted_scan(
    points: FloatArray,
    world_from_sensor: Pose,
    colour: Any,
    name: str,
    intensity: Any = None,
    file_from_sensor: Pose = SCANNER_FROM_SENSOR,
    known: Projection | None = None,
) -> RangeImage:
    """Return the scan of organised points (rows, columns, 3), metres, whose projection they tell.

    Points are in the sensor frame, NaN where nothing came back. Rows that a scanner measured beyond the
    zenith or nadir are put beside the others. Points that fit a projection only as world coordinates, or with
    rows and columns exchanged, are taken so. Columns after a full turn are left out. A warning tells each.

    Parameters
    ----------
    file_from_sensor : Pose
        What turns the points into the axes of the file, which are those of the world if it mixed them up.
    known : Projection, optional
        What was found to explain the points.

    Raises InputError: no projection explains the points, or there are too few of them.
    """
    warnings, images = list[str](), list[Any]([points, colour, intensity])
    projection, doubt = (known, "") if known else _try_fit(points)
    faces = _row_faces(points) if projection is None or projection.kind == "spherical" else None
    if faces is not None:
        pixels = _fold_faces(points, faces)
        images = [None if image is None else _take_pixels(image, pixels) for image in images]
        projection, doubt = _try_fit(images[0])
        warnings.append("its rows pass over the zenith or nadir: those beyond were put beside the others")
    elif projection is None:
        images[0] = move_points(points, world_from_sensor.inverse() @ file_from_sensor)
        projection, _ = _try_fit(images[0])
        warnings.append("its points fit a pixel grid only as world coordinates: they were taken as such")
    if projection is None or (known is None and own_pixel_distance(images[0], projection) > _FOREIGN_PX):
        found = in_other_order([points, colour, intensity], _try_fit)
        if found is not None:
            projection, images = found
            warnings = ["its rows and columns are not in the format's order: they were put in order"]
    if projection is None:
        raise InputError(doubt)
    n_columns = projection.shape[1]
    if n_more := images[0].shape[1] - n_columns:
        warnings.append(f"its columns go round more than once: the last {n_more} were left out")
    kept = slice(None), slice(n_columns)
    images = [None if image is None else crop_pixels(image, *kept) for image in images]
    scan = organised_scan(images[0], projection, world_from_sensor, images[1], name, intensity=images[2])
    return scan.add_warnings(warnings)


def _try_fit(points: FloatArray) -> tuple[Projection | None, str]:
    """The projection of points, or None and why there is none."""
    try:
        return fit_grid(points).projection, ""
    except InputError as error:
        return None, str(error)


def _row_faces(points: FloatArray) -> IntArray | None:
    """Number (rows,) of the side of the pole, 0 or 1, that rows of points (rows, columns, 3) are on.

    None where all are on one side. Where not, each column has two azimuths, opposite to each other.
    """
    step = -(-points.shape[0] * points.shape[1] // _MOST_FACED)
    blocks = row_blocks(points.shape, points)
    part = np.concatenate([np.asarray(points[rows, ::step], np.float64) for rows in blocks])
    level, azimuth = _level(_elevation(part), _usable(part)), _azimuth(part)
    doubled = np.where(level, np.exp(2j * np.where(level, azimuth, 0.0)), 0.0).sum(axis=0)
    n_level = level.sum(axis=0)
    known = np.abs(doubled) > _OPPOSITE * np.maximum(n_level, 1)
    if not n_level.any() or known.sum() < _OPPOSITE * np.count_nonzero(n_level):
        return None
    side = np.where(level, np.sign(np.cos(azimuth - np.angle(doubled) / 2)), 0.0)[:, known]
    side *= side[np.argmax(side != 0, axis=0), np.arange(side.shape[1])]  # as the column's first point
    n_seen = np.abs(side).sum(axis=1)
    share = side.sum(axis=1) / np.maximum(n_seen, 1)
    if min(n_seen[share > _OPPOSITE].sum(), n_seen[share < -_OPPOSITE].sum()) < _FEWEST_BEYOND * n_seen.sum():
        return None
    seen = np.flatnonzero(n_seen)
    return np.asarray(np.interp(np.arange(len(share)), seen, share[seen]) < 0, dtype=np.int64)


def _fold_faces(points: FloatArray, faces: IntArray) -> IntArray:
    """Flat pixels (rows, twice the columns), -1 for none, that put both faces' rows beside each other."""
    pixels = np.arange(points.shape[0] * points.shape[1]).reshape(points.shape[:2])
    elevation = _medians(_elevation(points), _usable(points))
    angles = [_fill_gaps(elevation[faces == face]) for face in (0, 1)]
    step = np.median(np.abs(np.concatenate([np.diff(angle) for angle in angles])))
    top = max(angle.max() for angle in angles)
    places = [round((top - angle.max()) / step) + np.argsort(np.argsort(-angle)) for angle in angles]
    folded = np.full((max(place.max() for place in places) + 1, 2 * points.shape[1]), -1)
    for face, (place, side) in enumerate(zip(places, np.hsplit(folded, 2), strict=True)):
        side[place] = pixels[faces == face]
    return folded


def _take_pixels(image: Any, pixels: IntArray) -> Any:
    """The pixels (rows, columns, ...) of an image by flat numbers, empty where these are -1; read-only."""
    taken = image.reshape(-1, *image.shape[2:])[pixels]
    taken[pixels < 0] = np.nan if image.ndim == 3 and image.dtype.kind == "f" else 0
    taken.setflags(write=False)
    return taken


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
    proportion beyond, of the projection's ray. Arrays that are read-only are kept, not copied.

    Raises InputError: a projection of another shape.
    """
    if points.shape[:2] != projection.shape:
        raise InputError(f"points have shape {points.shape}, the projection {projection.shape}")
    ranges = ranges_of(points)
    if intensity is not None:
        intensity = mend_pixels(
            intensity, np.float32, lambda rows, held: (held != 0) & ~np.isfinite(ranges[rows]), 0, ranges
        )
    return RangeImage(
        ranges,
        projection,
        world_from_sensor,
        colour=colour,
        sensor_points=None if _are_on_rays(points, ranges, projection) else points,
        intensity=intensity,
        name=name,
    )


def _are_on_rays(points: FloatArray, ranges: FloatArray, projection: Projection) -> bool:
    """Tell whether all returns lie on the rays of their pixels."""
    rays = projection.ray_grid()
    return all(
        lie_on_rays(points[rows], ranges[rows], rays.of_rows(rows).directions(np.eye(3)))
        for rows in row_blocks(ranges.shape, points, ranges)
    )


def lie_on_rays(points: FloatArray, ranges: FloatArray, rays: FloatArray) -> bool:
    """Tell whether points (..., 3) at `ranges` lie on unit rays (..., 3), so that ranges alone say all."""
    valid = np.isfinite(ranges)
    off = np.linalg.norm(np.where(valid, ranges, 0.0)[..., None] * rays - points, axis=-1)
    return bool((off <= ON_RAY_M * np.maximum(1.0, ranges))[valid].all())
