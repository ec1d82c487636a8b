# SPDX-License-Identifier: MIT
"""Scanner: one simulated range image of a scene, with its truth."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nbv.noise import NoiseModel, noise_model
from nbv.sensor import PinholeSensor, Sensor
from nbv.view import View
from scenes.checks import BoolArray, FloatArray, InputError
from scenes.pose import Pose
from scenes.range_image import RangeImage, ScanTruth
from scenes.raycast import Hits, RayCaster
from scenes.scene import Scene

_GREY = 0.5


def scan_scene(
    scene: Scene,
    view: View | Pose,
    sensor: Sensor | None = None,
    *,
    noise: str = "none",
    rng: np.random.Generator | int | None = None,
    caster: RayCaster | None = None,
    n_threads: int | None = None,
    name: str = "scan",
) -> RangeImage:
    """Scan a scene from one view.

    Parameters
    ----------
    scene : Scene
        The world to scan.
    view : View or Pose
        A view of a plan, or a `world_from_sensor` together with `sensor`.
    sensor : Sensor, optional
        Needed with a pose; with a view it replaces the view's own.
    noise : str
        A model of `nbv.noise`; "none" unless asked for.
    rng : Generator, int or None
        Randomness of the noise; the noise-free scan uses none.
    caster : RayCaster, optional
        The scene prepared for ray casting, when many scans are taken.
    n_threads : int, optional
        Threads that cast when there is no `caster`; the scan does not depend on it.
    name : str
        What reports call the scan.

    Returns
    -------
    RangeImage
        With colour, truth channels, the noise model's name, and as `sigma_m` the root mean square of the
        model's standard deviations over the pixels that came back (0 without noise). Truth covers every ray
        that met the scene, also those outside the range gate.

    Raises
    ------
    InputError
        A pose without a sensor, an unknown noise model.
    """
    if isinstance(view, View):
        pose, sensor = view.world_from_sensor, sensor or view.sensor
    else:
        pose = view
    if sensor is None:
        raise InputError("a pose does not say what scans there: give a sensor too, or a View")
    model = noise_model(noise)
    projection = sensor.projection
    rays = projection.directions()
    hits = (caster or scene.ray_caster(n_threads)).first_hit(
        pose.translation[None], pose.rotate(rays).reshape(-1, 3)
    )
    shape = projection.shape
    truth = _truth_of(scene, hits, shape)
    measured = np.where(_in_aperture(sensor, rays), truth.ranges, np.inf)
    sigma = model.sigma_m(np.where(truth.face >= 0, truth.ranges, 1.0), truth.incidence, _axis(sensor, rays))
    noisy = model.disturb(measured, truth.incidence, _axis(sensor, rays), rng)
    came_back = (noisy >= sensor.min_range_m) & (noisy <= sensor.max_range_m)
    return RangeImage(
        np.where(came_back, noisy, np.inf),
        projection,
        pose,
        colour=_colour_of(scene, hits).reshape(*shape, 3),
        sigma_m=_rms(np.broadcast_to(sigma, shape)[came_back], model),
        noise=model.name,
        truth=truth,
        name=name,
    )


def _truth_of(scene: Scene, hits: Hits, shape: tuple[int, int]) -> ScanTruth:
    surface = np.where(hits.hit, scene.mesh.face_surface[hits.face], -1)
    incidence = np.where(hits.hit, np.arccos(np.clip(hits.incidence_cosine, 0.0, 1.0)), np.nan)
    return ScanTruth(
        face=hits.face.reshape(shape),
        surface=surface.astype(np.int32).reshape(shape),
        ranges=hits.ranges.reshape(shape),
        incidence=incidence.reshape(shape),
    )


def _colour_of(scene: Scene, hits: Hits) -> NDArray[np.float32]:
    """Colour (n, 3) of what each ray met, mid grey where the scene has none or nothing was met."""
    colour = np.full((len(hits.face), 3), _GREY, np.float32)
    if scene.mesh.appearance is not None and hits.hit.any():
        here = hits.hit
        colour[here] = scene.mesh.appearance.colour(hits.face[here], hits.barycentric[here])
    return colour


def _in_aperture(sensor: Sensor, rays: FloatArray) -> BoolArray:
    """Pixels inside a circular aperture; all of them otherwise."""
    if isinstance(sensor, PinholeSensor) and sensor.aperture == "circular":
        return sensor.sees(rays)
    return np.ones(rays.shape[:-1], dtype=np.bool_)


def _axis(sensor: Sensor, rays: FloatArray) -> FloatArray | float:
    """Cosine between ray and optical axis of a camera; 1 for a scanner that measures range."""
    return rays[..., 2] if sensor.kind == "pinhole" else 1.0


def _rms(sigma: FloatArray, model: NoiseModel) -> float:
    if model.name == "none" or not sigma.size:
        return 0.0
    return float(np.sqrt(np.mean(sigma**2)))
