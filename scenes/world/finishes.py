# SPDX-License-Identifier: MIT
"""Finishes of the built-in scenes: plain tints, and scikit-image's CC0 textures made to repeat."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray
from skimage import data as images

from scenes.world.building import Finish

PLASTER = Finish((0.86, 0.84, 0.80))


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
def _texture(name: str) -> NDArray[np.uint8]:
    """One of scikit-image's CC0 textures as RGB: contrast stretched, mirrored so that it repeats."""
    grey = np.asarray(getattr(images, name)(), dtype=np.float64).T
    low, high = np.percentile(grey, [0.5, 99.5])
    stretched = np.clip((grey - low) / (high - low), 0, 1) * 0.7 + 0.3
    tile = np.block([[stretched, stretched[:, ::-1]], [stretched[::-1], stretched[::-1, ::-1]]])
    image = np.repeat((tile * 255).round().astype(np.uint8)[..., None], 3, axis=2)
    image.setflags(write=False)
    return image
