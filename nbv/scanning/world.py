# SPDX-License-Identifier: MIT
"""World: a scene as the rays of a sensor meet it: hits, colours, and the light that surfaces scatter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nbv.scanning.beam import Intensity, reflectivity_of_colour
from nbv.scanning.sensor import Partner
from nbv.scanning.triangulation import both_see
from scenes.checks import BoolArray, FloatArray
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.pose import Pose
from scenes.rays.raycast import Hits, RayCaster
from scenes.run.memory import in_blocks
from scenes.scan.ray_grid import RayGrid
from scenes.world.scene import Scene

_GREY = 0.5
BYTES_A_RAY = 200
"""Memory that casting one ray takes meanwhile."""
_BAND = 32_768  # pixels at a time: their rays and hits fit into a core's cache


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
class ColumnPoses:
    """Where a sensor that moves is while it scans each of m columns.

    `positions` (m, 3), metres, and `rotations` (m, 3, 3), world from sensor.
    """

    positions: FloatArray
    rotations: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class World:
    """A scene and its prepared mesh, for rays from the pose of a sensor, or the poses of its columns.

    `partner` is the second device of a triangulation; what is not cast is done on all cores when `n_threads`
    is None.
    """

    scene: Scene
    caster: RayCaster
    world_from_sensor: Pose
    partner: Partner | None = None
    n_threads: int | None = None
    motion: ColumnPoses | None = None

    def beams(self, rays: RayGrid, n_threads: int | None) -> tuple[FloatArray, FloatArray]:
        """Return origins and unit directions of the rays of an image: (1, 3) and (rows, columns, 3).

        Of a sensor that moves both are (n, 3), pixel by pixel.
        """
        if self.motion is None:
            turned = rays.directions(self.world_from_sensor.rotation, n_threads)
            return self.world_from_sensor.translation[None], turned
        local = rays.directions(np.eye(3), n_threads)
        turned = np.einsum("cij,rcj->rci", self.motion.rotations, local)
        origins = np.broadcast_to(self.motion.positions, turned.shape)
        return np.ascontiguousarray(origins).reshape(-1, 3), np.ascontiguousarray(turned).reshape(-1, 3)

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
        ranges, cosine, incidence = (np.empty(n) for _ in range(3))
        face, surface = np.empty(n, np.int32), np.empty(n, np.int32)
        seen, colour = np.empty(n, np.bool_), np.empty((n, 3), np.float32)
        height = max(_BAND // columns // 4, 1) * 4

        def look(bands: slice) -> None:
            band = slice(bands.start * height, min(bands.stop * height, rows))
            part = slice(band.start * columns, band.stop * columns)
            hits, seen[part] = self.cast(*self.beams(rays.of_rows(band), 1))
            missed = ~hits.hit
            ranges[part], cosine[part], face[part] = hits.ranges, hits.incidence_cosine, hits.face
            colour[part] = self.colour(hits)
            np.arccos(hits.incidence_cosine, out=incidence[part])
            if len(face_surface):
                np.take(face_surface, hits.face, out=surface[part], mode="wrap")  # -1 is written over
            surface[part][missed], incidence[part][missed] = -1, np.nan

        in_blocks(
            -(-rows // height), look, self.n_threads, block=1, bytes_a_block=BYTES_A_RAY * height * columns
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
