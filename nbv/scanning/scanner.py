# SPDX-License-Identifier: MIT
"""Scanner: one simulated range image of a scene, with its truth, stage by stage."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nbv.scanning.beam import Intensity, Returns
from nbv.scanning.echoes import Echo, footprint_echoes
from nbv.scanning.effects import Effects, normal_numbers, stage_streams
from nbv.scanning.noise_models import range_sigma_m
from nbv.scanning.sensor import PinholeSensor, Sensor, View, chosen_effects
from nbv.scanning.world import CentreHits, World
from scenes.checks import BoolArray, FloatArray, InputError, IntArray
from scenes.pose import Pose
from scenes.rays.raycast import RayCaster
from scenes.scan.echoes import Echoes
from scenes.scan.projection import Projection
from scenes.scan.range_image import RangeImage, ScanTruth
from scenes.world.scene import Scene

_FAR_M = 1e9  # stands for "nothing met" where formulas cannot do with infinity
_DRAWING = ("footprint", "dropout", "noise", "pointing", "further dropout", "further noise")
"""Stages that draw random numbers; further returns have numbers of their own."""


def scan_scene(
    scene: Scene,
    view: View | Pose,
    sensor: Sensor | None = None,
    *,
    noise: str = "none",
    effects: Effects | None = None,
    returns: Returns | None = None,
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
    returns : "first", "strongest", "last", "mean" or "all", optional
        Which returns of a beam with width are reported, instead of what its footprint says. Of all, each
        pixel has the first that was received, and `RangeImage.echoes` the further ones; each has its own
        drop-out and noise.
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
        A pose without a sensor, unknown noise, both `noise` and `effects`; `returns` of beams without width,
        or of a phase scanner, which tells none apart.
    """
    pose, sensor = _resolve_view(view, sensor)
    if effects is not None and noise != "none":
        raise InputError(f"give noise or effects, not both; noise is {noise!r}")
    effects = with_returns(effects or chosen_effects(sensor, noise), returns)
    world = World(scene, caster or scene.ray_caster(n_threads), pose, sensor.partner, n_threads)
    return scan_world(world, sensor, effects, truth=truth, rng=rng, name=name)


def scan_world(
    world: World,
    sensor: Sensor,
    effects: Effects,
    *,
    truth: bool = True,
    rng: np.random.Generator | int | None = None,
    name: str = "scan",
) -> RangeImage:
    """Scan a world, as `scan_scene` does; of a sensor that moves, ranges are those of its columns' poses."""
    streams = stage_streams(rng, _DRAWING)
    projection, n_threads = sensor.projection, world.n_threads
    sight = world.sight(projection.ray_grid())
    echo, beam, further = _echoes(world, projection, sight, effects, streams["footprint"])
    instrument = _Instrument(sensor, effects, n_threads)
    image = instrument.measure(echo, streams["dropout"], streams["noise"])
    echoes = None
    if effects.keeps_all_returns:
        more = instrument.measure(further, streams["further dropout"], streams["further noise"], beam)
        beam, more = instrument.receive_first(image, beam, more)
        echoes = Echoes(beam, more.distance, more.intensity, more.n_rays if truth else None)
    distance = image.distance
    points = _displace_points(image, projection, effects, streams["pointing"], n_threads)
    if points is not None:
        distance = np.where(np.isfinite(distance), np.linalg.norm(points, axis=-1), np.inf)
    if echoes is not None:
        echoes = echoes.scale(distance[beam] / image.distance[beam])
    gated = instrument.gated(distance)
    shape = projection.shape
    keeps_light = effects.intensity is not None or echoes is not None
    return RangeImage(
        np.where(gated, distance, np.inf).reshape(shape),
        projection,
        world.world_from_sensor,
        colour=_freeze_image(sight.colour, (*shape, 3)),
        sensor_points=None if points is None else _freeze_image(points, (*shape, 3)),
        sigma_m=_rms(image.variance, gated, effects),
        sensor=sensor.name,
        noise=effects.describe(),
        intensity=np.where(gated, image.intensity, 0).reshape(shape) if keeps_light else None,
        truth=_truth_of(sight, image.n_rays, shape) if truth else None,
        echoes=echoes,
        name=name,
    )


def with_returns(effects: Effects, returns: Returns | None) -> Effects:
    """Return the effects with a footprint that reports these returns, where they are asked for."""
    if returns is None:
        return effects
    if effects.footprint is None:
        raise InputError(
            f"{returns} returns are those of a beam with width, and these effects have no footprint; scan "
            "with noise profile and a sensor that has one, as pulsed_terrestrial"
        )
    if effects.footprint.returns == "mean" != returns:
        raise InputError(
            f"{returns} returns: a phase scanner makes one range of all light of a beam and tells no returns "
            "apart; choose a pulsed one, as pulsed_terrestrial"
        )
    return replace(effects, footprint=replace(effects.footprint, returns=returns))


def _resolve_view(view: View | Pose, sensor: Sensor | None) -> tuple[Pose, Sensor]:
    """Return where the scan is taken, and by what."""
    if isinstance(view, View):
        return view.world_from_sensor, sensor or view.sensor
    if sensor is None:
        raise InputError("a pose has no sensor: give a sensor too, or a View")
    return view, sensor


def _echoes(
    world: World, projection: Projection, sight: CentreHits, effects: Effects, rng: np.random.Generator
) -> tuple[Echo, IntArray, Echo]:
    """Return what comes back, as `footprint_echoes` does: from the whole footprint, or along middle rays."""
    light = effects.intensity or Intensity()
    if effects.footprint is not None:
        origins, directions = world.beams(projection.ray_grid(), world.n_threads)
        return footprint_echoes(world, (origins, directions.reshape(-1, 3)), effects.footprint, light, rng)
    reflectivity = light.reflectivity_of(sight.colour) if effects.use_reflectivity else 1.0
    ranges = sight.ranges if world.partner is None else np.where(sight.seen, sight.ranges, np.inf)
    echo = Echo(ranges, sight.cosine, sight.incidence, reflectivity, sight.seen.view(np.uint8))
    return echo, np.zeros(0, np.int64), Echo.of(np.empty((4, 0)))


@dataclass(frozen=True, slots=True, eq=False)
class _Measured:
    """What an instrument makes of n echoes, (n,) each: metres (inf for none), radians, light, rays, metres^2.

    Intensity is empty where nobody asks for it, and the variance one number where all have the same.
    """

    distance: FloatArray
    incidence: FloatArray
    intensity: NDArray[np.float32]
    n_rays: NDArray[np.uint8]
    variance: FloatArray | float

    def channels(self) -> dict[str, Any]:
        """Return what is known of each echo."""
        held = {field.name: getattr(self, field.name) for field in fields(self)}
        return {name: value for name, value in held.items() if np.ndim(value)}

    def pick(self, chosen: BoolArray) -> _Measured:
        """Return some of the echoes."""
        return replace(self, **{name: value[chosen] for name, value in self.channels().items()})


@dataclass(frozen=True, slots=True, eq=False)
class _Instrument:
    """What errs: a sensor with effects."""

    sensor: Sensor
    effects: Effects
    n_threads: int | None

    def measure(
        self, echo: Echo, dropout: np.random.Generator, noise: np.random.Generator, beam: Any = slice(None)
    ) -> _Measured:
        """Measure the echoes of all beams, or those of some (m,): light, drop-out, noise, steps."""
        effects, projection = self.effects, self.sensor.projection
        light = self._intensity(echo)
        ranges = echo.ranges
        if isinstance(self.sensor, PinholeSensor) and self.sensor.aperture == "circular":
            inside = self.sensor.sees(projection.directions().reshape(-1, 3))
            ranges = np.where(inside[beam], ranges, np.inf)
        if effects.dropout is not None:
            ranges = np.where(effects.dropout.draw_kept(light, echo.incidence, dropout), ranges, np.inf)
        is_depth = projection.kind == "pinhole" and effects.acts_on_depth
        axis = projection.directions()[..., 2].reshape(-1)[beam] if is_depth else 1.0
        distance, variance = _disturb(
            ranges, echo, axis=axis, effects=effects, rng=noise, n_threads=self.n_threads
        )
        return _Measured(distance, echo.incidence, light, echo.n_rays, variance)

    def _intensity(self, echo: Echo) -> NDArray[np.float32]:
        """Return the light of each echo where asked for; a beam met in part brings back a part of it."""
        effects = self.effects
        if effects.intensity is None and effects.dropout is None and not effects.keeps_all_returns:
            return np.zeros(0, np.float32)
        full = (effects.intensity or Intensity()).of(echo.ranges, echo.cosine, echo.reflectivity)
        if effects.footprint is None:
            return full
        return full * np.float32(1 / effects.footprint.n_rays_cast) * echo.n_rays

    def gated(self, distance: FloatArray) -> BoolArray:
        """Tell which distances (...,) lie within the range gate."""
        return np.asarray((distance >= self.sensor.min_range_m) & (distance <= self.sensor.max_range_m))

    def receive_first(
        self, image: _Measured, beam: IntArray, further: _Measured
    ) -> tuple[IntArray, _Measured]:
        """Write the nearest further echo that was received over one in the image that was lost.

        Return those that are left of the further ones, and their beams.
        """
        image.distance[~self.gated(image.distance)] = np.inf
        kept = self.gated(further.distance)
        beam, further = beam[kept], further.pick(kept)
        moved = (np.diff(beam, prepend=-1) > 0) & np.isinf(image.distance[beam])
        channels = further.channels()
        for name, values in image.channels().items():
            values[beam[moved]] = channels[name][moved]
        return beam[~moved], further.pick(~moved)


def _disturb(
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
        distance = effects.quantisation.round_ranges(distance, axis)
    return distance, variance


def _displace_points(
    image: _Measured,
    projection: Projection,
    effects: Effects,
    rng: np.random.Generator,
    n_threads: int | None,
) -> FloatArray | None:
    """Return measured points (n, 3), sensor frame, that leave their rays; None where none do."""
    if effects.pointing is None:
        return None
    rays = projection.directions().reshape(-1, 3)
    return effects.pointing.displace(
        image.distance, image.incidence, projection, rays, rng, n_threads=n_threads
    )


def _freeze_image(array: Any, shape: tuple[int, ...]) -> Any:
    """Return `array` in its image's shape, read-only: it is handed over, not copied."""
    array.setflags(write=False)
    return array.reshape(shape)


def _truth_of(sight: CentreHits, n_rays: NDArray[np.uint8], shape: tuple[int, int]) -> ScanTruth:
    """Return what the middle rays met, and how many rays make each echo."""
    return ScanTruth(
        face=_freeze_image(sight.face, shape),
        surface=_freeze_image(sight.surface, shape),
        ranges=_freeze_image(sight.ranges, shape),
        incidence=_freeze_image(sight.incidence, shape),
        n_rays=n_rays.reshape(shape),
    )


def _rms(variance: FloatArray | float, gated: BoolArray, effects: Effects) -> float | None:
    """Typical standard deviation in metres of the pixels that came back."""
    if effects.footprint is not None and effects.noise is None:
        return None
    if not gated.any():
        return 0.0
    return float(np.sqrt(variance if np.ndim(variance) == 0 else np.mean(variance, where=gated)))
