# SPDX-License-Identifier: MIT
"""State pictures: a scene from two opposite sides, its surface in the colours of what is known of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nbv.report.pictures.camera import overview_cameras
from nbv.report.pictures.drawing import MeshDrawing, blend, mark_modelled, mark_unknown
from nbv.report.pictures.picture import Picture, picture_of
from nbv.report.pictures.surface_values import nearest_samples
from nbv.report.viewer.framing import best_side
from nbv.visibility.samples import SurfaceSamples
from nbv.visibility.zones import EVERYWHERE, Zones
from scenes.world.scene import Scene

_WIDTH = 760
_OUTSIDE, _PALE, _AT_FACES_M = -2, (0.86, 0.86, 0.84), 1e-3  # of the region


@dataclass(frozen=True, slots=True, kw_only=True)
class StateMarks:
    """How the states of surface look in pictures.

    Attributes
    ----------
    colours : mapping
        Colour (0..1) of each state.
    hatched : int
        The state that is hatched in the colour of the unknown.
    dotted : int, optional
        The state that is dotted in the colour of what is measured.
    """

    colours: Mapping[int, tuple[float, ...]]
    hatched: int
    dotted: int | None = None


def state_pictures(
    scene: Scene,
    samples: SurfaceSamples,
    state: NDArray[np.int8],
    *,
    marks: StateMarks,
    title: str,
    n_threads: int | None = None,
    zones: Zones = EVERYWHERE,
) -> tuple[Picture, ...]:
    """The scene from two opposite sides, each point in the colour of its nearest sample's state.

    Parameters
    ----------
    scene : Scene
        What to draw; faces that look away from the eye are left out.
    samples : SurfaceSamples
        Of its surface.
    state : (n,) int8
        Of each sample.
    marks : StateMarks
        How each state looks.
    title : str
        Of the pictures.
    n_threads : int, optional
        Threads.
    zones : Zones
        What lies outside the region is drawn in one pale grey.
    """
    canvas = MeshDrawing(scene.mesh, caster=scene.ray_caster(n_threads))
    cameras = overview_cameras(scene.mesh.bounds())
    best = best_side(cameras, scene.mesh.corners)
    pictures = []
    for side, number in (("one side", best), ("the other side", best + len(cameras) // 2)):
        camera = cameras[number % len(cameras)]
        layer = canvas.look(camera, camera.shape(_WIDTH))
        hit, shade = layer.hit, canvas.shade(layer)
        found = np.full(hit.shape, -1, np.int64)
        found[hit] = state[nearest_samples(samples, layer.points[hit], layer.face[hit])]
        found[hit] = np.where(zones.of_interest(layer.points[hit], _AT_FACES_M), found[hit], _OUTSIDE)
        image = np.zeros((*hit.shape, 4))
        for value, colour in {**marks.colours, _OUTSIDE: _PALE}.items():
            here = found == value
            image[here, :3] = np.minimum(1.15 * np.array(colour) * shade[here, None], 1.0)
            image[here, 3] = 1.0
        if marks.dotted is not None:
            image = mark_modelled(image, found == marks.dotted, shade)
        image = blend(mark_unknown(image, found == marks.hatched), found == marks.hatched)
        pictures.append(picture_of(image, f"{title}: from {side}."))
    return tuple(pictures)
