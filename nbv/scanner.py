# SPDX-License-Identifier: MIT
"""Scanner: one simulated range image of a scene, with its truth, stage by stage."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nbv.echo import Echo, World, footprint_echo
from nbv.effects import PROFILE, Effects, named_effects, stage_streams
from nbv.footprint import N_RAYS
from nbv.intensity import Intensity
from nbv.noise import range_sigma_m
from nbv.sensor import PinholeSensor, Sensor
from nbv.view import View
from scenes.checks import BoolArray, FloatArray, InputError
from scenes.pose import Pose
from scenes.range_image import RangeImage, ScanTruth
from scenes.raycast import Hits, RayCaster
from scenes.scene import Scene

_DRAWING = ("dropout", "noise", "pointing")  # stages that draw random numbers


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
        Effects by name, see `nbv.effects.named_effects`; "profile" for those of the sensor's own profile;
        "none" unless asked for.
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
    effects = _chosen(sensor, noise, effects)
    streams = stage_streams(rng, _DRAWING)
    projection = sensor.projection
    rays, shape = projection.directions().reshape(-1, 3), projection.shape
    world = World(scene, caster or scene.ray_caster(n_threads), pose, sensor.partner)

    directions = pose.rotate(rays)
    hits, seen = world.cast(pose.translation[None], directions)
    colour = world.colour(hits)
    echo = _echo(world, directions, hits, seen, colour, effects)
    intensity = _intensity(echo, effects)
    measured = _kept(echo, intensity, effects, streams["dropout"]) & _in_aperture(sensor, rays)
    axis = rays[:, 2] if projection.kind == "pinhole" else 1.0
    distance = np.where(measured, echo.ranges, np.inf)
    distance, variance = _disturbed(distance, echo, axis, effects, streams["noise"])
    points = None
    if effects.pointing is not None:
        points = effects.pointing.displaced(distance, echo.incidence, projection, rays, streams["pointing"])
        distance = np.where(np.isfinite(distance), np.linalg.norm(points, axis=-1), np.inf)
    gated = (distance >= sensor.min_range_m) & (distance <= sensor.max_range_m)
    return RangeImage(
        np.where(gated, distance, np.inf).reshape(shape),
        projection,
        pose,
        colour=colour.reshape(*shape, 3),
        sensor_points=None if points is None else points.reshape(*shape, 3),
        sigma_m=_rms(variance, gated, effects),
        sensor=sensor.name,
        noise=effects.describe(),
        intensity=None if effects.intensity is None else np.where(gated, intensity, 0).reshape(shape),
        truth=_truth_of(scene, hits, echo, shape) if truth else None,
        name=name,
    )


def _standing(view: View | Pose, sensor: Sensor | None) -> tuple[Pose, Sensor]:
    """Return where the scan is taken, and by what."""
    if isinstance(view, View):
        return view.world_from_sensor, sensor or view.sensor
    if sensor is None:
        raise InputError("a pose does not say what scans there: give a sensor too, or a View")
    return view, sensor


def _chosen(sensor: Sensor, noise: str, effects: Effects | None) -> Effects:
    """Return the effects that were asked for, by name or as they are."""
    if effects is None:
        return sensor.effects if noise == PROFILE else named_effects(noise)
    if noise != "none":
        raise InputError(f"give noise or effects, not both; noise is {noise!r}")
    return effects


def _echo(
    world: World,
    directions: FloatArray,
    hits: Hits,
    seen: BoolArray,
    colour: NDArray[np.float32],
    effects: Effects,
) -> Echo:
    """Return what comes back: along the middle rays, or from the whole footprint of each beam."""
    light = effects.intensity or Intensity()
    if effects.footprint is not None:
        return footprint_echo(world, directions, effects.footprint, light)
    reflectivity = light.reflectivity_of(colour) if effects.use_reflectivity else 1.0
    return Echo(np.where(seen, hits.ranges, np.inf), hits.incidence_cosine, reflectivity, seen.view(np.uint8))


def _intensity(echo: Echo, effects: Effects) -> NDArray[np.float32]:
    """Return the light of each echo where it is asked for; a beam met in part brings back a part of it."""
    if effects.intensity is None and effects.dropout is None:
        return np.zeros(0, np.float32)
    full = (effects.intensity or Intensity()).of(echo.ranges, echo.cosine, echo.reflectivity)
    return full if effects.footprint is None else full * np.float32(1 / N_RAYS) * echo.n_rays


def _kept(
    echo: Echo, intensity: NDArray[np.float32], effects: Effects, rng: np.random.Generator
) -> BoolArray:
    """Tell which echoes are received."""
    if effects.dropout is None:
        return np.ones(len(echo.ranges), dtype=np.bool_)
    return effects.dropout.kept(intensity, echo.incidence, rng)


def _disturbed(
    distance: FloatArray,
    echo: Echo,
    axis: FloatArray | float,
    effects: Effects,
    rng: np.random.Generator,
) -> tuple[FloatArray, FloatArray | float]:
    """Return the distances with noise and in steps, and the variance of both; inf stays inf.

    One normal number is drawn for every pixel, hit or not, so that the noise of a pixel does not depend on
    what the others see. The variance of a step is that of an even spread over it, step^2 / 12.
    """
    variance: FloatArray | float = 0.0
    if effects.noise is not None:
        reach = np.where(np.isfinite(distance), distance, 1.0)
        sigma = range_sigma_m(effects.noise, reach, echo.incidence, axis, echo.reflectivity)
        distance = distance + sigma * rng.standard_normal(len(distance))
        variance = sigma**2
    if effects.quantisation is not None:
        reach = np.where(np.isfinite(distance), distance, 1.0)
        variance = variance + effects.quantisation.step_m(reach, axis) ** 2 / 12
        distance = effects.quantisation.rounded(distance, axis)
    return distance, variance


def _truth_of(scene: Scene, hits: Hits, echo: Echo, shape: tuple[int, int]) -> ScanTruth:
    """Return what the middle rays met, and how many rays make each echo."""
    surface = np.where(hits.hit, scene.mesh.face_surface[hits.face], -1)
    incidence = np.where(hits.hit, np.arccos(np.clip(hits.incidence_cosine, 0.0, 1.0)), np.nan)
    return ScanTruth(
        face=hits.face.reshape(shape),
        surface=surface.astype(np.int32).reshape(shape),
        ranges=hits.ranges.reshape(shape),
        incidence=incidence.reshape(shape),
        n_rays=echo.n_rays.reshape(shape),
    )


def _in_aperture(sensor: Sensor, rays: FloatArray) -> BoolArray:
    """Pixels (n,) inside a circular aperture; all of them otherwise."""
    if isinstance(sensor, PinholeSensor) and sensor.aperture == "circular":
        return sensor.sees(rays)
    return np.ones(len(rays), dtype=np.bool_)


def _rms(variance: FloatArray | float, gated: BoolArray, effects: Effects) -> float | None:
    """Typical standard deviation in metres of the pixels that came back."""
    if effects.footprint is not None and effects.noise is None:
        return None
    here = np.broadcast_to(variance, gated.shape)[gated]
    return float(np.sqrt(here.mean())) if here.size else 0.0
