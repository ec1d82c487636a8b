# SPDX-License-Identifier: MIT
"""Sensors: aperture, pixels and range limits of a range scanner, and profiles of them by name."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, fields
from importlib import resources
from pathlib import Path
from typing import Any, ClassVar, Literal, Protocol, runtime_checkable

import numpy as np

from scenes.checks import BoolArray, FloatArray, InputError
from scenes.projection import PinholeProjection, Projection, SphericalProjection

Aperture = Literal["square", "circular"]


@runtime_checkable
class Sensor(Protocol):
    """What planner and scanner ask of a sensor; its frame is x right, y down, z forward."""

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

    def sees(self, points: FloatArray) -> BoolArray:
        """Tell which sensor-frame points (n, 3) lie in the aperture, whatever their range."""
        ...

    def to_json(self) -> dict[str, Any]:
        """Return the profile as `sensor_from_profile` reads it."""
        ...


@dataclass(frozen=True, slots=True)
class PinholeSensor:
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

    Raises
    ------
    InputError
        Angles outside 0..180 deg, no pixels, an empty range gate, another aperture.

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

    kind: ClassVar[str] = "pinhole"

    def __post_init__(self) -> None:
        _check_gate(self.name, self.min_range_m, self.max_range_m)
        if self.aperture not in ("square", "circular"):
            raise InputError(f"aperture must be square or circular, got {self.aperture!r}")
        PinholeProjection.from_fov(self.width, self.height, self.fov_deg)  # raises for what cannot be

    @property
    def projection(self) -> PinholeProjection:
        """The geometry of the pixels."""
        return PinholeProjection.from_fov(self.width, self.height, self.fov_deg)

    def sees(self, points: FloatArray) -> BoolArray:
        """Tell which sensor-frame points (n, 3) lie in the aperture."""
        x, y, z = points[..., 0], points[..., 1], points[..., 2]
        slope = np.tan(np.radians(self.fov_deg) / 2) / max(self.width, self.height)
        inside: BoolArray = (np.abs(x) <= slope * self.width * z) & (np.abs(y) <= slope * self.height * z)
        inside &= z > 0
        if self.aperture == "circular":
            inside &= z >= np.cos(np.radians(self.fov_deg) / 2) * np.linalg.norm(points, axis=-1) - 1e-12
        return inside

    def to_json(self) -> dict[str, Any]:
        """Return the profile."""
        return _profile_of(self)


@dataclass(frozen=True, slots=True)
class SphericalSensor:
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

    Raises
    ------
    InputError
        Angles out of bounds, no pixels, an empty range gate.
    """

    azimuth_span_deg: float = 360.0
    elevation_min_deg: float = -60.0
    elevation_max_deg: float = 90.0
    width: int = 1080
    height: int = 451
    min_range_m: float = 0.3
    max_range_m: float = 80.0
    name: str = "spherical"

    kind: ClassVar[str] = "spherical"

    def __post_init__(self) -> None:
        _check_gate(self.name, self.min_range_m, self.max_range_m)
        if not 0 < self.azimuth_span_deg <= 360:
            raise InputError(f"azimuth_span_deg must lie in 0..360, got {self.azimuth_span_deg}")
        if not -90 <= self.elevation_min_deg < self.elevation_max_deg <= 90:
            raise InputError(
                "elevations must rise within -90..90 deg, got "
                f"{self.elevation_min_deg}..{self.elevation_max_deg}"
            )
        if self.width < 1 or self.height < 2:
            raise InputError(f"a panorama needs 1 x 2 pixels or more, got {self.width} x {self.height}")

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

    def to_json(self) -> dict[str, Any]:
        """Return the profile."""
        return _profile_of(self)


_ENTRY_TYPES: dict[str, tuple[type, ...]] = {"int": (int,), "float": (int, float)}
_KINDS: dict[str, type[PinholeSensor] | type[SphericalSensor]] = {
    "pinhole": PinholeSensor,
    "spherical": SphericalSensor,
}


def sensor_names() -> tuple[str, ...]:
    """Return the names of the shipped profiles."""
    files = resources.files("nbv").joinpath("sensors").iterdir()
    return tuple(sorted(file.name.removesuffix(".toml") for file in files if file.name.endswith(".toml")))


def load_sensor(name_or_path: str | Path) -> Sensor:
    """Return a shipped profile by name, or the one in a TOML file.

    Raises
    ------
    InputError
        No such profile or file, a file that is not TOML, a missing, unknown or impossible entry.

    Examples
    --------
    >>> load_sensor("generic60").projection.shape
    (320, 320)
    """
    name = str(name_or_path)
    if name in sensor_names():
        text = (resources.files("nbv") / "sensors" / f"{name}.toml").read_text("utf-8")
        return _parse(text, name)
    path = Path(name)
    if path.suffix != ".toml":
        raise InputError(f"no sensor named {name!r}; there are {', '.join(sensor_names())}, or give a .toml")
    try:
        return _parse(path.read_text("utf-8"), name)
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"cannot read sensor {name}: {error}") from error


def sensor_from_profile(profile: Mapping[str, Any], source: str = "sensor") -> Sensor:
    """Return the sensor of a parsed profile; `source` is named in errors.

    Raises
    ------
    InputError
        A missing, unknown or impossible entry.
    """
    kind = profile.get("kind")
    if not isinstance(kind, str) or kind not in _KINDS:
        raise InputError(f"{source}: kind must be one of {', '.join(_KINDS)}, got {kind!r}")
    known = {field.name: field.type for field in fields(_KINDS[kind])}
    given = {key: value for key, value in profile.items() if key != "kind"}
    if unknown := sorted(set(given) - set(known)):
        raise InputError(f"{source}: unknown entry {unknown[0]!r}; a {kind} sensor has {', '.join(known)}")
    for key, value in given.items():
        wanted = _ENTRY_TYPES.get(str(known[key]), (str,))
        if isinstance(value, bool) or not isinstance(value, wanted):
            raise InputError(f"{source}: {key} must be {known[key]}, got {value!r}")
    try:
        return _KINDS[kind](**given)
    except InputError as error:
        raise InputError(f"{source}: {error}") from error


def _parse(text: str, source: str) -> Sensor:
    """Return the sensor that a TOML text describes."""
    try:
        profile = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"sensor {source} is not TOML: {error}") from error
    return sensor_from_profile({"name": Path(source).stem, **profile}, f"sensor {source}")


def _profile_of(sensor: PinholeSensor | SphericalSensor) -> dict[str, Any]:
    entries = {field.name: getattr(sensor, field.name) for field in fields(sensor)}
    return {"kind": sensor.kind, **entries}


def _check_gate(name: str, nearest: float, farthest: float) -> None:
    if not 0 <= nearest < farthest:
        raise InputError(f"sensor {name}: ranges must satisfy 0 <= min < max, got {nearest}..{farthest} m")
