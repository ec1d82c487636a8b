# SPDX-License-Identifier: MIT
"""Strata of scenes in which it is plain what hides what."""

from collections.abc import Callable

import numpy as np
import pytest

from benchmarks.metrics.truth import (
    Sight,
    Stratum,
    TrueCells,
    TrueModel,
    look,
    pieces,
    strata_of,
    true_charts,
)
from nbv.scanning.scanner import scan_scene
from scenes.pose import Pose
from scenes.scan.range_image import RangeImage
from scenes.world.builtin import SceneBuilder
from tests.helpers.evaluation_examples import CAMERA, EYE, GREY


def seen(furnish: Callable[[SceneBuilder], None], *eyes: tuple[float, float, float]) -> dict[str, TrueCells]:
    """A wall of 1.6 x 1.6 m, 2 m ahead, wholly in view, with what `furnish` puts before it."""
    build = SceneBuilder("wall", "object")
    build.add_rectangle("wall", (-0.8, 2, -0.8), (1.6, 0, 0), (0, 0, 1.6), GREY)
    furnish(build)
    scene = build.finish()
    model = TrueModel(scene.mesh, scene.surfaces, (True,) * len(scene.surfaces))
    scans: list[RangeImage] = [
        scan_scene(scene, Pose.looking_at(eye, (0, 2, 0)), CAMERA) for eye in eyes or (tuple(EYE),)
    ]
    cells = look(model, true_charts(model), scans)
    return {scene.surface_names[cell.chart.surface]: cell for cell in cells}


def kinds(cell: TrueCells) -> set[int]:
    strata = strata_of(cell)
    return set(np.unique(strata[strata >= 0]).tolist())


@pytest.mark.parametrize(
    ("low", "high", "stratum"),
    [
        ((-0.1, -0.1), (0.1, 0.1), Stratum.INTERIOR),
        ((-0.1, -1.0), (0.1, 1.0), Stratum.BREAKING),  # from end to end: the wall falls apart
        ((-0.1, -1.0), (0.1, 0.1), Stratum.BOUNDARY),
        ((0.2, 0.2), (1.0, 1.0), Stratum.BOUNDARY),  # a corner of the wall
    ],
)
def test_a_board_before_a_wall(low: tuple[float, float], high: tuple[float, float], stratum: Stratum) -> None:
    def board(build: SceneBuilder) -> None:
        size = np.subtract(high, low)
        build.add_rectangle("board", (low[0], 1, low[1]), (size[0], 0, 0), (0, 0, size[1]), GREY)

    assert kinds(seen(board)["wall"]) == {stratum}


def test_a_columns_back_is_hidden_by_itself_and_its_front_by_others() -> None:
    def column(build: SceneBuilder) -> None:
        build.add_cylinder("column", (0, 1.5, -0.6), (0, 0, 1.2), 0.2, GREY, caps=False)
        build.add_rectangle("board", (-0.4, 1, -0.1), (0.8, 0, 0), (0, 0, 0.2), GREY)

    cell = seen(column)["column"]
    strata = strata_of(cell)
    assert {Stratum.SELF, Stratum.BREAKING} <= set(np.unique(strata).tolist())
    # Seen from afar in front: cos(angle) > r / d on the visible side.
    arc = cell.chart.grid.centres()[..., 1].reshape(cell.chart.grid.shape)
    hidden_by_itself = strata == Stratum.SELF
    assert arc[hidden_by_itself].min() > 1.5 - 0.2 * 0.2 / 1.5 - 0.02
    share = hidden_by_itself.sum() / cell.chart.present.sum()
    assert share == pytest.approx(1 - np.arccos(0.2 / 1.5) / np.pi, abs=2 / 126)


def test_a_second_scan_reveals_what_the_first_misses() -> None:
    def board(build: SceneBuilder) -> None:
        build.add_rectangle("board", (-0.1, 1, -0.1), (0.2, 0, 0), (0, 0, 0.2), GREY)

    one, two = seen(board)["wall"], seen(board, (0, 0, 0), (0.6, 0, 0))["wall"]
    assert one.reachable.sum() > 1000
    assert two.reachable.sum() == 0
    assert (two.sight[one.reachable] == Sight.VISIBLE).all()


def test_what_no_pixels_are_on_is_not_reachable() -> None:
    def box(build: SceneBuilder) -> None:
        build.add_box("box", (-0.2, 1, -0.2), (0.2, 1.3, 0.2), GREY)

    cells = seen(box)
    assert cells["box north"].hidden.sum() > 100
    assert not cells["box north"].reachable.any()


def test_pieces_join_across_the_seam() -> None:
    mask = np.zeros((6, 9), dtype=np.bool_)
    mask[1, [0, 8]] = mask[4, 4] = mask[4, 8] = True
    assert pieces(mask, wraps=False).max() == 4
    joined = pieces(mask, wraps=True)
    assert len(np.unique(joined)) == 4  # none, and three pieces
    assert joined[1, 0] == joined[1, 8] != joined[4, 8]
    assert (joined[~mask] == 0).all()
