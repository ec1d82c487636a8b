# SPDX-License-Identifier: MIT
"""Echo: what comes back along each pixel's beam, before an instrument has erred about it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from nbv.scanning.beam import N_RAYS, Footprint, Intensity, Returns, reflectivity_of_colour, sub_rays
from nbv.scanning.sensor import Partner
from nbv.scanning.triangulation import both_see
from scenes.checks import BoolArray, FloatArray
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.pose import Pose
from scenes.rays.raycast import Hits, RayCaster
from scenes.run.memory import in_blocks, rows_within
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
class Sight:
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

    def sight(self, rays: RayGrid) -> Sight:
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
        return Sight(
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
        merge_returns(ranges, cosine, rho, which, footprint.range_resolution_m, out[:, part])
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
