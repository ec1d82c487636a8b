# SPDX-License-Identifier: MIT
"""Range image: an organised scan, with the geometry of its pixels and the pose it was taken from.

Saturated ranges, which only say that an instrument's number was full, are taken as no return.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenes.card import Card
from scenes.checks import BoolArray, FloatArray, InputError, Value, check_options
from scenes.limits import CODE_CLOSE, CODE_GAP, CODE_SAME, CODE_SPREAD, CODE_STRAYS, LEAST_TIMES, MOST_CODES
from scenes.pose import Pose
from scenes.run.libraries import open3d_cloud
from scenes.run.mapping import release
from scenes.scan.colour import colour_type, unit_colour
from scenes.scan.echoes import Echoes
from scenes.scan.pixels import (
    check_same,
    checked_colour,
    finite_points,
    frozen_pixels,
    is_beside,
    is_return,
    mend_pixels,
    points_type,
    ranges_of,
    row_blocks,
)
from scenes.scan.projection import Projection

TRUTH_CHANNELS = {
    "face": np.int32, "surface": np.int32, "ranges": np.float64, "incidence": np.float64, "n_rays": np.uint8
}  # fmt: skip
_FACTS = ("world_from_sensor", "sigma_m", "sensor", "noise", "name", "step_m", "echoes")


MESH_SENSOR = "cast at a mesh"
"""What `RangeImage.sensor` says of a scan that nobody took: it was cast at a mesh."""
POINTS_SENSOR = "points projected to a spherical image"
"""How the same begins of points that lost their grid, from the place where the scanner stood."""


@dataclass(frozen=True, slots=True, eq=False)
class ScanTruth(Value):
    """What a simulated scan really met, pixel by pixel.

    Attributes
    ----------
    face, surface : (rows, columns) int32
        Face index and surface id in the scene, -1 where the ray met nothing.
    ranges : (rows, columns) float
        Distance without noise, metres, inf where the ray met nothing.
    incidence : (rows, columns) float
        Angle between ray and surface normal, radians; NaN where the ray met nothing.
    n_rays : (rows, columns) uint8, optional
        How many rays of the beam make the echo that was reported: 1 for a beam without width, 0 where there
        is none; not known for scans of older files.

    All but `n_rays` belong to the ray in the middle of the pixel.
    """

    face: NDArray[np.int32]
    surface: NDArray[np.int32]
    ranges: FloatArray
    incidence: FloatArray
    n_rays: NDArray[np.uint8] | None = None

    def __post_init__(self) -> None:
        for name, dtype in TRUTH_CHANNELS.items():
            array = getattr(self, name)
            if array is None:
                continue
            if np.shape(array) != np.shape(self.ranges):
                raise InputError(
                    f"truth of {name} has shape {np.shape(array)}, of ranges {np.shape(self.ranges)}"
                )
            object.__setattr__(self, name, frozen_pixels(array, dtype))

    def __reduce__(self) -> tuple[type[ScanTruth], tuple[Any, ...]]:
        """Pickle the fields, from which the truth is made again: large arrays are mapped there too."""
        return ScanTruth, tuple(getattr(self, field.name) for field in fields(self))


@dataclass(frozen=True, slots=True, eq=False)
class RangeImage(Value):
    """One organised scan.

    Parameters
    ----------
    ranges : (rows, columns) float
        Distance along each pixel's ray, metres; inf where nothing came back. So do NaN, 0 and less,
        and what lies beyond 1e9 m: numbers that files write for no return.
    projection : Projection
        Pinhole or spherical geometry of the pixels.
    world_from_sensor : Pose
        Where the sensor stood.
    colour : (rows, columns, 3), optional
        sRGB: given as uint8, 0..255, it is kept so, in a quarter of the memory; else float32 in 0..1, which
        where nothing came back may be anything, and becomes black where it is not finite. `unit_colour` and
        `colour_bytes` of `scenes.scan.colour` give either of both.
    sensor_points : (rows, columns, 3) float, optional
        Measured points in the sensor frame where they do not lie exactly on the projection's rays (real
        terrestrial scans); NaN where nothing came back. A pixel without both has no return. What is given
        as float32, as many files have it, is kept so, in half the memory.
    sigma_m : float, optional
        Known standard deviation of the range noise in metres; None when unknown, 0 when noise-free.
    sensor : str
        Name of the instrument, "" when not known.
    noise : str
        The effects that were active in a simulated scan, with their parameters; "" when not known.
    intensity : (rows, columns) float32, optional
        Light that came back, on the instrument's scale; 0 where nothing did.
    truth : ScanTruth, optional
        What a simulated scan really met.
    name : str
        What to call the scan in reports.
    warnings : tuple of str
        What was left out or assumed while it was read.
    step_m : float
        Between the values that coordinates of points could take in the file, metres; 0 where unknown or not
        rounded.
    echoes : Echoes, optional
        Further returns of the beams, whose first ones are `ranges`, where an instrument tells several apart;
        those of pixels without a return are left out.

    Arrays of more than half a million pixels are in a temporary file without a name, which memory holds only
    as far as it is in use (`scenes.run.mapping`); `release` ends the use.

    Raises
    ------
    InputError
        Arrays that do not have the projection's shape, a sigma that is negative or not finite, colours of
        returns that are not finite or beyond 0..1, intensities that are not finite, measured points that are
        not as far away as the ranges say.
    """

    ranges: FloatArray
    projection: Projection
    world_from_sensor: Pose
    colour: NDArray[np.float32] | NDArray[np.uint8] | None = None
    sensor_points: NDArray[np.float64] | NDArray[np.float32] | None = None
    sigma_m: float | None = None
    sensor: str = ""
    noise: str = ""
    intensity: NDArray[np.float32] | None = None
    truth: ScanTruth | None = None
    name: str = "scan"
    warnings: tuple[str, ...] = ()
    step_m: float = 0.0
    echoes: Echoes | None = None

    def __post_init__(self) -> None:
        single = np.shape(self.ranges)
        check_options(self, sigma_m=(0.0, np.inf), step_m=(0.0, np.inf))
        if single != self.projection.shape:
            raise InputError(f"ranges have shape {single}, the projection {self.projection.shape}")
        if self.truth is not None and self.truth.ranges.shape != single:
            raise InputError(f"truth has shape {self.truth.ranges.shape}, expected {single}")
        threefold = (*single, 3)
        for name, dtype, shape in (
            ("colour", colour_type(self.colour), threefold),
            ("sensor_points", points_type(self.sensor_points), threefold),
            ("intensity", np.float32, single),
        ):
            array = getattr(self, name)
            if array is None:
                continue
            if np.shape(array) != shape:
                raise InputError(f"{name} has shape {np.shape(array)}, expected {shape}")
            with np.errstate(over="ignore"):
                object.__setattr__(self, name, frozen_pixels(array, dtype))
        points = self.sensor_points
        ranges = mend_pixels(self.ranges, np.float64, self._without_return, np.inf, points)
        object.__setattr__(self, "ranges", ranges)
        if self.intensity is not None and any(
            (np.isfinite(ranges[rows]) & ~np.isfinite(self.intensity[rows])).any()
            for rows in row_blocks(single, ranges, self.intensity)
        ):
            raise InputError("intensities of returns are not finite; leave them out")
        if points is not None:
            check_same(ranges, points)
            known = mend_pixels(
                points, points.dtype, lambda rows, held: is_beside(ranges[rows], held), np.nan, ranges
            )
            object.__setattr__(self, "sensor_points", known)
        if self.colour is not None:
            object.__setattr__(self, "colour", checked_colour(self.colour, ranges))
        if self.echoes is not None:
            object.__setattr__(self, "echoes", self.echoes.within(self.valid))
        self.release()

    def __reduce__(self) -> tuple[type[RangeImage], tuple[Any, ...]]:
        """Pickle the fields, from which the scan is made again: large arrays are mapped there too."""
        return RangeImage, tuple(getattr(self, field.name) for field in fields(self))

    def _without_return(self, rows: slice, ranges: FloatArray) -> BoolArray:
        """Tell which pixels of some rows brought nothing back but have a number for it."""
        known = is_return(ranges)
        if self.sensor_points is not None:
            known &= finite_points(self.sensor_points[rows])
        return np.asarray(~known & (ranges != np.inf), dtype=np.bool_)

    @classmethod
    def from_points(
        cls,
        points: FloatArray,
        projection: Projection,
        world_from_sensor: Pose,
        colour: NDArray[np.float32] | NDArray[np.uint8] | None = None,
        name: str = "scan",
    ) -> RangeImage:
        """Return the scan of sensor-frame points (rows, columns, 3); not finite = nothing came back."""
        away = ranges_of(points)
        return cls(away, projection, world_from_sensor, colour=colour, sensor_points=points, name=name)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.projection.shape

    @property
    def valid(self) -> BoolArray:
        """Where something came back, shape (rows, columns)."""
        return np.isfinite(self.ranges)

    @property
    def origin(self) -> FloatArray:
        """Where the sensor stood, world coordinates, shape (3,)."""
        return self.world_from_sensor.translation

    def points_in_sensor(self) -> FloatArray:
        """Measured points (rows, columns, 3) in the sensor frame, NaN where nothing came back."""
        if self.sensor_points is not None:
            return np.asarray(self.sensor_points, dtype=np.float64)
        return self.projection.ray_grid().points(np.eye(3), np.zeros(3), self.ranges)

    def points(self) -> FloatArray:
        """Measured points (rows, columns, 3) in world coordinates, NaN where nothing came back."""
        pose = self.world_from_sensor
        if self.sensor_points is not None:
            return pose.apply(self.points_in_sensor())
        return self.projection.ray_grid().points(pose.rotation, pose.translation, self.ranges)

    def true_points(self) -> FloatArray:
        """What the pixels' middle rays really met (rows, columns, 3), world coordinates, NaN for nothing.

        Raises
        ------
        InputError
            A scan without truth.
        """
        pose = self.world_from_sensor
        return self.projection.ray_grid().points(pose.rotation, pose.translation, self._truth().ranges)

    def range_error(self) -> FloatArray:
        """Measured minus true range (rows, columns), metres, NaN where either is missing.

        Raises
        ------
        InputError
            A scan without truth.
        """
        known = self.valid & np.isfinite(self._truth().ranges)
        error = np.full(self.shape, np.nan)
        error[known] = self.ranges[known] - self._truth().ranges[known]
        return error

    def _truth(self) -> ScanTruth:
        if self.truth is None:
            raise InputError(f"{self.name}: has no truth; only simulated scans have")
        return self.truth

    def rays(self) -> FloatArray:
        """Unit viewing rays (rows, columns, 3), world frame, through the measured points where known."""
        rays = self.projection.directions()
        if self.sensor_points is not None:
            measured = self.sensor_points / np.where(self.valid, self.ranges, 1.0)[..., None]
            rays = np.where(self.valid[..., None], measured, rays)
        return self.world_from_sensor.rotate(rays)

    def pixels(self, points: FloatArray) -> FloatArray:
        """Row and column (n, 2) that see world `points` (n, 3); NaN outside the field of view."""
        return self.projection.pixels(self.world_from_sensor.inverse().apply(points))

    def echo_points(self) -> FloatArray:
        """Measured points (m, 3) of `echoes` in world coordinates; none without."""
        if self.echoes is None:
            return np.zeros((0, 3))
        pixel, first = self.echoes.pixel, self.points_in_sensor().reshape(-1, 3)
        stretch = self.echoes.ranges / self.ranges.reshape(-1)[pixel]
        return self.world_from_sensor.apply(first[pixel] * stretch[:, None])

    def transform(self, pose: Pose) -> RangeImage:
        """Return the same scan in a world moved by `pose`."""
        return self.with_facts(world_from_sensor=pose @ self.world_from_sensor)

    transformed = transform  # earlier name

    def with_facts(self, **facts: Any) -> RangeImage:
        """Return the scan with other `facts`: pose, sigma, sensor, noise, name, step, echoes.

        The pixels are the same arrays, not checked again, which `dataclasses.replace` would do.

        Raises
        ------
        InputError
            A sigma or step that is negative or not finite.
        """
        unknown = set(facts) - set(_FACTS)
        if unknown:
            raise TypeError(f"{', '.join(sorted(unknown))}: only {', '.join(_FACTS)} can be restated")
        scan = self._changed(facts)
        check_options(scan, sigma_m=(0.0, np.inf), step_m=(0.0, np.inf))
        return scan

    def add_warnings(self, texts: Iterable[str]) -> RangeImage:
        """Return the scan with further warnings after its own; the pixels are the same arrays."""
        return self._changed({"warnings": (*self.warnings, *texts)})

    def _changed(self, values: Mapping[str, Any]) -> RangeImage:
        """The scan with other values of some fields, none of which is checked."""
        scan = object.__new__(RangeImage)
        for field in fields(self):
            object.__setattr__(scan, field.name, values.get(field.name, getattr(self, field.name)))
        return scan

    restated = with_facts  # earlier name

    def thin(self, n_most: int) -> RangeImage:
        """Return the scan with every k-th row and column, so that at most about `n_most` pixels are left.

        Its noise and its name stay; truth and echoes are left out.
        """
        step = int(np.ceil(np.sqrt(self.ranges.size / n_most)))
        if step <= 1:
            return self
        few = (slice(None, None, step),) * 2
        return replace(
            self,
            ranges=self.ranges[few],
            projection=self.projection.every(step),
            colour=None if self.colour is None else self.colour[few],
            sensor_points=None if self.sensor_points is None else self.sensor_points[few],
            intensity=None if self.intensity is None else self.intensity[few],
            truth=None,
            echoes=None,
        )

    thinned = thin  # earlier name

    def to_open3d(self) -> Any:
        """Return its points as an `open3d.geometry.PointCloud`; raises InputError without Open3D."""
        colour = None if self.colour is None else unit_colour(self.colour[self.valid])
        return open3d_cloud(self.points()[self.valid], colour)

    def release(self) -> None:
        """Let the system take back what memory holds of a large scan's pixels; they stay as they are."""
        truth = [] if self.truth is None else [getattr(self.truth, name) for name in TRUTH_CHANNELS]
        release(self.ranges, self.colour, self.sensor_points, self.intensity, *truth)

    def _facts(self) -> list[tuple[str, str]]:
        """What it is called, how it lies, and what came back."""
        from scenes.scan.thumbnail import field_of_view  # only shown scans need it and the pictures

        known, (rows, columns), (x, y, z) = self.ranges[self.valid], self.shape, self.origin
        share = f"{100 * known.size / self.ranges.size:.1f} %"
        noise = "not known" if self.sigma_m is None else "none"
        figures = [
            ("name", self.name),
            ("pixels", f"{rows} rows, {columns} columns; {field_of_view(self.projection)}"),
            ("returns", f"{known.size} of {self.ranges.size} ({share})"),
            ("range", f"{known.min():.3f} to {known.max():.3f} m" if known.size else "nothing came back"),
            ("sensor stands at", f"{x:.3f}, {y:.3f}, {z:.3f} m"),
            ("range noise", f"sd {1000 * self.sigma_m:.3g} mm" if self.sigma_m else noise),
        ]
        figures += [("further returns", str(len(self.echoes)))] if self.echoes is not None else []
        figures += [("sensor", self.sensor)] if self.sensor else []
        figures += [("effects", self.noise)] if self.noise else []
        figures += [("truth", "known: simulated")] if self.truth is not None else []
        return figures

    def _repr_html_(self) -> str:
        """What a notebook shows: figures and a small picture."""
        from scenes.scan.thumbnail import thumbnails

        pictures = thumbnails(self.ranges, self.colour, self.projection)
        return Card("Range image", self.name, self._facts()[1:], pictures=pictures).to_html()


def saturation_start(ranges: FloatArray) -> float:
    """Return the least of the saturated among the finite numbers of an image (rows, columns), or of (n,).

    It is inf where there is none. They are the largest, at most eight different ones within 0.1 % of the
    largest, each there 20 times or more; most ranges are nearer than them by a sixth, with a twentieth as
    many strays in between.
    """
    n_known, most = 0, 0.0
    for known in _finite(ranges):
        n_known, most = n_known + len(known), max(most, float(known.max(initial=0.0)))
    if n_known < LEAST_TIMES:
        return np.inf
    n_far, tops = 0, []
    for known in _finite(ranges):
        far = known[known >= most / CODE_GAP]
        n_far += len(far)
        tops.append(far[far >= (1 - CODE_CLOSE) * most])
    top = np.sort(np.concatenate(tops))
    if not LEAST_TIMES <= len(top) < n_known / 2 or n_far - len(top) > CODE_STRAYS * len(top):
        return np.inf
    group = np.concatenate([[0], np.cumsum(np.diff(top) > CODE_SAME * most)])
    times = np.bincount(group)
    if len(times) > MOST_CODES or times.min() < LEAST_TIMES:
        return np.inf
    return float(top[0])


def _finite(ranges: FloatArray) -> Iterator[FloatArray]:
    """The finite ranges, some at a time."""
    column = ranges.reshape(-1, 1)
    for rows in row_blocks(column.shape, column):
        yield column[rows][np.isfinite(column[rows])]


def saturation_warning(n_saturated: int, start: float, n_ranges: int) -> str:
    """Say how many ranges were left out as saturated; `start` is the least of them, in the file's unit."""
    return (
        f"{n_saturated} of {n_ranges} ranges are {start:.7g} or hardly more, over and over and far beyond "
        "all others: numbers for no return, and left out"
    )


def without_saturated(scan: RangeImage) -> RangeImage:
    """Return the scan with saturated ranges as no return, counted in its warnings."""
    start = saturation_start(scan.ranges)
    if start == np.inf:
        return scan
    full = scan.valid & (scan.ranges >= start)
    if min(np.count_nonzero(full.any(axis=k)) for k in (0, 1)) < CODE_SPREAD:
        return scan
    sentence = saturation_warning(int(full.sum()), start, int(scan.valid.sum()))
    points = scan.sensor_points

    def is_full(rows: slice, _held: FloatArray) -> BoolArray:
        return full[rows]

    return replace(
        scan,
        ranges=mend_pixels(scan.ranges, scan.ranges.dtype, is_full, np.inf),
        sensor_points=None if points is None else mend_pixels(points, points.dtype, is_full, np.nan),
        warnings=(*scan.warnings, sentence),
    )
