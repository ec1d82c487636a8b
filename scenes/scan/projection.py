# SPDX-License-Identifier: MIT
"""Projections: which ray each pixel of an organised scan looks along, and which pixel sees a point."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Protocol, runtime_checkable

import numpy as np

from scenes.checks import FloatArray, InputError, Value, frozen_copy

if TYPE_CHECKING:
    from scenes.scan.ray_grid import RayGrid

_LEAST_FOCAL_PX, _MOST_PX = 1e-3, 1e9  # no camera is beyond; their rays would no longer be told apart


@runtime_checkable
class Projection(Protocol):
    """The geometry of an organised image; sensor frame x right, y down, z forward."""

    kind: ClassVar[str]

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""

    @property
    def pixel_angle(self) -> float:
        """Typical angle between neighbouring pixels, radians."""

    def ray_grid(self) -> RayGrid:
        """The pixels' rays in the sensor frame, ready to be turned."""

    def directions(self) -> FloatArray:
        """Unit rays (rows, columns, 3) in the sensor frame."""

    def pixels(self, points: FloatArray) -> FloatArray:
        """Row and column (n, 2) that see sensor-frame `points` (n, 3); NaN outside the field of view."""

    def every(self, step: int) -> Projection:
        """The geometry of every so many-th row and column, the first ones included."""


def _mark_outside(pixels: FloatArray, shape: tuple[int, int]) -> FloatArray:
    """Set rows of `pixels` that are more than half a pixel outside the image to NaN."""
    with np.errstate(invalid="ignore"):
        row, column = pixels.T
        inside = (row >= -0.5) & (row < shape[0] - 0.5) & (column >= -0.5) & (column < shape[1] - 0.5)
    pixels[~inside] = np.nan
    return pixels


@dataclass(frozen=True, slots=True)
class PinholeProjection(Value):
    """A pinhole camera: column = fx x / z + cx, row = fy y / z + cy; a negative fy is used as given.

    Parameters
    ----------
    width, height : int
        Columns and rows.
    fx, fy : float
        Focal lengths, pixels.
    cx, cy : float
        Principal point, pixels; the centre of the first pixel is at (0, 0).

    Raises
    ------
    InputError
        Fewer than one pixel, focal lengths or a principal point that no camera has: 0, huge, not finite.

    Examples
    --------
    >>> camera = PinholeProjection(640, 480, 525.0, 525.0, 319.5, 239.5)
    >>> camera.pixels(np.array([[0.0, 0.0, 2.0], [0.0, 0.0, -2.0]])).tolist()
    [[239.5, 319.5], [nan, nan]]
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float

    kind: ClassVar[str] = "pinhole"

    def __post_init__(self) -> None:
        if self.width < 1 or self.height < 1:
            raise InputError(f"an image needs at least one pixel, got {self.width} x {self.height}")
        numbers = np.array([self.fx, self.fy, self.cx, self.cy])
        sizes = np.abs(numbers)
        if not ((sizes <= _MOST_PX).all() and (sizes[:2] >= _LEAST_FOCAL_PX).all()):
            raise InputError(
                f"focal lengths must be in {_LEAST_FOCAL_PX:g}..{_MOST_PX:g} pixels, or be negative, and the "
                f"principal point within {_MOST_PX:g}, got fx, fy, cx, cy = {numbers.tolist()}"
            )

    @classmethod
    def from_fov(cls, width: int, height: int, fov_deg: float) -> PinholeProjection:
        """Return the centred camera with square pixels that sees `fov_deg` across its longer side."""
        if not 0 < fov_deg < 180:
            raise InputError(f"a pinhole's field of view must lie between 0 and 180 deg, got {fov_deg}")
        with np.errstate(over="ignore", divide="ignore"):
            focal = max(width, height) / 2 / np.tan(np.radians(fov_deg) / 2)
        return cls(width=width, height=height, fx=focal, fy=focal, cx=(width - 1) / 2, cy=(height - 1) / 2)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.height, self.width

    @property
    def pixel_angle(self) -> float:
        """Angle between neighbouring pixels at the image centre, radians."""
        return float(1.0 / min(abs(self.fx), abs(self.fy)))

    def ray_grid(self) -> RayGrid:
        """The pixels' rays."""
        from scenes.scan.ray_grid import RayGrid  # numba: imported when first needed

        right = (np.arange(self.width, dtype=np.float64) - self.cx) / self.fx
        down = (np.arange(self.height, dtype=np.float64) - self.cy) / self.fy
        return RayGrid(np.ones(self.height), down, right, np.ones(self.width))

    def directions(self) -> FloatArray:
        """Unit rays (rows, columns, 3)."""
        return self.ray_grid().directions(np.eye(3))

    def pixels(self, points: FloatArray) -> FloatArray:
        """Row and column (n, 2) of points; NaN outside the image or behind the camera."""
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            scale = np.where(points[:, 2] > 0, 1.0 / points[:, 2], np.nan)
            column = self.fx * points[:, 0] * scale + self.cx
            row = self.fy * points[:, 1] * scale + self.cy
        return _mark_outside(np.stack([row, column], axis=1), self.shape)

    def every(self, step: int) -> PinholeProjection:
        """Return the camera of every so many-th row and column, the first ones included."""
        width, height = -(-self.width // step), -(-self.height // step)
        focal, middle = (self.fx / step, self.fy / step), (self.cx / step, self.cy / step)
        return PinholeProjection(width, height, *focal, *middle)


@dataclass(frozen=True, slots=True, eq=False)
class SphericalProjection(Value):
    """A panoramic scanner: an azimuth for each column, an elevation for each row, radians.

    Azimuth is atan2(x, z), growing to the right; elevation is asin(-y), growing upwards. Both sequences
    must be strictly monotonic (either way) and azimuths may cross +-pi if unwrapped.

    Parameters
    ----------
    azimuths : (columns,) float
        Radians.
    elevations : (rows,) float
        Radians.

    Raises
    ------
    InputError
        Angles that are not finite or not monotonic, azimuths that span more than a turn.

    Examples
    --------
    >>> scanner = SphericalProjection.regular(360, 91, 360.0, (-45.0, 45.0))
    >>> scanner.pixels(np.array([[1.0, 0.0, 0.0]])).tolist()
    [[45.0, 269.5]]
    """

    azimuths: FloatArray
    elevations: FloatArray

    kind: ClassVar[str] = "spherical"

    def __post_init__(self) -> None:
        for name in ("azimuths", "elevations"):
            angles = np.asarray(getattr(self, name), dtype=np.float64)
            if angles.ndim != 1 or len(angles) == 0 or not np.isfinite(angles).all():
                raise InputError(f"expected finite {name} with shape (n,), got shape {angles.shape}")
            steps = np.diff(angles)
            if not ((steps > 0).all() or (steps < 0).all()):
                raise InputError(f"{name} must be strictly monotonic; unwrap them first")
            object.__setattr__(self, name, frozen_copy(angles))
        span = abs(float(self.azimuths[-1] - self.azimuths[0]))
        if span >= 2 * np.pi + 1e-9:
            raise InputError(f"azimuths span {np.degrees(span):.1f} deg; a scan covers at most 360")

    @classmethod
    def regular(
        cls, width: int, height: int, azimuth_span_deg: float, elevation_deg: tuple[float, float]
    ) -> SphericalProjection:
        """Return a regular grid about the z axis: pixel centres, rows from the highest elevation down.

        A span of 360 deg is divided into `width` columns without repeating the first.
        """
        if width < 1 or height < 1:
            raise InputError(f"an image needs at least one pixel, got {width} x {height}")
        step = azimuth_span_deg / width
        azimuths = (np.arange(width) - (width - 1) / 2) * step
        elevations = np.linspace(max(elevation_deg), min(elevation_deg), height)
        return cls(np.radians(azimuths), np.radians(elevations))

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return len(self.elevations), len(self.azimuths)

    @property
    def pixel_angle(self) -> float:
        """The larger of the median angles between rows and between columns, radians."""
        steps = [np.median(np.abs(np.diff(a))) for a in (self.azimuths, self.elevations) if len(a) > 1]
        return float(max(steps, default=np.pi))

    def ray_grid(self) -> RayGrid:
        """The pixels' rays."""
        from scenes.scan.ray_grid import RayGrid  # numba: imported when first needed

        up, around = self.elevations, self.azimuths
        return RayGrid(np.cos(up), -np.sin(up), np.sin(around), np.cos(around))

    def directions(self) -> FloatArray:
        """Unit rays (rows, columns, 3)."""
        return self.ray_grid().directions(np.eye(3))

    def pixels(self, points: FloatArray) -> FloatArray:
        """Row and column (n, 2) of points, interpolated between the grid's angles; NaN outside."""
        middle = (self.azimuths[0] + self.azimuths[-1]) / 2
        azimuth = np.arctan2(points[:, 0], points[:, 2]) - middle
        azimuth = middle + (azimuth + np.pi) % (2 * np.pi) - np.pi
        elevation = np.arctan2(-points[:, 1], np.hypot(points[:, 0], points[:, 2]))
        row = _index(self.elevations, elevation, self.pixel_angle)
        return np.stack([row, _index(self.azimuths, azimuth, self.pixel_angle)], axis=1)

    def every(self, step: int) -> SphericalProjection:
        """Return the scanner of every so many-th row and column, the first ones included."""
        return SphericalProjection(self.azimuths[::step], self.elevations[::step])


def _index(angles: FloatArray, wanted: FloatArray, only_step: float) -> FloatArray:
    """Fractional position of each wanted angle in a monotonic sequence, NaN beyond half a step outside.

    Within half a step outside it is the first or last position; a single angle has the step `only_step`.
    """
    n = len(angles)
    if n == 1:
        return np.where(np.abs(wanted - angles[0]) <= only_step / 2, 0.0, np.nan)
    order = slice(None) if angles[-1] > angles[0] else slice(None, None, -1)
    grid, position = angles[order], np.arange(n, dtype=np.float64)[order]
    slack = 1e-9  # radians; so that rounding opens no seam where a full turn closes
    first, last = (grid[1] - grid[0]) / 2 + slack, (grid[-1] - grid[-2]) / 2 + slack
    index = np.interp(wanted, grid, position)
    outside = (wanted < grid[0] - first) | (wanted > grid[-1] + last)
    return np.where(outside, np.nan, index)
