# SPDX-License-Identifier: MIT
"""Sensors: aperture, pixels, range limits and effects of a range scanner; a view is a sensor at a pose."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar, Literal, Protocol, runtime_checkable

import numpy as np

from nbv.scanning.effects import NO_EFFECTS, PROFILE, Effects, named_effects
from scenes.checks import BoolArray, FloatArray, InputError, Value, check_number
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection, Projection, SphericalProjection

Aperture = Literal["square", "circular"]


@runtime_checkable
class Sensor(Protocol):
    """A range sensor; its frame is x right, y down, z forward."""

    kind: ClassVar[str]

    @property
    def name(self) -> str:
        """What reports call it."""
        ...

    @property
    def min_range_m(self) -> float:
        """Nothing nearer comes back, metres."""
        ...

    @property
    def max_range_m(self) -> float:
        """Nothing farther comes back, metres."""
        ...

    @property
    def projection(self) -> Projection:
        """The geometry of its pixels."""
        ...

    @property
    def effects(self) -> Effects:
        """Errors of its scans, where they are asked for."""
        ...

    @property
    def scan_time_s(self) -> float | None:
        """How long a scan takes at least, seconds; None where the speed is not known."""
        ...

    @property
    def partner(self) -> Partner | None:
        """The second device of a triangulation; None for a sensor that measures along one path."""
        ...

    def sees(self, points: FloatArray) -> BoolArray:
        """Tell which sensor-frame points (n, 3) lie in the aperture, whatever their range."""
        ...

    def to_json(self) -> dict[str, Any]:
        """Return the profile as `nbv.scanning.sensor_profile` reads it."""
        ...


@dataclass(frozen=True, slots=True)
class Partner(Value):
    """The second device of a triangulation, which must see a point too; its axes are parallel.

    Attributes
    ----------
    position_m : tuple of float
        In the sensor frame, metres.
    slope : tuple of float
        Tangents of half its field of view across and down; inf where it sees whatever the sensor sees.
    """

    position_m: tuple[float, float, float]
    slope: tuple[float, float] = (np.inf, np.inf)

    def sees(self, points: FloatArray) -> BoolArray:
        """Tell which sensor-frame points (n, 3) lie in its field of view."""
        x, y, z = np.moveaxis(points - np.array(self.position_m), -1, 0)
        with np.errstate(invalid="ignore"):
            inside: BoolArray = (np.abs(x) <= self.slope[0] * z) | np.isinf(self.slope[0])
            inside &= (np.abs(y) <= self.slope[1] * z) | np.isinf(self.slope[1])
        return inside


class Profiled(Value):
    """What all sensors have: they are dataclasses that can be written as a table."""

    __slots__ = ()
    kind: ClassVar[str]
    name: str
    projection: Any
    points_per_s: float | None

    def __repr__(self) -> str:
        rows, columns = self.projection.shape
        gate = f"{getattr(self, 'min_range_m', 0.0):g}..{getattr(self, 'max_range_m', np.inf):g} m"
        return f"{type(self).__name__}({self.name!r}, {columns} x {rows} pixels, {gate})"

    @property
    def scan_time_s(self) -> float | None:
        """Seconds for all pixels at the instrument's speed, without start, turn back and pictures."""
        if self.points_per_s is None:
            return None
        rows, columns = self.projection.shape
        return float(rows * columns / self.points_per_s)

    def to_json(self) -> dict[str, Any]:
        """Return kind, fields and effects as one table; fields that are None are left out."""
        entries = {field.name: getattr(self, field.name) for field in fields(self)}  # type: ignore[arg-type]  # are dataclasses
        effects = entries.pop("effects").to_json()
        return {"kind": self.kind, **{k: v for k, v in entries.items() if v is not None}, **effects}


@dataclass(frozen=True, slots=True, repr=False)
class PinholeSensor(Profiled):
    """A range camera.

    Parameters
    ----------
    fov_deg : float
        Full angle across the longer side of the image, degrees.
    width, height : int
        Pixels; they are square.
    min_range_m, max_range_m : float
        Range gate, metres along the ray.
    name : str
        What reports call it.
    aperture : "square" or "circular"
        "square": the whole image (at width = height a pyramid of fov x fov); "circular": the cone of half
        angle fov / 2 inside it, pixels outside stay empty.
    effects : Effects
        By what its scans differ from exact ranges.
    points_per_s : float, optional
        Speed: pixels a second.
    fx_px, fy_px, cx_px, cy_px : float, optional
        Focal lengths and principal point of a calibrated camera, pixels, all or none; with them `fov_deg`
        only tells the angle across the longer side (`from_intrinsics`).

    Raises
    ------
    InputError
        Angles outside 0..180 deg, no pixels, an empty range gate, another aperture; a part of the
        intrinsics, or with a circular aperture.

    Examples
    --------
    >>> sensor = PinholeSensor(fov_deg=60)
    >>> sensor.sees(np.array([[0.57, 0.0, 1.0], [0.58, 0.0, 1.0], [0.0, 0.0, -1.0]])).tolist()
    [True, False, False]
    """

    fov_deg: float = 60.0
    width: int = 320
    height: int = 320
    min_range_m: float = 0.1
    max_range_m: float = 30.0
    name: str = "pinhole"
    aperture: Aperture = "square"
    effects: Effects = NO_EFFECTS
    fx_px: float | None = None
    fy_px: float | None = None
    cx_px: float | None = None
    cy_px: float | None = None
    points_per_s: float | None = None

    kind: ClassVar[str] = "pinhole"
    partner: ClassVar[None] = None

    def __post_init__(self) -> None:
        check_gate(self.name, self.min_range_m, self.max_range_m, self.points_per_s)
        if self.aperture not in ("square", "circular"):
            raise InputError(f"aperture must be square or circular, got {self.aperture!r}")
        known = [value is not None for value in (self.fx_px, self.fy_px, self.cx_px, self.cy_px)]
        if any(known) and not all(known):
            raise InputError("intrinsics are fx_px, fy_px, cx_px and cy_px; give all four or none")
        if any(known) and self.aperture == "circular":
            raise InputError("a camera with intrinsics has no circular aperture; leave one of the two out")
        if not 0 < self.fov_deg < 180:
            raise InputError(f"a pinhole's field of view must lie between 0 and 180 deg, got {self.fov_deg}")
        _ = self.projection  # raises for what cannot be

    @classmethod
    def from_intrinsics(
        cls,
        width: int,
        height: int,
        *,
        fx: float,
        fy: float,
        cx: float,
        cy: float,
        range_m: tuple[float, float] = (0.1, 30.0),
    ) -> PinholeSensor:
        """Return the calibrated camera with these focal lengths and principal point, pixels.

        The centre of the first pixel is at (0, 0), as in `scenes.scan.projection`; a negative fy is used as
        given (y = (v - cy) z / fy). Ranges are measured within `range_m`, metres.

        Raises
        ------
        InputError
            No pixels, focal lengths or a principal point that no camera has, an empty range gate.

        Examples
        --------
        >>> kinect = PinholeSensor.from_intrinsics(640, 480, fx=525, fy=525, cx=319.5, cy=239.5)
        >>> round(kinect.fov_deg, 1), kinect.projection.fx
        (62.7, 525.0)
        """
        camera = PinholeProjection(
            width=width, height=height, fx=float(fx), fy=float(fy), cx=float(cx), cy=float(cy)
        )
        ends = {True: (width, camera.cx, camera.fx), False: (height, camera.cy, camera.fy)}
        n, centre, focal = ends[width >= height]
        across = np.arctan((n - 0.5 - centre) / abs(focal)) + np.arctan((centre + 0.5) / abs(focal))
        return cls(
            fov_deg=float(np.degrees(across)), width=width, height=height,
            min_range_m=range_m[0], max_range_m=range_m[1],
            fx_px=camera.fx, fy_px=camera.fy, cx_px=camera.cx, cy_px=camera.cy,
        )  # fmt: skip

    @property
    def projection(self) -> PinholeProjection:
        """The geometry of the pixels."""
        if self.fx_px is None or self.fy_px is None or self.cx_px is None or self.cy_px is None:
            return PinholeProjection.from_fov(self.width, self.height, self.fov_deg)
        return PinholeProjection(
            width=self.width, height=self.height,
            fx=self.fx_px, fy=self.fy_px, cx=self.cx_px, cy=self.cy_px,
        )  # fmt: skip

    def sees(self, points: FloatArray) -> BoolArray:
        """Tell which sensor-frame points (n, 3) lie in the aperture."""
        if self.fx_px is not None:
            return in_image(points, self.projection)
        inside = in_pyramid(points, image_slope(self.fov_deg, self.width, self.height))
        if self.aperture == "circular":
            inside &= (
                points[..., 2]
                >= np.cos(np.radians(self.fov_deg) / 2) * np.linalg.norm(points, axis=-1) - 1e-12
            )
        return inside


@dataclass(frozen=True, slots=True, repr=False)
class SphericalSensor(Profiled):
    """A panoramic scanner that turns about its y axis; z points to the middle column.

    Parameters
    ----------
    azimuth_span_deg : float
        Degrees covered around, at most 360.
    elevation_min_deg, elevation_max_deg : float
        Lowest and highest elevation, degrees; -60 and 90 is what data sheets call 360 x 300 deg.
    width, height : int
        Pixels around and up.
    min_range_m, max_range_m : float
        Range gate, metres.
    name : str
        What reports call it.
    effects : Effects
        By what its scans differ from exact ranges.
    points_per_s : float, optional
        Speed: pixels a second.
    finest_step_deg : float, optional
        Smallest angle between columns that the instrument can be set to, degrees.

    Raises
    ------
    InputError
        Angles out of bounds, no pixels, columns closer than the instrument can, an empty range gate.
    """

    azimuth_span_deg: float = 360.0
    elevation_min_deg: float = -60.0
    elevation_max_deg: float = 90.0
    width: int = 1080
    height: int = 451
    min_range_m: float = 0.3
    max_range_m: float = 80.0
    name: str = "spherical"
    effects: Effects = NO_EFFECTS
    points_per_s: float | None = None
    finest_step_deg: float | None = None

    kind: ClassVar[str] = "spherical"
    partner: ClassVar[None] = None

    def __post_init__(self) -> None:
        check_gate(self.name, self.min_range_m, self.max_range_m, self.points_per_s)
        if not 0 < self.azimuth_span_deg <= 360:
            raise InputError(f"azimuth_span_deg must lie in 0..360, got {self.azimuth_span_deg}")
        if not -90 <= self.elevation_min_deg < self.elevation_max_deg <= 90:
            raise InputError(
                "elevations must rise within -90..90 deg, got "
                f"{self.elevation_min_deg}..{self.elevation_max_deg}"
            )
        if self.width < 1 or self.height < 2:
            raise InputError(f"a panorama needs 1 x 2 pixels or more, got {self.width} x {self.height}")
        step, finest = self.azimuth_span_deg / self.width, self.finest_step_deg or 0.0
        if step < 0.999 * finest:  # data sheets round it
            most = int(self.azimuth_span_deg / finest)
            raise InputError(
                f"{self.width} columns on {self.azimuth_span_deg:g} deg are {step:.2g} deg apart; "
                f"the instrument has steps of {finest:g} deg or more: {most} columns at most"
            )

    @property
    def projection(self) -> SphericalProjection:
        """The geometry of the pixels."""
        elevation = (self.elevation_min_deg, self.elevation_max_deg)
        return SphericalProjection.regular(self.width, self.height, self.azimuth_span_deg, elevation)

    def sees(self, points: FloatArray) -> BoolArray:
        """Tell which sensor-frame points (n, 3) lie in the aperture."""
        elevation = np.arctan2(-points[..., 1], np.hypot(points[..., 0], points[..., 2]))
        low, high = np.radians(self.elevation_min_deg), np.radians(self.elevation_max_deg)
        inside: BoolArray = (elevation >= low - 1e-12) & (elevation <= high + 1e-12)
        if self.azimuth_span_deg < 360:
            azimuth = np.arctan2(points[..., 0], points[..., 2])
            inside &= np.abs(azimuth) <= np.radians(self.azimuth_span_deg) / 2
        return inside


def image_slope(fov_deg: float, width: int, height: int) -> tuple[float, float]:
    """Tangents of half the field of view across and down an image; `fov_deg` spans the longer side."""
    slope = float(np.tan(np.radians(fov_deg) / 2)) / max(width, height)
    return slope * width, slope * height


def in_pyramid(points: FloatArray, slope: tuple[float, float]) -> BoolArray:
    """Tell which sensor-frame points (n, 3) lie in the pyramid about z with these tangents."""
    x, y, z = points[..., 0], points[..., 1], points[..., 2]
    inside: BoolArray = (np.abs(x) <= slope[0] * z) & (np.abs(y) <= slope[1] * z) & (z > 0)
    return inside


def in_image(points: FloatArray, camera: PinholeProjection) -> BoolArray:
    """Tell which sensor-frame points (n, 3) lie before a camera, within the outer edges of its pixels."""
    x, y, z = points[..., 0], points[..., 1], points[..., 2]
    u, v = camera.fx * x + camera.cx * z, camera.fy * y + camera.cy * z
    inside: BoolArray = (z > 0) & (u >= -0.5 * z) & (u <= (camera.width - 0.5) * z)
    inside &= (v >= -0.5 * z) & (v <= (camera.height - 0.5) * z)
    return inside


def chosen_effects(sensor: Sensor, noise: str) -> Effects:
    """Return the effects that go by the name `noise`; the sensor's own for "profile"."""
    return sensor.effects if noise == PROFILE else named_effects(noise)


def missing_errors(sensor: Sensor, noise: str) -> tuple[str, ...]:
    """Return a warning where `noise` asks for the errors of a profile that states none, or none of ranges."""
    if noise != PROFILE or sensor.effects.noise is not None:
        return ()
    others = ", ".join(sensor.effects.to_json())
    has = f"states {others} but no [noise]: its ranges have" if others else "states no errors: its scans have"
    return (
        f"noise {PROFILE}: the profile of {sensor.name} {has} no random error; give a TOML file with "
        "[noise], or name a model such as gaussian-2mm",
    )


def with_effects(sensor: Sensor, effects: Effects) -> Sensor:
    """Return the sensor with other effects."""
    changed: Sensor = replace(sensor, effects=effects)  # type: ignore[type-var]  # a protocol of dataclasses
    return changed


def check_gate(name: str, nearest: float, farthest: float, points_per_s: float | None) -> None:
    """Raise InputError for an empty range gate, metres, and for an instrument that stands still."""
    if not 0 <= nearest < farthest:
        raise InputError(f"sensor {name}: ranges must satisfy 0 <= min < max, got {nearest}..{farthest} m")
    if points_per_s is not None:
        check_number("points_per_s", points_per_s, 1e-6)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class View(Value):
    """One station.

    Parameters
    ----------
    world_from_sensor : Pose
        Where the sensor stands and looks (z forward, y down).
    sensor : Sensor
        What stands there.
    gain_m2 : float, optional
        Area that meets the requirement since this view and did not before, square metres.
    met_fraction : float, optional
        Share of the scene's area that meets the requirement after this view.
    predicted_gain_m2 : float, optional
        Where the scene is not known: weighted area of unknown faces and of badly seen surface that the view
        should settle by what the voxels say, square metres.
    """

    world_from_sensor: Pose
    sensor: Sensor
    gain_m2: float | None = None
    met_fraction: float | None = None
    predicted_gain_m2: float | None = None

    def __repr__(self) -> str:
        met = "" if self.met_fraction is None else f", met {self.met_fraction:.4f}"
        x, y, z = self.world_from_sensor.translation.tolist()
        return f"View({self.sensor.name} at {x:.3f}, {y:.3f}, {z:.3f}{met})"

    def to_json(self) -> dict[str, Any]:
        """Return the entry of `plan.json`."""
        entry = {
            "world_from_sensor": self.world_from_sensor.matrix.tolist(),
            "gain_m2": self.gain_m2,
            "met_fraction": self.met_fraction,
        }
        if self.predicted_gain_m2 is not None:
            entry["predicted_gain_m2"] = self.predicted_gain_m2
        return entry
