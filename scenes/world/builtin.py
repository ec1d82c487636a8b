# SPDX-License-Identifier: MIT
"""Scene building: rectangles, boxes and cylinders with true surfaces, labels and textures, put together."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from skimage import data as images

from scenes.checks import ColourArray, FloatArray, InputError
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


PLASTER = Finish((0.86, 0.84, 0.80))
_WOOD = Finish((0.62, 0.42, 0.24))
_CARTON = Finish((0.72, 0.58, 0.40))
_STEEL = Finish((0.55, 0.62, 0.70))


def brick(size_m: float = 3.2) -> Finish:
    """Red brick, one repetition `size_m` metres wide."""
    return Finish((0.86, 0.52, 0.40), _texture("brick"), size_m)


def gravel(size_m: float = 2.4) -> Finish:
    """Grey gravel, one repetition `size_m` metres wide."""
    return Finish((0.78, 0.76, 0.72), _texture("gravel"), size_m)


def grass(size_m: float = 2.0) -> Finish:
    """Green grass, one repetition `size_m` metres wide."""
    return Finish((0.55, 0.78, 0.42), _texture("grass"), size_m)


@cache
def _texture(name: str) -> ColourArray:
    """One of scikit-image's CC0 textures as RGB: contrast stretched, mirrored so that it repeats."""
    grey = np.asarray(getattr(images, name)(), dtype=np.float64).T
    low, high = np.percentile(grey, [0.5, 99.5])
    stretched = np.clip((grey - low) / (high - low), 0, 1) * 0.7 + 0.3
    tile = np.block([[stretched, stretched[:, ::-1]], [stretched[::-1], stretched[::-1, ::-1]]])
    image = np.repeat((tile * 255).round().astype(np.uint8)[..., None], 3, axis=2)
    image.setflags(write=False)
    return image


def two_occluders() -> Scene:
    """A room of 6 x 5 x 2.7 m with two boxes on the floor, after the summary paper's simple room."""
    build = SceneBuilder("two_occluders", "room")
    x, y, z = np.diag([6.0, 5.0, 2.7])
    origin = np.zeros(3)
    build.add_rectangle("floor", origin, x, y, gravel())
    build.add_rectangle("ceiling", z + y, x, -y, PLASTER)
    build.add_rectangle("wall x=0", origin, y, z, brick())
    build.add_rectangle("wall x=6", x + y, -y, z, brick())
    build.add_rectangle("wall y=0", x, -x, z, brick())
    build.add_rectangle("wall y=5", y, x, z, brick())
    build.add_box("low box", (1.5, 1.5, 0.0), (2.9, 2.5, 0.9), Finish((0.36, 0.50, 0.72)))
    build.add_box("tall box", (4.0, 2.8, 0.0), (4.7, 3.5, 1.8), Finish((0.85, 0.72, 0.38)))
    return build.finish()


def office() -> Scene:
    """Half a room of 4 x 4 x 2.6 m with window and door opening, table, crate, box, post and column.

    The surface `outside` is what is seen through the openings.
    """
    build = SceneBuilder("office", "room")
    _add_corner(build, [(2.1, 1.0, 3.0, 1.9), (0.2, 0.0, 0.8, 2.0)])
    build.add_rectangle("outside", (6, 6, -1), (0, -8, 0), (0, 0, 5), grass(4.0))
    _add_box_and_post(build)
    build.add_box("table", (2.4, 0.7, 0.7), (3.4, 1.3, 0.74), _WOOD, yaw=0.1)
    build.add_box("crate", (1.875, 1.025, 0.6), (2.125, 1.275, 1.3), Finish((0.75, 0.35, 0.28)), yaw=0.2)
    build.add_cylinder("column", (3.1, 3.3, 0.0), (0, 0, 2.6), 0.15, PLASTER, caps=False)
    return build.finish()


def drum_and_post() -> Scene:
    """The corner of a room of 4 x 4 x 2.6 m with a box, a thin post, a column and a drum with its cap."""
    build = SceneBuilder("drum_and_post", "room")
    _add_corner(build)
    _add_box_and_post(build)
    build.add_cylinder("column", (3.1, 3.3, 0.0), (0, 0, 2.6), 0.15, PLASTER)
    build.add_cylinder("drum", (2.9, 1.5, 0.0), (0, 0, 1.1), 0.25, _STEEL)
    return build.finish()


def _add_corner(build: SceneBuilder, holes: Sequence[tuple[float, float, float, float]] = ()) -> None:
    """Add floor, ceiling and the two far walls; `holes` are cut into the wall x = 4, from its end y = 4."""
    x, y, z = np.diag([4.0, 4.0, 2.6])
    build.add_rectangle("floor", (0, 0, 0), x, y, gravel())
    build.add_rectangle("ceiling", z + y, x, -y, PLASTER)
    build.add_panel("wall x=4", x + y, u=-y, v=z, finish=brick(), holes=holes)
    build.add_rectangle("wall y=4", y, x, z, PLASTER)


def _add_box_and_post(build: SceneBuilder) -> None:
    build.add_box("box", (2.05, 1.75, 0.0), (2.65, 2.25, 0.9), _CARTON, yaw=0.35)
    build.add_box("post", (1.49, 2.39, 0.0), (1.61, 2.51, 1.2), Finish((0.36, 0.50, 0.72)))


def chair_before_wall() -> Scene:
    """A brick wall and a gravel floor behind a chair whose back has five slats."""
    build = SceneBuilder("chair_before_wall", "object")
    build.add_rectangle("wall", (-1.5, 1.2, 0.0), (3.0, 0, 0), (0, 0, 2.2), brick())
    build.add_rectangle("floor", (-1.5, -1.0, 0.0), (3.0, 0, 0), (0, 2.2, 0), gravel())
    build.add_box("seat", (-0.24, 0.20, 0.42), (0.24, 0.66, 0.46), _WOOD)
    for i, (x, y) in enumerate([(-0.24, 0.20), (0.20, 0.20), (-0.24, 0.62), (0.20, 0.62)]):
        build.add_box(f"leg {i + 1}", (x, y, 0.0), (x + 0.04, y + 0.04, 0.42), _WOOD)
    for i, x in enumerate(np.linspace(-0.24, 0.20, 5)):
        build.add_box(f"slat {i + 1}", (x, 0.62, 0.46), (x + 0.04, 0.65, 0.92), _WOOD)
    build.add_box("top rail", (-0.26, 0.61, 0.92), (0.26, 0.66, 1.02), _WOOD)
    return build.finish()


def two_cylinders() -> Scene:
    """Two upright cylinders behind a closer board that hides the middle of both (the paper's figure 9)."""
    build = SceneBuilder("two_cylinders", "object")
    build.add_rectangle("floor", (-1.5, -1.2, 0.0), (3.0, 0, 0), (0, 2.4, 0), gravel())
    build.add_cylinder("left cylinder", (-0.40, 0.5, 0.0), (0, 0, 1.8), 0.22, brick(1.6))
    build.add_cylinder("right cylinder", (0.42, 0.6, 0.0), (0, 0, 1.8), 0.16, Finish((0.55, 0.62, 0.70)))
    build.add_box("board", (-1.1, -0.42, 0.75), (1.1, -0.38, 1.15), Finish((0.85, 0.80, 0.62)))
    for side, x in (("left", -1.12), ("right", 1.08)):
        build.add_box(f"{side} stand", (x, -0.42, 0.0), (x + 0.04, -0.38, 1.15), Finish((0.4, 0.4, 0.42)))
    return build.finish()


def textured_cylinder() -> Scene:
    """A brick column with a narrow board before it: its texture must go on behind (the paper's figure 10)."""
    build = SceneBuilder("textured_cylinder", "object")
    build.add_rectangle("floor", (-1.2, -1.2, 0.0), (2.4, 0, 0), (0, 2.4, 0), grass())
    build.add_cylinder("column", (0.0, 0.4, 0.0), (0, 0, 2.0), 0.35, brick(2.0))
    build.add_box("board", (-0.12, -0.35, 0.0), (0.10, -0.32, 1.5), Finish((0.80, 0.78, 0.70)))
    return build.finish()


def engaged_column() -> Scene:
    """A half column engaged in a brick wall, a board before both: the column is cut at the wall."""
    build = SceneBuilder("engaged_column", "object")
    build.add_rectangle("floor", (-1.5, -1.2, 0.0), (3.0, 0, 0), (0, 2.4, 0), gravel())
    column = [(1.5 - 0.25, 0.0, 1.5 + 0.25, 2.0)]  # the wall is not there where the column is
    build.add_panel(
        "wall",
        (-1.5, 1.2, 0.0),
        u=(3.0, 0, 0),
        v=(0, 0, 2.3),
        finish=brick(),
        holes=column,
        are_openings=False,
    )
    build.add_cylinder("column", (0, 1.2, 0), (0, 0, 2.0), 0.25, PLASTER, facing=(0, -1, 0))
    build.add_box("board", (-0.7, 0.25, 0.0), (0.9, 0.30, 0.95), Finish((0.85, 0.80, 0.62)))
    return build.finish()


def pipe_rack() -> Scene:
    """Pipes along a wall, before and behind each other, and a cabinet that hides the middle of them."""
    build = SceneBuilder("pipe_rack", "object")
    build.add_rectangle("floor", (-1.8, -1.2, 0.0), (3.6, 0, 0), (0, 2.4, 0), gravel())
    build.add_rectangle("wall", (-1.8, 1.2, 0.0), (3.6, 0, 0), (0, 0, 2.4), brick())
    paints = (Finish((0.30, 0.55, 0.35)), Finish((0.80, 0.68, 0.20)), Finish((0.35, 0.50, 0.75)))
    pipes = (
        (0.95, 0.55, 0.09),
        (0.95, 0.95, 0.06),
        (0.95, 1.45, 0.11),
        (0.62, 0.75, 0.05),
        (0.62, 1.25, 0.075),
    )
    for i, (y, z, radius) in enumerate(pipes):
        build.add_cylinder(f"pipe {i + 1}", (-1.5, y, z), (3.0, 0, 0), radius, paints[i % 3])
    for side, x in (("left", -1.35), ("right", 1.27)):
        build.add_box(f"{side} stand", (x, 1.07, 0.0), (x + 0.08, 1.15, 1.75), Finish((0.42, 0.42, 0.45)))
    build.add_box("cabinet", (-0.45, -0.10, 0.0), (0.35, 0.25, 1.35), Finish((0.72, 0.72, 0.70)))
    return build.finish()


_SCENES: dict[str, Callable[[], Scene]] = {
    scene.__name__: scene
    for scene in (two_occluders, chair_before_wall, two_cylinders, textured_cylinder)
    + (office, drum_and_post, engaged_column, pipe_rack)
}


def builtin_names() -> tuple[str, ...]:
    """Names that `builtin_scene` knows, in order."""
    return tuple(_SCENES)


def builtin_scene(name: str) -> Scene:
    """Return a built-in scene.

    Parameters
    ----------
    name : str
        One of `builtin_names()`.

    Raises
    ------
    InputError
        No such scene; the message lists those there are.

    Examples
    --------
    >>> builtin_scene("two_occluders").surface_names[:2]
    ('floor', 'ceiling')
    """
    if name not in _SCENES:
        raise InputError(f"no built-in scene is called {name!r}; there are {', '.join(_SCENES)}")
    return _SCENES[name]()
