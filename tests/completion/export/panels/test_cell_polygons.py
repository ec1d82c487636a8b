# SPDX-License-Identifier: MIT
"""Cell polygons: what cells and their pieces cover, held against shapely's union of them one by one."""

import numpy as np
import pytest
import shapely

from completion.boundary.meshing import mesh_cells
from completion.evidence.chart_grid import ChartGrid
from completion.export.panels.sheet import polygons_of_cells
from scenes.surfaces.catalogue import Plane

NONE = np.zeros((0, 3, 2))
ROUNDING = 1e-4  # cells


def boxes(cells: np.ndarray) -> list[shapely.Polygon]:
    """Each cell as a square, x its column."""
    return [shapely.box(column, row, column + 1, row + 1) for row, column in np.argwhere(cells)]


@pytest.mark.parametrize("share", [0.2, 0.5, 0.8])
def test_cells_are_the_union_of_their_squares(share: float) -> None:
    """Parts that touch at a corner stay parts, and so do holes; islands in holes are parts."""
    rng = np.random.default_rng(0)
    for shape in ((1, 1), (1, 9), (9, 1), (25, 40)):
        cells = rng.random(shape) < share
        found, expected = polygons_of_cells(cells, NONE), shapely.union_all(boxes(cells))
        assert found.is_valid
        assert found.equals(expected) or not cells.any()
        assert found.area == cells.sum()


def test_an_island_in_a_hole_and_rings_that_touch() -> None:
    """A frame around an island; two holes that share a corner, of each other and of the outline."""
    frame = np.pad(np.pad(np.ones((1, 1), np.bool_), 1), 1, constant_values=True)
    assert [len(part.interiors) for part in polygons_of_cells(frame, NONE).geoms] == [1, 0]
    pinched = np.ones((5, 5), np.bool_)
    pinched[1, 1] = pinched[2, 2] = pinched[3, 3] = pinched[4, 4] = False
    found = polygons_of_cells(pinched, NONE)
    assert found.is_valid
    assert found.equals(shapely.union_all(boxes(pinched)))


@pytest.mark.parametrize("slope", [0.0, 0.4, 1.0, -2.3])
def test_pieces_of_cells_are_joined_to_whole_ones(slope: float) -> None:
    """Cells of which a plane cuts a part, beside cells that it passes over, as measured ones are."""
    rng = np.random.default_rng(1)
    floor, shape = Plane((0, 0, 0), (0, 0, 1), (1, 0, 0)), (30, 30)
    grid = ChartGrid.over(floor, np.zeros(2), np.full(2, 30.0), 1.0, full_turn=False)
    cells, measured = rng.random(shape) < 0.8, rng.random(shape) < 0.3
    cut = Plane((14.3, 15.2, 0), (1, slope, 0))
    mesh = mesh_cells(grid, cells & ~measured, (cut,), merged=False)
    pieces = mesh.cells[mesh.faces]
    found = polygons_of_cells(measured, pieces)
    each = [*boxes(measured), *shapely.polygons(pieces[..., ::-1])]
    expected = shapely.union_all(shapely.set_precision(each, ROUNDING), grid_size=ROUNDING)
    assert found.is_valid
    assert len(found.geoms) == len(shapely.get_parts(expected))
    assert found.symmetric_difference(expected).area <= ROUNDING * expected.length


def test_nothing_is_no_polygon() -> None:
    """No cell at all."""
    assert polygons_of_cells(np.zeros((3, 4), np.bool_), NONE).is_empty
