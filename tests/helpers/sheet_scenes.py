# SPDX-License-Identifier: MIT
"""Scenes of flat sheets across the x axis, for tests whose answer is a closed form."""

import numpy as np

from scenes.mesh.labelled_mesh import Appearance, LabelledMesh
from scenes.pose import Pose
from scenes.world.scene import Scene

EAST = Pose.looking_at((0, 0, 0), (1, 0, 0))  # sensor x is world -y, sensor y is world -z


def sheets(*extents: tuple[float, float, float, float, float], colours: tuple[float, ...] = ()) -> Scene:
    """Upright rectangles (x, sensor x from, to, sensor y from, to), one surface each, grey values 0..1."""
    vertices, faces, labels = [], [], []
    for number, (depth, left, right, top, bottom) in enumerate(extents):
        corners = [(left, top), (right, top), (right, bottom), (left, bottom)]
        vertices += [(depth, -x, -y) for x, y in corners]
        faces += [[4 * number, 4 * number + 1, 4 * number + 2], [4 * number, 4 * number + 2, 4 * number + 3]]
        labels += [number, number]
    look = None
    if colours:
        grey = np.repeat(np.array(colours, np.float32), 2)
        look = Appearance(np.broadcast_to(grey[:, None, None], (len(faces), 3, 3)).copy())
    mesh = LabelledMesh(np.array(vertices, float), np.array(faces), np.array(labels), look)
    names = tuple(f"sheet {k}" for k in range(len(extents)))
    return Scene(mesh, (None,) * len(extents), names, "sheets", "object")


def before_wall(near: float = 2.0, far: float = 3.0, half: float = 0.3) -> Scene:
    """A square of side 2 `half` before a large wall, depths in metres."""
    return sheets((near, -half, half, -half, half), (far, -20, 20, -20, 20))
