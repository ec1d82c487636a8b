# SPDX-License-Identifier: MIT
"""Built-in scenes: procedural, textured, with the true surface of every face."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
from numpy.typing import NDArray
from skimage import data as images

from scenes.building import Finish, SceneBuilder
from scenes.checks import InputError
from scenes.scene import Scene

_PLASTER = Finish((0.86, 0.84, 0.80))


@cache
def _texture(name: str) -> NDArray[np.uint8]:
    """One of scikit-image's CC0 textures as RGB: contrast stretched, mirrored so that it repeats."""
    grey = np.asarray(getattr(images, name)(), dtype=np.float64).T
    low, high = np.percentile(grey, [0.5, 99.5])
    stretched = np.clip((grey - low) / (high - low), 0, 1) * 0.7 + 0.3
    tile = np.block([[stretched, stretched[:, ::-1]], [stretched[::-1], stretched[::-1, ::-1]]])
    image = np.repeat((tile * 255).round().astype(np.uint8)[..., None], 3, axis=2)
    image.setflags(write=False)
    return image


def _brick(size_m: float = 3.2) -> Finish:
    return Finish((0.86, 0.52, 0.40), _texture("brick"), size_m)


def _gravel(size_m: float = 2.4) -> Finish:
    return Finish((0.78, 0.76, 0.72), _texture("gravel"), size_m)


def _grass(size_m: float = 2.0) -> Finish:
    return Finish((0.55, 0.78, 0.42), _texture("grass"), size_m)


def two_occluders() -> Scene:
    """A room of 6 x 5 x 2.7 m with two boxes on the floor, after the summary paper's simple room."""
    build = SceneBuilder("two_occluders", "room")
    x, y, z = np.diag([6.0, 5.0, 2.7])
    origin = np.zeros(3)
    build.add_rectangle("floor", origin, x, y, _gravel())
    build.add_rectangle("ceiling", z + y, x, -y, _PLASTER)
    build.add_rectangle("wall x=0", origin, y, z, _brick())
    build.add_rectangle("wall x=6", x + y, -y, z, _brick())
    build.add_rectangle("wall y=0", x, -x, z, _brick())
    build.add_rectangle("wall y=5", y, x, z, _brick())
    build.add_box("low box", (1.5, 1.5, 0.0), (2.9, 2.5, 0.9), Finish((0.36, 0.50, 0.72)))
    build.add_box("tall box", (4.0, 2.8, 0.0), (4.7, 3.5, 1.8), Finish((0.85, 0.72, 0.38)))
    return build.finish()


def chair_before_wall() -> Scene:
    """A brick wall and a gravel floor behind a chair whose back has five slats."""
    build = SceneBuilder("chair_before_wall", "object")
    wood = Finish((0.62, 0.42, 0.24))
    build.add_rectangle("wall", (-1.5, 1.2, 0.0), (3.0, 0, 0), (0, 0, 2.2), _brick())
    build.add_rectangle("floor", (-1.5, -1.0, 0.0), (3.0, 0, 0), (0, 2.2, 0), _gravel())
    build.add_box("seat", (-0.24, 0.20, 0.42), (0.24, 0.66, 0.46), wood)
    for i, (x, y) in enumerate([(-0.24, 0.20), (0.20, 0.20), (-0.24, 0.62), (0.20, 0.62)]):
        build.add_box(f"leg {i + 1}", (x, y, 0.0), (x + 0.04, y + 0.04, 0.42), wood)
    for i, x in enumerate(np.linspace(-0.24, 0.20, 5)):
        build.add_box(f"slat {i + 1}", (x, 0.62, 0.46), (x + 0.04, 0.65, 0.92), wood)
    build.add_box("top rail", (-0.26, 0.61, 0.92), (0.26, 0.66, 1.02), wood)
    return build.finish()


def two_cylinders() -> Scene:
    """Two upright cylinders behind a closer board that hides the middle of both (the paper's figure 9)."""
    build = SceneBuilder("two_cylinders", "object")
    build.add_rectangle("floor", (-1.5, -1.2, 0.0), (3.0, 0, 0), (0, 2.4, 0), _gravel())
    build.add_cylinder("left cylinder", (-0.40, 0.5, 0.0), (0, 0, 1.8), 0.22, _brick(1.6))
    build.add_cylinder("right cylinder", (0.42, 0.6, 0.0), (0, 0, 1.8), 0.16, Finish((0.55, 0.62, 0.70)))
    build.add_box("board", (-1.1, -0.42, 0.75), (1.1, -0.38, 1.15), Finish((0.85, 0.80, 0.62)))
    for side, x in (("left", -1.12), ("right", 1.08)):
        build.add_box(f"{side} stand", (x, -0.42, 0.0), (x + 0.04, -0.38, 1.15), Finish((0.4, 0.4, 0.42)))
    return build.finish()


def textured_cylinder() -> Scene:
    """A brick column with a narrow board before it: its texture must go on behind (the paper's figure 10)."""
    build = SceneBuilder("textured_cylinder", "object")
    build.add_rectangle("floor", (-1.2, -1.2, 0.0), (2.4, 0, 0), (0, 2.4, 0), _grass())
    build.add_cylinder("column", (0.0, 0.4, 0.0), (0, 0, 2.0), 0.35, _brick(2.0))
    build.add_box("board", (-0.12, -0.35, 0.0), (0.10, -0.32, 1.5), Finish((0.80, 0.78, 0.70)))
    return build.finish()


_SCENES: dict[str, Callable[[], Scene]] = {
    scene.__name__: scene for scene in (two_occluders, chair_before_wall, two_cylinders, textured_cylinder)
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
