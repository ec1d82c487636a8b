# SPDX-License-Identifier: MIT
"""Effects: the errors of an instrument's scans; all are off unless asked for.

Each effect is one stage of `nbv.scanning.scanner`; each draws from a random stream of its own, so that
switching one off leaves the others as they were, bit by bit.

Pointing: where a measured point is put sideways of its ray, by errors of encoders or of pixels.
Encoders of a laser scanner err in azimuth and elevation; the point keeps its range. A camera errs in the
image plane; the point keeps its depth. Either way it leaves the ray of its pixel.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from nbv.scanning.beam import Dropout, Footprint, Intensity
from nbv.scanning.noise_models import (
    ConstantNoise,
    KhoshelhamNoise,
    NguyenNoise,
    NoiseModel,
    StereoNoise,
    TableNoise,
    TerrestrialNoise,
)
from scenes.checks import FloatArray, InputError, Value, check_options
from scenes.run.memory import in_blocks
from scenes.scan.projection import Projection

_STEEPEST = np.radians(89.0)  # incidence is clipped here: the formula has a pole at 90 deg


@dataclass(frozen=True, slots=True, kw_only=True)
class PointingNoise(Value):
    """Standard deviation sideways, the same in both directions.

    The three terms add up: sd_deg + pixel (sd_px + slope_px theta / (pi/2 - theta)), theta the incidence.

    Parameters
    ----------
    sd_deg : float
        Angle in degrees, what data sheets call angular accuracy.
    sd_px, slope_px : float
        In pixels; 0.8 and 0.035 are the lateral noise of Nguyen, Izadi and Lovell 2012.

    Raises
    ------
    InputError
        A negative standard deviation.
    """

    sd_deg: float = 0.0
    sd_px: float = 0.0
    slope_px: float = 0.0

    def __post_init__(self) -> None:
        check_options(self, sd_deg=(0.0, 45.0), sd_px=(0.0, 1e3), slope_px=(0.0, 1e3))

    def sigma_rad(self, incidence: FloatArray, pixel_angle: float) -> FloatArray:
        """Return the standard deviation (...,) at each incidence (...,); angles in radians."""
        theta = np.clip(incidence, 0.0, _STEEPEST)
        pixels = self.sd_px + self.slope_px * theta / (np.pi / 2 - theta)
        return np.asarray(np.radians(self.sd_deg) + pixel_angle * pixels, dtype=np.float64)

    def displace(
        self,
        distance: FloatArray,
        incidence: FloatArray,
        projection: Projection,
        rays: FloatArray,
        rng: np.random.Generator,
        *,
        n_threads: int | None = None,
    ) -> FloatArray:
        """Return measured points (rows, columns, 3) in the sensor frame, NaN where nothing came back.

        Parameters
        ----------
        distance : (rows, columns) float
            Measured ranges, metres; inf where nothing came back.
        incidence : (rows, columns) float
            Radians.
        projection : Projection
            Of a camera or of a turning scanner.
        rays : (rows, columns, 3) float
            Its unit rays.
        rng : Generator
            Two normal numbers are drawn for every pixel, whatever came back.
        n_threads : int, optional
            Points do not depend on it.
        """
        right, down = rng.standard_normal((2, distance.size))
        reach, theta, along = distance.reshape(-1), incidence.reshape(-1), rays.reshape(-1, 3)
        points = np.empty((distance.size, 3))
        turn = _shift_in_image if projection.kind == "pinhole" else _turn_about

        def move(part: slice) -> None:
            came_back = np.isfinite(reach[part])
            sigma = self.sigma_rad(np.where(came_back, theta[part], 0.0), projection.pixel_angle)
            measured = np.where(came_back, reach[part], np.nan)
            turn(measured, along[part], right[part] * sigma, down[part] * sigma, points[part])

        in_blocks(distance.size, move, n_threads)
        return points.reshape(*distance.shape, 3)

    displaced = displace  # earlier name


def _shift_in_image(
    reach: FloatArray, rays: FloatArray, right: FloatArray, down: FloatArray, points: FloatArray
) -> None:
    """Write points (n, 3) of rays that are shifted by slopes, at the depth of the range."""
    depth = reach * rays[:, 2]
    points[:, 0] = depth * (rays[:, 0] / rays[:, 2] + right)
    points[:, 1] = depth * (rays[:, 1] / rays[:, 2] + down)
    points[:, 2] = depth


def _turn_about(
    reach: FloatArray, rays: FloatArray, right: FloatArray, down: FloatArray, points: FloatArray
) -> None:
    """Write points (n, 3) of rays that are turned by angles in radians, at the same range."""
    azimuth = np.arctan2(rays[:, 0], rays[:, 2]) + right
    elevation = np.arcsin(np.clip(-rays[:, 1], -1.0, 1.0)) - down
    across = reach * np.cos(elevation)
    points[:, 0] = across * np.sin(azimuth)
    points[:, 1] = -reach * np.sin(elevation)
    points[:, 2] = across * np.cos(azimuth)


@dataclass(frozen=True, slots=True, kw_only=True)
class Quantisation(Value):
    """Steps of the range, or of the inverse depth of a triangulating camera.

    Parameters
    ----------
    range_step_m : float
        Step of the range, metres; 0 for none.
    inverse_depth_step_per_m : float
        Step of 1 / depth, which is uniform in disparity: at depth z a step of s z^2 metres; 0 for none.
        2.85e-3 is the Kinect v1 of Khoshelham and Elberink 2012; a stereo camera has its disparity step
        over focal length (px) times baseline (m).

    Raises
    ------
    InputError
        A negative step, both steps or none.

    Examples
    --------
    >>> Quantisation(range_step_m=0.25).round_ranges(np.array([1.1, 1.2])).tolist()
    [1.0, 1.25]
    """

    range_step_m: float = 0.0
    inverse_depth_step_per_m: float = 0.0

    def __post_init__(self) -> None:
        check_options(self, range_step_m=(0.0, np.inf), inverse_depth_step_per_m=(0.0, np.inf))
        if (self.range_step_m > 0) == (self.inverse_depth_step_per_m > 0):
            raise InputError("quantisation needs range_step_m or inverse_depth_step_per_m, and not both")

    def round_ranges(self, ranges: FloatArray, axis_cosine: FloatArray | float = 1.0) -> FloatArray:
        """Return `ranges` in metres, rounded to the nearest step; inf stays inf.

        Parameters
        ----------
        ranges : (...,) float
            Along the ray, metres.
        axis_cosine : (...,) float
            Cosine between ray and optical axis: depth = range * axis_cosine.
        """
        if self.range_step_m > 0:
            return np.asarray(np.round(ranges / self.range_step_m) * self.range_step_m)
        step = self.inverse_depth_step_per_m
        levels = np.round(1 / (np.maximum(ranges, 1e-6) * axis_cosine) / step)
        depth = 1 / (np.maximum(levels, 1.0) * step)
        return np.where(np.isfinite(ranges), depth / axis_cosine, ranges)

    rounded = round_ranges  # earlier name

    def step_m(self, ranges: FloatArray, axis_cosine: FloatArray | float = 1.0) -> FloatArray:
        """Return the step (...,) along the ray at `ranges` (...,), metres; parameters as for `rounded`."""
        if self.range_step_m > 0:
            return np.full(np.shape(ranges), self.range_step_m)
        return np.asarray(self.inverse_depth_step_per_m * np.square(ranges) * axis_cosine)


_BLOCK = 1 << 16  # numbers from one generator; not to be changed, or seeds give other numbers


def stage_streams(
    rng: np.random.Generator | int | None, stages: tuple[str, ...]
) -> dict[str, np.random.Generator]:
    """Return a random stream for each stage, which depends on `rng` and the stage's own name alone."""
    entropy = np.random.default_rng(rng).integers(0, 2**63, size=2).tolist()
    return {
        stage: np.random.default_rng(np.random.SeedSequence(entropy, spawn_key=tuple(stage.encode())))
        for stage in stages
    }


def normal_numbers(rng: np.random.Generator, n: int, n_threads: int | None = None) -> FloatArray:
    """Return standard normal numbers (n,), the same for any number of threads.

    Each block of them comes from a child of `rng`.
    """
    numbers = np.empty(n)
    children = rng.spawn(-(-n // _BLOCK))

    def draw(blocks: slice) -> None:
        for k in range(blocks.start, blocks.stop):
            children[k].standard_normal(out=numbers[k * _BLOCK : (k + 1) * _BLOCK])

    in_blocks(len(children), draw, n_threads, block=1)
    return numbers


NOISE_MODELS: dict[str, type[Any]] = {
    kind.model: kind
    for kind in (ConstantNoise, KhoshelhamNoise, NguyenNoise, StereoNoise, TableNoise, TerrestrialNoise)
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Effects(Value):
    """The stages of a measurement after its geometry, in their order; None is off.

    Attributes
    ----------
    footprint : Footprint, optional
        Beam width and returns.
    intensity : Intensity, optional
        Stored as a channel of the scan.
    dropout : Dropout, optional
        Lost echoes.
    noise : NoiseModel, optional
        Of the range, or of the depth of a camera.
    pointing : PointingNoise, optional
        Sideways.
    quantisation : Quantisation, optional
        Steps.
    """

    footprint: Footprint | None = None
    intensity: Intensity | None = None
    dropout: Dropout | None = None
    noise: NoiseModel | None = None
    pointing: PointingNoise | None = None
    quantisation: Quantisation | None = None

    @property
    def use_reflectivity(self) -> bool:
        """Whether some stage asks how much light comes back."""
        by_light = isinstance(self.noise, TerrestrialNoise | TableNoise)
        return by_light or self.intensity is not None or self.dropout is not None

    @property
    def keeps_all_returns(self) -> bool:
        """Whether a scan keeps all returns of a beam, and their intensities."""
        return self.footprint is not None and self.footprint.returns == "all"

    @property
    def acts_on_depth(self) -> bool:
        """Whether some stage speaks of the depth of a camera rather than of range."""
        steps = self.quantisation is not None and self.quantisation.inverse_depth_step_per_m > 0
        return steps or (self.noise is not None and self.noise.acts_on_depth)

    def to_json(self) -> dict[str, Any]:
        """Return the stages that are on as tables; `model` names the noise."""
        tables = {}
        for stage in fields(self):
            option = getattr(self, stage.name)
            if option is not None:
                tables[stage.name] = _table(option)
        return tables

    def describe(self) -> str:
        """Return the stages and their parameters other than 0 in one line, "none" when all are off."""
        parts = []
        for stage, table in self.to_json().items():
            name = table.pop("model", None)
            values = ", ".join(f"{key} {_short(value)}" for key, value in table.items() if value != 0)
            parts.append(f"{stage}{f' {name}' if name else ''} ({values})")
        return "; ".join(parts) or "none"


def _table(option: Any) -> dict[str, Any]:
    values = {field.name: getattr(option, field.name) for field in fields(option)}
    known = {name: value for name, value in values.items() if value is not None}
    return {"model": option.model, **known} if hasattr(option, "model") else known


def _short(value: Any) -> str:
    if isinstance(value, tuple):
        return f"[{' '.join(map(_short, value))}]"
    return f"{value:g}" if isinstance(value, float) else str(value)


NO_EFFECTS = Effects()
PROFILE = "profile"  # the name that asks for a sensor's own effects
_NUMBER = r"(\d+(?:\.\d+)?)"
_NAMED = {
    "none": NO_EFFECTS,
    "khoshelham2012": Effects(
        noise=KhoshelhamNoise(), quantisation=Quantisation(inverse_depth_step_per_m=2.85e-3)
    ),
    "nguyen2012": Effects(noise=NguyenNoise(), pointing=PointingNoise(sd_px=0.8, slope_px=0.035)),
    "constant-ppm": Effects(noise=ConstantNoise(constant_m=1e-3, ppm=10.0)),
}


def named_effects(name: str) -> Effects:
    """Return the effects that go by a name.

    Parameters
    ----------
    name : str
        "none"; "gaussian-2mm" (any number); "constant-2mm-10ppm" (any numbers); "constant-ppm" (1 mm +
        10 ppm); "khoshelham2012" (noise and steps); "nguyen2012" (axial and lateral);
        "stereo-0.08px-640px-50mm" (error of the disparity, focal length, baseline);
        "terrestrial-1mm-0.002mm" (constant, and what a white surface adds at 1 m).

    Raises
    ------
    InputError
        No such name.

    Examples
    --------
    >>> named_effects("gaussian-2mm").describe()
    'noise constant (constant_m 0.002)'
    """
    if name in _NAMED:
        return _NAMED[name]
    if effects := _numbers(r"gaussian-#mm", name):
        return Effects(noise=ConstantNoise(constant_m=effects[0] / 1e3))
    if effects := _numbers(r"constant-#mm-#ppm", name):
        return Effects(noise=ConstantNoise(constant_m=effects[0] / 1e3, ppm=effects[1]))
    if effects := _numbers(r"stereo-#px-#px-#mm", name):
        return Effects(
            noise=StereoNoise(subpixel_px=effects[0], focal_px=effects[1], baseline_m=effects[2] / 1e3)
        )
    if effects := _numbers(r"terrestrial-#mm-#mm", name):
        return Effects(noise=TerrestrialNoise(constant_m=effects[0] / 1e3, signal_per_m=effects[1] / 1e3))
    raise InputError(
        f"no noise model named {name!r}; there are {', '.join(_NAMED)}, {PROFILE} (the sensor's own), "
        "gaussian-<n>mm, constant-<n>mm-<n>ppm, stereo-<n>px-<focal>px-<baseline>mm, terrestrial-<n>mm-<n>mm"
    )


def _numbers(pattern: str, name: str) -> list[float]:
    """Return the numbers where # stands in `pattern`, none when `name` is not of that form."""
    match = re.fullmatch(pattern.replace("#", _NUMBER), name)
    return [] if match is None else [float(text) for text in match.groups()]
