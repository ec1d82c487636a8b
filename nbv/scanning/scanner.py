# SPDX-License-Identifier: MIT
"""Scanner: one simulated range image of a scene, with its truth, stage by stage.

The echo is what comes back along each pixel's beam, before an instrument has erred about it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from nbv.scanning.beam import N_RAYS, Footprint, Intensity, Returns, reflectivity_of_colour, sub_rays
from nbv.scanning.effects import Effects, normal_numbers, stage_streams
from nbv.scanning.noise_models import range_sigma_m
from nbv.scanning.sensor import Partner, PinholeSensor, Sensor, View, chosen_effects
from nbv.scanning.triangulation import both_see
from scenes.checks import BoolArray, FloatArray, InputError
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.pose import Pose
from scenes.rays.raycast import Hits, RayCaster
from scenes.run.memory import in_blocks, rows_within
from scenes.scan.projection import Projection
from scenes.scan.range_image import RangeImage, ScanTruth
from scenes.scan.ray_grid import RayGrid
from scenes.world.scene import Scene
from texture.engine.compiled import compiled

_GREY = 0.5
_CHUNK = 32_768  # beams at a time at the most: half a million rays
_BYTES_A_RAY = 200  # that casting one takes meanwhile
_BAND = 32_768  # pixels at a time: their rays and hits fit into a core's cache


@dataclass(frozen=True, slots=True, eq=False)
class Echo:
    """Echoes of n beams, (n,) each; a beam without one has range inf and cosine 0.

    Ranges are metres, `cosine` is |cosine| of incidence, the mean over the footprint where there is one, and
    `incidence` its angle in radians. `reflectivity` is the share of light that the surface scatters, `n_rays`
    how many rays of the beam the echo is made of.
    """

    ranges: FloatArray
    cosine: FloatArray
    incidence: FloatArray
    reflectivity: FloatArray | float
    n_rays: NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class CentreHits:
    """What the middle rays of n pixels met; inf, -1, NaN and cosine 0 where they met nothing.

    Of each (n,): metres, |cosine| between ray and normal and its angle in radians, face and surface id, and
    which the second device of a triangulation has `seen` too; without one, which met anything. `colour` (n,
    3) is sRGB in 0..1.
    """

    ranges: FloatArray
    cosine: FloatArray
    incidence: FloatArray
    face: NDArray[np.int32]
    surface: NDArray[np.int32]
    seen: BoolArray
    colour: NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class World:
    """A scene and its prepared mesh, for rays from the pose of a sensor.

    `partner` is the second device of a triangulation; what is not cast is done on all cores when `n_threads`
    is None.
    """

    scene: Scene
    caster: RayCaster
    world_from_sensor: Pose
    partner: Partner | None = None
    n_threads: int | None = None

    def cast(self, origins: FloatArray, directions: FloatArray) -> tuple[Hits, BoolArray]:
        """Return the first hits (n,) of world rays, and which of them the second device sees too.

        The rays are those of an image (rows, columns, 3), or of beams one after the other (n, 3).
        """
        hits = self.caster.first_hit(origins, directions).flat()
        seen = hits.hit
        if self.partner is None:
            return hits, seen
        directions = directions.reshape(-1, 3)
        met = np.flatnonzero(seen)
        along = directions[met] / np.linalg.norm(directions[met], axis=1, keepdims=True)
        points = (origins if len(origins) == 1 else origins[met]) + along * hits.ranges[met, None]
        normals = _normals(self.scene.mesh, hits.face[met])
        seen = seen.copy()
        seen[met] = both_see(
            self.caster,
            points,
            directions=along,
            normals=normals,
            partner=self.partner,
            world_from_sensor=self.world_from_sensor,
        )
        return hits, seen

    def colour(self, hits: Hits) -> NDArray[np.float32]:
        """Colour (n, 3) of what was met, mid grey where the scene has none or nothing was met."""
        look = self.scene.mesh.appearance
        if look is None:
            return np.full((len(hits.face), 3), _GREY, np.float32)
        return look.colour(
            hits.face, hits.barycentric, _GREY, 1 if len(hits.face) <= _BAND else self.n_threads
        )

    def reflectivity(self, hits: Hits, intensity: Intensity) -> FloatArray:
        """Share of light (n,) that the surfaces scatter: the given one, or that of their colours."""
        if intensity.reflectivity is not None:
            return np.full(len(hits.face), intensity.reflectivity)
        if self.scene.mesh.appearance is None:
            return np.full(len(hits.face), reflectivity_of_colour(np.full(3, _GREY, np.float32)))
        return reflectivity_of_colour(self.colour(hits))

    def sight(self, rays: RayGrid) -> CentreHits:
        """Cast the rays of an image and describe what they meet, band by band of rows.

        What one band needs on the way stays in the processor's cache and is gone before the next.
        """
        rows, columns = len(rays.scale), len(rays.right)
        n, face_surface = rows * columns, self.scene.mesh.face_surface
        origin, rotation = self.world_from_sensor.translation[None], self.world_from_sensor.rotation
        ranges, cosine, incidence = (np.empty(n) for _ in range(3))
        face, surface = np.empty(n, np.int32), np.empty(n, np.int32)
        seen, colour = np.empty(n, np.bool_), np.empty((n, 3), np.float32)
        height = max(_BAND // columns // 4, 1) * 4

        def look(bands: slice) -> None:
            band = slice(bands.start * height, min(bands.stop * height, rows))
            part = slice(band.start * columns, band.stop * columns)
            hits, seen[part] = self.cast(origin, rays.of_rows(band).directions(rotation, 1))
            missed = ~hits.hit
            ranges[part], cosine[part], face[part] = hits.ranges, hits.incidence_cosine, hits.face
            colour[part] = self.colour(hits)
            np.arccos(hits.incidence_cosine, out=incidence[part])
            if len(face_surface):
                np.take(face_surface, hits.face, out=surface[part], mode="wrap")  # -1 is written over
            surface[part][missed], incidence[part][missed] = -1, np.nan

        in_blocks(
            -(-rows // height), look, self.n_threads, block=1, bytes_a_block=_BYTES_A_RAY * height * columns
        )
        return CentreHits(
            ranges=ranges,
            cosine=cosine,
            incidence=incidence,
            face=face,
            surface=surface,
            seen=seen,
            colour=colour,
        )


def _normals(mesh: LabelledMesh, faces: NDArray[np.int32]) -> FloatArray:
    """Unit normals (n, 3) of some faces."""
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces[faces]], 1, 0)
    normals = np.cross(b - a, c - a)
    unit: FloatArray = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    return unit


def footprint_echo(
    world: World, directions: FloatArray, footprint: Footprint, intensity: Intensity, rng: np.random.Generator
) -> Echo:
    """Return the echoes of beams along unit `directions` (n, 3), world frame, from the world's sensor.

    One uniform number is drawn for every beam: how its pattern of rays is turned.
    """
    origin, which = world.world_from_sensor.translation, get_args(Returns).index(footprint.returns)
    out, turns = np.empty((4, len(directions))), 2 * np.pi * rng.random(len(directions))
    chunk = rows_within(_BYTES_A_RAY * N_RAYS, _CHUNK)
    for start in range(0, len(directions), chunk):
        part = slice(start, min(start + chunk, len(directions)))
        starts, along = sub_rays(directions[part], footprint, turns[part])
        hits, seen = world.cast(starts + origin, along)
        rho = world.reflectivity(hits, intensity)
        ranges, cosine = np.where(seen, hits.ranges, np.inf), hits.incidence_cosine
        ranges, cosine, rho = (array.reshape(-1, N_RAYS) for array in (ranges, cosine, rho))
        merged = np.empty((4, len(ranges)))
        merge_returns(ranges, cosine, rho, which, footprint.range_resolution_m, merged)
        out[:, part] = merged
    ranges, cosine, rho, count = out
    return Echo(ranges, cosine, np.arccos(np.minimum(cosine, 1.0)), rho, count.astype(np.uint8))


FIRST, STRONGEST, LAST, MEAN = range(4)  # in the order of `nbv.scanning.beam.Returns`


@compiled
def merge_returns(
    ranges: FloatArray,
    cosine: FloatArray,
    reflectivity: FloatArray,
    which: int,
    resolution: float,
    out: FloatArray,
) -> None:
    """Write range, cosine, reflectivity and ray count of the chosen return of each beam to `out` (4, n)."""
    for beam in range(ranges.shape[0]):
        order = np.argsort(ranges[beam])
        best_light, chosen = -1.0, (np.inf, 0.0, 0.0, 0.0)
        light = reach = slope = white = 0.0
        count = 0
        last = -np.inf
        for k in range(order.size + 1):
            r = ranges[beam, order[k]] if k < order.size else np.inf
            apart = r - last > resolution and which != MEAN
            if count and (apart or r == np.inf):
                better = which == LAST or (which == STRONGEST and light > best_light) or best_light < 0
                if better:
                    best_light = light
                    chosen = (reach / light, slope / light, white / light, float(count))
                light = reach = slope = white = 0.0
                count = 0
            if r == np.inf:
                break
            cos, rho = cosine[beam, order[k]], reflectivity[beam, order[k]]
            weight = max(rho * cos, 1e-12) / (r * r + 1e-12)
            light += weight
            reach += weight * r
            slope += weight * cos
            white += weight * rho
            count += 1
            last = r
        for channel in range(4):
            out[channel, beam] = chosen[channel]


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
    pose, sensor = _resolve_view(view, sensor)
    if effects is not None and noise != "none":
        raise InputError(f"give noise or effects, not both; noise is {noise!r}")
    effects = effects or chosen_effects(sensor, noise)
    streams = stage_streams(rng, _DRAWING)
    projection = sensor.projection
    world = World(scene, caster or scene.ray_caster(n_threads), pose, sensor.partner, n_threads)

    sight = world.sight(projection.ray_grid())
    echo = _echo(world, projection, sight, effects, streams["footprint"])
    intensity = _intensity(echo, effects)
    distance = _receive(echo, intensity, sensor, effects, streams["dropout"])
    is_depth = projection.kind == "pinhole" and effects.acts_on_depth
    axis = projection.directions()[..., 2].reshape(-1) if is_depth else 1.0
    distance, variance = _disturb(
        distance, echo, axis=axis, effects=effects, rng=streams["noise"], n_threads=n_threads
    )
    points = _displace_points(distance, echo, projection, effects, streams["pointing"])
    if points is not None:
        distance = np.where(np.isfinite(distance), np.linalg.norm(points, axis=-1), np.inf)
    gated = (distance >= sensor.min_range_m) & (distance <= sensor.max_range_m)
    shape = projection.shape
    return RangeImage(
        np.where(gated, distance, np.inf).reshape(shape),
        projection,
        pose,
        colour=_freeze_image(sight.colour, (*shape, 3)),
        sensor_points=None if points is None else _freeze_image(points, (*shape, 3)),
        sigma_m=_rms(variance, gated, effects),
        sensor=sensor.name,
        noise=effects.describe(),
        intensity=None if effects.intensity is None else np.where(gated, intensity, 0).reshape(shape),
        truth=_truth_of(sight, echo, shape) if truth else None,
        name=name,
    )


def _resolve_view(view: View | Pose, sensor: Sensor | None) -> tuple[Pose, Sensor]:
    """Return where the scan is taken, and by what."""
    if isinstance(view, View):
        return view.world_from_sensor, sensor or view.sensor
    if sensor is None:
        raise InputError("a pose does not say what scans there: give a sensor too, or a View")
    return view, sensor


def _echo(
    world: World, projection: Projection, sight: CentreHits, effects: Effects, rng: np.random.Generator
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


def _receive(
    echo: Echo, intensity: NDArray[np.float32], sensor: Sensor, effects: Effects, rng: np.random.Generator
) -> FloatArray:
    """Return the ranges of the echoes that lie in a circular aperture and are not dropped; inf for others."""
    ranges = echo.ranges
    if isinstance(sensor, PinholeSensor) and sensor.aperture == "circular":
        ranges = np.where(sensor.sees(sensor.projection.directions().reshape(-1, 3)), ranges, np.inf)
    if effects.dropout is None:
        return ranges
    return np.where(effects.dropout.draw_kept(intensity, echo.incidence, rng), ranges, np.inf)


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
    distance: FloatArray, echo: Echo, projection: Projection, effects: Effects, rng: np.random.Generator
) -> FloatArray | None:
    """Return measured points (n, 3), sensor frame, that leave their rays; None where none do."""
    if effects.pointing is None:
        return None
    rays = projection.directions().reshape(-1, 3)
    return effects.pointing.displace(distance, echo.incidence, projection, rays, rng)


def _freeze_image(array: Any, shape: tuple[int, ...]) -> Any:
    """Return `array` in its image's shape, read-only: it is handed over, not copied."""
    array.setflags(write=False)
    return array.reshape(shape)


def _truth_of(sight: CentreHits, echo: Echo, shape: tuple[int, int]) -> ScanTruth:
    """Return what the middle rays met, and how many rays make each echo."""
    return ScanTruth(
        face=_freeze_image(sight.face, shape),
        surface=_freeze_image(sight.surface, shape),
        ranges=_freeze_image(sight.ranges, shape),
        incidence=_freeze_image(sight.incidence, shape),
        n_rays=echo.n_rays.reshape(shape),
    )


def _rms(variance: FloatArray | float, gated: BoolArray, effects: Effects) -> float | None:
    """Typical standard deviation in metres of the pixels that came back."""
    if effects.footprint is not None and effects.noise is None:
        return None
    if not gated.any():
        return 0.0
    return float(np.sqrt(variance if np.ndim(variance) == 0 else np.mean(variance, where=gated)))
