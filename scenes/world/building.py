# SPDX-License-Identifier: MIT
"""Scene building: rectangles, boxes and cylinders with true surfaces, labels and textures, put together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from scenes.checks import FloatArray
from scenes.mesh.labelled_mesh import Appearance, LabelledMesh
from scenes.surfaces.catalogue import Cylinder, Plane, Surface
from scenes.surfaces.surface import Opening
from scenes.world.scene import Mode, Scene

_N_FACETS = 256  # around a full cylinder; at r = 0.25 m the sagitta is 0.02 mm


@dataclass(frozen=True, slots=True, eq=False)
class Finish:
    """What a surface looks like: a tint times an optional repeating texture of `size_m` metres.

    Parameters
    ----------
    tint : (3,) float
        sRGB in 0..1.
    image : (h, w, 3) uint8, optional
        Texture that repeats.
    size_m : float
        Width of one repetition on the surface.
    """

    tint: tuple[float, float, float]
    image: NDArray[np.uint8] | None = None
    size_m: float = 1.6


@dataclass(slots=True)
class SceneBuilder:
    """Collects parts; `finish()` makes the Scene. Each part's chart carries its texture."""

    name: str
    mode: Mode
    _corners: list[FloatArray] = field(default_factory=list)
    _labels: list[NDArray[np.int32]] = field(default_factory=list)
    _uv: list[FloatArray] = field(default_factory=list)
    _finish: list[Finish] = field(default_factory=list)
    _surfaces: list[Surface] = field(default_factory=list)
    _names: list[str] = field(default_factory=list)
    _openings: list[Opening] = field(default_factory=list)

    def add_rectangle(self, name: str, corner: object, u: object, v: object, finish: Finish) -> None:
        """Add the rectangle from `corner` along edges `u` and `v` (metres); its normal is u x v."""
        origin, along, up = (np.asarray(x, dtype=np.float64) for x in (corner, u, v))
        plane = Plane(origin, np.cross(along, up), along)
        quad = np.stack([origin, origin + along, origin + along + up, origin + up])
        self._add(name, plane, quad[[[0, 1, 2], [0, 2, 3]]], finish)

    def add_panel(
        self,
        name: str,
        corner: object,
        u: object,
        v: object,
        finish: Finish,
        holes: Sequence[tuple[float, float, float, float]] = (),
        *,
        are_openings: bool = True,
    ) -> None:
        """Add a rectangle as `add_rectangle` does, less rectangular holes.

        Each hole is (u, v) of its near and of its far corner in metres along the edges from `corner`. They
        are openings that one sees through, unless `are_openings` says that something fills them.
        """
        origin, along, up = (np.asarray(x, dtype=np.float64) for x in (corner, u, v))
        width, height = float(np.linalg.norm(along)), float(np.linalg.norm(up))
        cut_u = np.unique([0.0, width, *(hole[k] for hole in holes for k in (0, 2))])
        cut_v = np.unique([0.0, height, *(hole[k] for hole in holes for k in (1, 3))])
        tiles = [
            (u0, v0, u1, v1)
            for u0, u1 in pairwise(cut_u)
            for v0, v1 in pairwise(cut_v)
            if not any(h[0] < (u0 + u1) / 2 < h[2] and h[1] < (v0 + v1) / 2 < h[3] for h in holes)
        ]

        def outline(tile: tuple[float, float, float, float]) -> FloatArray:
            across, high = along / width, up / height
            ring = ((0, 1), (2, 1), (2, 3), (0, 3))
            return np.stack([origin + tile[i] * across + tile[j] * high for i, j in ring])

        quads = np.stack([outline(tile) for tile in tiles])
        corners = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
        if are_openings:
            self._openings += [Opening(len(self._surfaces), outline(hole)) for hole in holes]
        self._add(name, Plane(origin, np.cross(along, up), along), corners, finish)

    def add_box(
        self, name: str, low: object, high: object, finish: Finish, *, inward: bool = False, yaw: float = 0.0
    ) -> None:
        """Add the six sides of an upright box, seen from outside or, `inward`, from within.

        `yaw` turns it about the vertical through its middle, radians, counter-clockwise seen from above.
        """
        a, b = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
        turn = np.array([[np.cos(yaw), np.sin(yaw), 0], [-np.sin(yaw), np.cos(yaw), 0], [0, 0, 1.0]])
        x, y, z = np.diag(b - a) @ turn
        if yaw:
            middle = np.array([*(a + b)[:2] / 2, a[2]])
            a = middle - (x + y) / 2
        sides = {
            "west": (a + y, -y, z),
            "east": (a + x, y, z),
            "south": (a, x, z),
            "north": (a + x + y, -x, z),
            "bottom": (a + y, x, -y),
            "top": (a + z, x, y),
        }
        for side, (corner, u, v) in sides.items():
            start, along = (corner + u, -u) if inward else (corner, u)
            self.add_rectangle(f"{name} {side}", start, along, v, finish)

    def add_cylinder(
        self,
        name: str,
        foot: object,
        axis: object,
        radius: float,
        finish: Finish,
        *,
        caps: bool = True,
        facing: object | None = None,
    ) -> None:
        """Add the cylinder from `foot` along `axis` (metres, its length the height), with caps as planes.

        With `facing`, a direction at right angles to the axis, only the half that looks that way is there.
        """
        start, along = np.asarray(foot, dtype=np.float64), np.asarray(axis, dtype=np.float64)
        height = float(np.linalg.norm(along))
        surface = Cylinder(start, along, radius, facing)
        reach = np.pi if facing is None else np.pi / 2
        n_facets = _N_FACETS if facing is None else _N_FACETS // 2
        arc = np.linspace(-reach, reach, n_facets + 1) * radius
        low = np.stack([arc, np.zeros_like(arc)], axis=1)
        high = np.stack([arc, np.full_like(arc, height)], axis=1)
        uv = np.concatenate([
            np.stack([low[:-1], low[1:], high[1:]], axis=1),
            np.stack([low[:-1], high[1:], high[:-1]], axis=1),
        ])  # fmt: skip
        self._add(name, surface, surface.from_uv(uv), finish, uv)
        if caps:
            for end, ring, normal in (("foot", low, -along), ("head", high, along)):
                plane = Plane(start if end == "foot" else start + along, normal)
                edge = surface.from_uv(ring)
                order = (edge[1:], edge[:-1]) if end == "foot" else (edge[:-1], edge[1:])
                centre = np.broadcast_to(plane.point, edge[1:].shape)
                self._add(f"{name} {end}", plane, np.stack([centre, *order], axis=1), finish)

    def finish(self) -> Scene:
        """Return the scene of all parts added so far."""
        corners = np.concatenate(self._corners)
        labels = np.concatenate(self._labels)
        images: list[NDArray[np.uint8]] = []
        face_image = np.full(len(labels), -1, np.int32)
        corner_uv = np.zeros((len(labels), 3, 2), np.float32)
        tint = np.ones((len(labels), 3, 3), np.float32)
        for surface, (look, uv) in enumerate(zip(self._finish, self._uv, strict=True)):
            here = labels == surface
            tint[here] = look.tint
            if look.image is None:
                continue
            known = next((i for i, image in enumerate(images) if image is look.image), None)
            if known is None:
                known = len(images)
                images.append(look.image)
            face_image[here] = known
            aspect = look.image.shape[1] / look.image.shape[0]
            corner_uv[here] = uv / look.size_m * np.array([1.0, aspect])
        vertices, index = np.unique(corners.reshape(-1, 3).round(12), axis=0, return_inverse=True)
        mesh = LabelledMesh(
            vertices,
            index.reshape(-1, 3).astype(np.int32),
            labels,
            Appearance(tint, tuple(images), face_image, corner_uv),
        )
        return Scene(
            mesh,
            tuple(self._surfaces),
            tuple(self._names),
            self.name,
            self.mode,
            openings=tuple(self._openings),
        )

    def _add(
        self, name: str, surface: Surface, corners: FloatArray, finish: Finish, uv: FloatArray | None = None
    ) -> None:
        self._corners.append(corners)
        self._labels.append(np.full(len(corners), len(self._surfaces), np.int32))
        self._uv.append(surface.to_uv(corners) if uv is None else uv)
        self._finish.append(finish)
        self._surfaces.append(surface)
        self._names.append(name)
