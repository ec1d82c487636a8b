# SPDX-License-Identifier: MIT
"""A wall with a board before it, and completions of it whose scores are known."""

from functools import cache

import numpy as np

from benchmarks.metrics.inferred import Hypothesis, mesh_of_cells
from benchmarks.metrics.truth import TrueCells, TrueModel, look, true_charts
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor
from scenes.checks import BoolArray, FloatArray
from scenes.pose import Pose
from scenes.scan.range_image import RangeImage
from scenes.world.builtin import Finish, SceneBuilder
from scenes.world.scene import Scene

GREY = Finish((0.5, 0.5, 0.5))
WALL_Y, BOARD_Y, EYE = 2.0, 1.0, np.zeros(3)
CAMERA = PinholeSensor(fov_deg=60, width=240, height=240)


def wall_scene(hole: tuple[float, float, float, float] | None = None) -> Scene:
    """A wall of 4 x 4 m that fills the view, 2 m ahead, behind a board of 0.4 x 0.3 m at 1 m.

    The board's shadow on the wall is x -0.4..0.4, z -0.3..0.3: 0.48 m2. `hole` is cut into the wall, (x, z)
    of two corners.
    """
    build = SceneBuilder("wall", "object")
    holes = [] if hole is None else [(hole[0] + 2, hole[1] + 2, hole[2] + 2, hole[3] + 2)]
    build.add_panel("wall", (-2, WALL_Y, -2), (4, 0, 0), (0, 0, 4), GREY, holes)
    build.add_rectangle("board", (-0.2, BOARD_Y, -0.15), (0.4, 0, 0), (0, 0, 0.3), GREY)
    if hole is not None:
        build.add_rectangle("outside", (-4, 3, -4), (8, 0, 0), (0, 0, 8), GREY)
    return build.finish()


class Wall:
    """The wall as model, scan and cells; completions of its shadow."""

    def __init__(self, hole: tuple[float, float, float, float] | None = None) -> None:
        self.scene = wall_scene(hole)
        scored = tuple(name != "outside" for name in self.scene.surface_names)
        self.model = TrueModel(self.scene.mesh, self.scene.surfaces, scored, self.scene.openings)
        self.scan: RangeImage = scan_scene(self.scene, Pose.looking_at(EYE, (0, 1, 0)), CAMERA)
        self.cells: tuple[TrueCells, ...] = look(self.model, true_charts(self.model), [self.scan])

    @property
    def wall(self) -> TrueCells:
        return self.cells[0]

    def rectangle(
        self,
        low: tuple[float, float] = (-0.4, -0.3),
        high: tuple[float, float] = (0.4, 0.3),
        *,
        offset: float = 0.0,
        tilt: float = 0.0,
        sd: float = 0.01,
        confidence: float = 0.9,
    ) -> Hypothesis:
        """An inferred rectangle of the wall, moved by `offset` towards the sensor and tilted about x."""
        corners = np.array(
            [[low[0], 0, low[1]], [high[0], 0, low[1]], [high[0], 0, high[1]], [low[0], 0, high[1]]]
        )
        turn = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])
        vertices = corners @ turn.T + [0, WALL_Y - offset, 0]
        return hypothesis(vertices, np.array([[0, 1, 2], [0, 2, 3]]), sd=sd, confidence=confidence)

    def of_cells(self, filled: BoolArray, confidence: float = 0.9) -> Hypothesis:
        """Cells of the wall's chart as inferred area."""
        return hypothesis(*mesh_of_cells(self.wall.chart.grid, filled), confidence=confidence)


def hypothesis(
    vertices: FloatArray,
    faces: np.ndarray,
    *,
    sd: float = 0.01,
    confidence: float = 0.9,
    true_surface: int = 0,
) -> Hypothesis:
    n = len(faces)
    return Hypothesis(
        vertices,
        faces.astype(np.int32),
        np.zeros(n, np.int32),
        np.full(n, sd),
        np.full(n, confidence),
        np.array([true_surface], np.int32),
    )


@cache
def plain_wall() -> Wall:
    return Wall()


@cache
def wall_with_window() -> Wall:
    """A window x 0.2..0.8, z -0.1..0.5, of which the board hides the lower left part."""
    return Wall((0.2, -0.1, 0.8, 0.5))
