# SPDX-License-Identifier: MIT
"""Built-in scenes by name: procedural, textured, with the true surface of every face."""

from __future__ import annotations

from collections.abc import Callable

from scenes.checks import InputError
from scenes.world.builtin_objects import (
    chair_before_wall,
    engaged_column,
    pipe_rack,
    textured_cylinder,
    two_cylinders,
)
from scenes.world.builtin_rooms import drum_and_post, office, two_occluders
from scenes.world.scene import Scene

_SCENES: dict[str, Callable[[], Scene]] = {
    scene.__name__: scene
    for scene in (
        two_occluders,
        chair_before_wall,
        two_cylinders,
        textured_cylinder,
        office,
        drum_and_post,
        engaged_column,
        pipe_rack,
    )
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
