# SPDX-License-Identifier: MIT
"""Drawing: meshes seen by a camera, back faces left out, with what is unknown hatched."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from nbv.report.figures.picture import INFERRED, MEASURED, UNKNOWN, Camera, dots, hatch
from scenes.checks import BoolArray, FloatArray
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.rays.raycast import RayCaster
from scenes.run.mapping import trim
from scenes.scan.range_image import RangeImage

_LAYERS = 12  # faces seen from behind, or not shown, that a ray may pass
_STEPS = 32  # places along a ray at which it is asked whether they are hidden
_COARSE = 2  # pixels that share this answer, along each axis
_LIGHT = np.array([0.25, -0.35, 0.9]) / np.linalg.norm([0.25, -0.35, 0.9])


@dataclass(frozen=True, slots=True, eq=False)
class SeenFaces:
    """First faces seen from their front: face (rows, columns), -1 for none, its point, weights and cosine."""

    face: NDArray[np.int64]
    points: FloatArray
    weights: FloatArray
    cosine: FloatArray

    @property
    def hit(self) -> BoolArray:
        """Pixels (rows, columns) in which anything is seen."""
        return self.face >= 0


class MeshDrawing:
    """A mesh prepared for drawing; `front` (m, 3) are its faces' fronts, else the winding says.

    `caster` is the mesh prepared for ray casting, where there is one already.
    """

    def __init__(
        self,
        mesh: LabelledMesh,
        front: FloatArray | None = None,
        n_threads: int | None = None,
        *,
        caster: RayCaster | None = None,
    ) -> None:
        self.mesh = mesh
        self.front = mesh.face_normals() if front is None else front
        self._caster = caster or RayCaster(mesh.vertices, mesh.faces, n_threads)

    def look(
        self, camera: Camera, shape: tuple[int, int], shown: NDArray[np.bool_] | None = None
    ) -> SeenFaces:
        """Return what each pixel sees; of the faces `shown` (m,) alone where they are given."""
        ways = camera.rays(shape).reshape(-1, 3)
        n = len(ways)
        face, cosine = np.full(n, -1, np.int64), np.zeros(n)
        points, weights = np.full((n, 3), np.nan), np.zeros((n, 3))
        start, pending = camera.origin[None], np.arange(n)
        for _ in range(_LAYERS):
            hits = self._caster.first_hit(start, ways)
            met = np.flatnonzero(hits.hit)
            if not len(met):
                break
            pending, ways, behind = pending[met], ways[met], start if len(start) == 1 else start[met]
            reached = behind + ways * hits.ranges[met, None]
            facing = -np.einsum("ij,ij->i", ways, self.front[hits.face[met]])
            seen = facing > 0 if shown is None else (facing > 0) & shown[hits.face[met]]
            done, from_hit = pending[seen], met[seen]
            face[done], points[done] = hits.face[from_hit], reached[seen]
            weights[done], cosine[done] = hits.barycentric[from_hit], facing[seen]
            pending, ways = pending[~seen], ways[~seen]
            start = reached[~seen] + ways * 1e-4
        return SeenFaces(
            face.reshape(shape), points.reshape(*shape, 3), weights.reshape(*shape, 3), cosine.reshape(shape)
        )

    def colour(self, layer: SeenFaces) -> FloatArray:
        """Return the shaded colour (rows, columns, 4) of a layer; see-through where nothing is seen."""
        image = np.zeros((*layer.face.shape, 4))
        hit = layer.hit
        plain = np.full((int(hit.sum()), 3), 0.72)
        appearance = self.mesh.appearance
        if appearance is not None:
            plain = appearance.colour(layer.face[hit].astype(np.int32), layer.weights[hit])
        image[hit, :3] = plain * self.shade(layer)[hit, None]
        image[hit, 3] = 1.0
        return image

    def shade(self, layer: SeenFaces) -> FloatArray:
        """Brightness (rows, columns) of each pixel by the slope of its face to the camera and the light."""
        normal = self.front[np.maximum(layer.face, 0)]
        light = 0.5 + 0.5 * (normal @ _LIGHT)
        shade: FloatArray = 0.66 + 0.16 * layer.cosine + 0.20 * light
        return shade


def paint_states(
    state: NDArray[np.int64], shade: FloatArray, colours: Mapping[int, tuple[float, ...]]
) -> FloatArray:
    """Return the image (rows, columns, 4) of shaded states (rows, columns), see-through without one."""
    image = np.zeros((*state.shape, 4))
    for value, colour in colours.items():
        here = state == value
        image[here, :3] = np.minimum(1.15 * np.array(colour) * shade[here, None], 1.0)
        image[here, 3] = 1.0
    return image


def mark_inferred(image: FloatArray, where: BoolArray, shade: FloatArray) -> FloatArray:
    """Return the image (rows, columns, 4), pixels `where` (rows, columns) coloured as inferred."""
    painted = image.copy()
    painted[where, :3] = np.array(INFERRED) * (0.35 + 0.75 * shade[where, None])
    painted[where, 3] = 1.0
    return painted


def mark_modelled(image: FloatArray, where: BoolArray, shade: FloatArray) -> FloatArray:
    """Return the image (rows, columns, 4), pixels at `where` (rows, columns) dotted as what is modelled."""
    painted = image.copy()
    opacity = dots(where.shape)[where][:, None]
    dot = 0.85 * np.array(MEASURED) * shade[where, None]
    painted[where, :3] = opacity * dot + (1 - opacity) * painted[where, :3]
    return painted


def mark_pattern(image: FloatArray, where: BoolArray, pattern: Literal["hatched", "dotted"]) -> FloatArray:
    """Return the image (rows, columns, 4), white stripes or grey dots over pixels `where` (rows, columns)."""
    painted = image.copy()
    laid = 1 - hatch(where.shape) if pattern == "hatched" else dots(where.shape)
    opacity = laid[where][:, None]
    tone = 1.0 if pattern == "hatched" else 0.5
    painted[where, :3] = opacity * tone + (1 - opacity) * painted[where, :3]
    return painted


def mark_unknown(image: FloatArray, where: BoolArray) -> FloatArray:
    """Return the image (rows, columns, 4), pixels at `where` (rows, columns) hatched as what is unknown."""
    painted = image.copy()
    opacity = hatch(where.shape)[where]
    painted[where, :3] = UNKNOWN
    painted[where, 3] = opacity
    return painted


def mark_hatched(image: FloatArray, where: BoolArray) -> FloatArray:
    """Return the image (rows, columns, 4), pixels at `where` (rows, columns) hatched on white as unknown."""
    laid = mark_unknown(image, where)
    opacity = laid[where, 3:]
    laid[where, :3] = opacity * laid[where, :3] + (1 - opacity)
    laid[where, 3] = 1.0
    return laid


def passes_hidden(
    camera: Camera,
    where: BoolArray,
    scans: Sequence[RangeImage],
    bounds: FloatArray,
    *,
    beside_counts: bool = False,
) -> BoolArray:
    """Tell which of the pixels `where` look, within `bounds` (2, 3), through space hidden from all scans.

    A place counts as hidden when some scan measured something before it and none looked through it; with
    `beside_counts` also when it lies beside every scan's field of view. Pixels are asked for in small blocks.
    """
    rows, columns = (-(-side // _COARSE) for side in where.shape)
    block = np.zeros((rows, columns), dtype=np.bool_)
    np.logical_or.at(block, tuple(index // _COARSE for index in np.nonzero(where)), True)
    asked = np.flatnonzero(block)
    rays = camera.rays((rows, columns)).reshape(-1, 3)[asked]
    nearest, farthest = _through_box(camera.origin, rays, bounds)
    hidden = np.zeros(len(rays), dtype=np.bool_)
    for share in (np.arange(_STEPS) + 0.5) / _STEPS:
        pending = np.flatnonzero(~hidden & (farthest > nearest))
        reach = nearest[pending] + (farthest - nearest)[pending] * share
        behind, through = _seen_from(scans, camera.origin + rays[pending] * reach[:, None])
        hidden[pending] = ~through if beside_counts else behind & ~through
    block.ravel()[asked] = hidden
    fine = np.repeat(np.repeat(block, _COARSE, axis=0), _COARSE, axis=1)
    return np.asarray(fine[: where.shape[0], : where.shape[1]] & where, dtype=np.bool_)


def _seen_from(scans: Sequence[RangeImage], places: FloatArray) -> tuple[BoolArray, BoolArray]:
    """Tell which places (n, 3) lie behind what some scan measured, and through which some beam went."""
    behind, through = np.zeros((2, len(places)), dtype=np.bool_)
    for scan in scans:
        trim()
        pixels = scan.pixels(places)
        inside = np.flatnonzero(np.isfinite(pixels).all(axis=1))
        limit = np.array(scan.shape) - 1
        row, column = np.clip(np.rint(pixels[inside]).astype(np.int64), 0, limit).T
        measured, distance = scan.ranges[row, column], np.linalg.norm(places[inside] - scan.origin, axis=1)
        behind[inside] |= np.isfinite(measured) & (measured < 0.97 * distance - 0.01)
        through[inside] |= np.isfinite(measured) & (measured >= distance)
    return behind, through


def _through_box(origin: FloatArray, rays: FloatArray, bounds: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Range (n,) at which each ray enters a box and leaves it; it misses where the first is the larger."""
    safe = np.where(np.abs(rays) > 1e-12, rays, 1e-12)
    ends = np.sort((bounds[:, None] - origin) / safe, axis=0)
    return np.maximum(ends[0].max(axis=1), 0.0), ends[1].min(axis=1)
