# SPDX-License-Identifier: MIT
"""Scanner: one simulated range image of a scene, with its truth, stage by stage."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from nbv.scanning.beam import N_RAYS, Intensity
from nbv.scanning.echo import Echo, Sight, World, footprint_echo
from nbv.scanning.effects import Effects, normal_numbers, stage_streams
from nbv.scanning.noise_models import range_sigma_m
from nbv.scanning.sensor import PinholeSensor, Sensor, chosen_effects
from nbv.scanning.view import View
from scenes.checks import BoolArray, FloatArray, InputError
from scenes.pose import Pose
from scenes.rays.raycast import RayCaster
from scenes.scan.projection import Projection
from scenes.scan.range_image import RangeImage, ScanTruth
from scenes.world.scene import Scene

_FAR_M = 1e9  # stands for "nothing met" where formulas cannot do with infinity
_DRAWING = ("footprint", "dropout", "noise", "pointing")  # stages that draw random numbers


def scan_scene(
    scene: Scene,
    view: View | Pose,
    sensor: Sensor | None = None,
    *,
    noise: str = "none",
    effects: Effects | None = None,
    truth: bool = True,
    rng: np.random.Generator | int | None = None,
    caster: RayCaster | None = None,
    n_threads: int | None = None,
    name: str = "scan",
) -> RangeImage:
    """Scan a scene from one view.

    Geometry, footprint and returns, intensity, drop-out, noise, quantisation and range gate, in this order.
    A triangulating sensor measures only what both its devices see.

    Parameters
    ----------
    scene : Scene
        The world to scan.
    view : View or Pose
        A view of a plan, or a `world_from_sensor` together with `sensor`.
    sensor : Sensor, optional
        Needed with a pose; with a view it replaces the view's own.
    noise : str
        Effects by name, see `nbv.scanning.effects.named_effects`; "profile" for those of the sensor's
        own profile; "none" unless asked for.
    effects : Effects, optional
        Effects stage by stage, instead of `noise`.
    truth : bool
        Whether the scan keeps what it really met.
    rng : Generator, int or None
        Randomness; each stage has a stream of its own.
    caster : RayCaster, optional
        The scene prepared for ray casting, when many scans are taken.
    n_threads : int, optional
        Threads that cast when there is no `caster`; the scan does not depend on it.
    name : str
        What reports call the scan.

    Returns
    -------
    RangeImage
        With colour, truth, the active effects, and as `sigma_m` the root mean square over the pixels that
        came back of the range noise and of what quantisation adds: 0 for exact ranges, None (unknown) for
        mixed pixels without range noise. Truth covers every ray that met the scene, also those outside the
        range gate.

    Raises
    ------
    InputError
        A pose without a sensor, unknown noise, both `noise` and `effects`.
    """
    pose, sensor = _standing(view, sensor)
    if effects is not None and noise != "none":
        raise InputError(f"give noise or effects, not both; noise is {noise!r}")
    effects = effects or chosen_effects(sensor, noise)
    streams = stage_streams(rng, _DRAWING)
    projection = sensor.projection
    world = World(scene, caster or scene.ray_caster(n_threads), pose, sensor.partner, n_threads)

    sight = world.sight(projection.ray_grid())
    echo = _echo(world, projection, sight, effects, streams["footprint"])
    intensity = _intensity(echo, effects)
    distance = _received(echo, intensity, sensor, effects, streams["dropout"])
    is_depth = projection.kind == "pinhole" and effects.acts_on_depth
    axis = projection.directions()[..., 2].reshape(-1) if is_depth else 1.0
    distance, variance = _disturbed(
        distance, echo, axis=axis, effects=effects, rng=streams["noise"], n_threads=n_threads
    )
    points = _pointed(distance, echo, projection, effects, streams["pointing"])
    if points is not None:
        distance = np.where(np.isfinite(distance), np.linalg.norm(points, axis=-1), np.inf)
    gated = (distance >= sensor.min_range_m) & (distance <= sensor.max_range_m)
    shape = projection.shape
    return RangeImage(
        np.where(gated, distance, np.inf).reshape(shape),
        projection,
        pose,
        colour=_frozen(sight.colour, (*shape, 3)),
        sensor_points=None if points is None else _frozen(points, (*shape, 3)),
        sigma_m=_rms(variance, gated, effects),
        sensor=sensor.name,
        noise=effects.describe(),
        intensity=None if effects.intensity is None else np.where(gated, intensity, 0).reshape(shape),
        truth=_truth_of(sight, echo, shape) if truth else None,
        name=name,
    )


def _standing(view: View | Pose, sensor: Sensor | None) -> tuple[Pose, Sensor]:
    """Return where the scan is taken, and by what."""
    if isinstance(view, View):
        return view.world_from_sensor, sensor or view.sensor
    if sensor is None:
        raise InputError("a pose does not say what scans there: give a sensor too, or a View")
    return view, sensor


def _echo(
    world: World, projection: Projection, sight: Sight, effects: Effects, rng: np.random.Generator
) -> Echo:
    """Return what comes back: along the middle rays, or from the whole footprint of each beam."""
    light = effects.intensity or Intensity()
    if effects.footprint is not None:
        rotation = world.world_from_sensor.rotation
        directions = projection.ray_grid().directions(rotation, world.n_threads).reshape(-1, 3)
        return footprint_echo(world, directions, effects.footprint, light, rng)
    reflectivity = light.reflectivity_of(sight.colour) if effects.use_reflectivity else 1.0
    ranges = sight.ranges if world.partner is None else np.where(sight.seen, sight.ranges, np.inf)
    return Echo(ranges, sight.cosine, sight.incidence, reflectivity, sight.seen.view(np.uint8))


def _intensity(echo: Echo, effects: Effects) -> NDArray[np.float32]:
    """Return the light of each echo where it is asked for; a beam met in part brings back a part of it."""
    if effects.intensity is None and effects.dropout is None:
        return np.zeros(0, np.float32)
    full = (effects.intensity or Intensity()).of(echo.ranges, echo.cosine, echo.reflectivity)
    return full if effects.footprint is None else full * np.float32(1 / N_RAYS) * echo.n_rays


def _received(
    echo: Echo, intensity: NDArray[np.float32], sensor: Sensor, effects: Effects, rng: np.random.Generator
) -> FloatArray:
    """Return the ranges of the echoes that lie in a circular aperture and are not dropped; inf for others."""
    ranges = echo.ranges
    if isinstance(sensor, PinholeSensor) and sensor.aperture == "circular":
        ranges = np.where(sensor.sees(sensor.projection.directions().reshape(-1, 3)), ranges, np.inf)
    if effects.dropout is None:
        return ranges
    return np.where(effects.dropout.kept(intensity, echo.incidence, rng), ranges, np.inf)


def _disturbed(
    distance: FloatArray,
    echo: Echo,
    axis: FloatArray | float,
    effects: Effects,
    rng: np.random.Generator,
    n_threads: int | None,
) -> tuple[FloatArray, FloatArray | float]:
    """Return the distances with noise and in steps, and the variance of both; inf stays inf.

    One normal number is drawn for every pixel, hit or not, so that the noise of a pixel does not depend on
    what the others see. The variance of a step is that of an even spread over it, step^2 / 12.
    """
    variance: FloatArray | float = 0.0
    reach = np.minimum(distance, _FAR_M)
    if effects.noise is not None:
        sigma = range_sigma_m(effects.noise, reach, echo.incidence, axis, echo.reflectivity)
        noisy = normal_numbers(rng, len(distance), n_threads)
        noisy *= sigma
        noisy += distance
        distance, variance = noisy, sigma**2
    if effects.quantisation is not None:
        variance = variance + effects.quantisation.step_m(reach, axis) ** 2 / 12
        distance = effects.quantisation.rounded(distance, axis)
    return distance, variance


def _pointed(
    distance: FloatArray, echo: Echo, projection: Projection, effects: Effects, rng: np.random.Generator
) -> FloatArray | None:
    """Return measured points (n, 3), sensor frame, that leave their rays; None where none do."""
    if effects.pointing is None:
        return None
    rays = projection.directions().reshape(-1, 3)
    return effects.pointing.displaced(distance, echo.incidence, projection, rays, rng)


def _frozen(array: Any, shape: tuple[int, ...]) -> Any:
    """Return `array` in its image's shape, read-only: it is handed over, not copied."""
    array.setflags(write=False)
    return array.reshape(shape)


def _truth_of(sight: Sight, echo: Echo, shape: tuple[int, int]) -> ScanTruth:
    """Return what the middle rays met, and how many rays make each echo."""
    return ScanTruth(
        face=_frozen(sight.face, shape),
        surface=_frozen(sight.surface, shape),
        ranges=_frozen(sight.ranges, shape),
        incidence=_frozen(sight.incidence, shape),
        n_rays=echo.n_rays.reshape(shape),
    )


def _rms(variance: FloatArray | float, gated: BoolArray, effects: Effects) -> float | None:
    """Typical standard deviation in metres of the pixels that came back."""
    if effects.footprint is not None and effects.noise is None:
        return None
    if not gated.any():
        return 0.0
    return float(np.sqrt(variance if np.ndim(variance) == 0 else np.mean(variance, where=gated)))
