# SPDX-License-Identifier: MIT
"""Meshing: cells and pixels as triangles, held against polygons cut one by one and plain formulas."""

import numpy as np
import pytest
import shapely

from completion.boundary.edges import ChartLine, Circle
from completion.boundary.meshing import Trim, mesh_cells
from completion.boundary.range_mesh import mesh_range_image
from completion.evidence.chart_grid import ChartGrid
from scenes.mesh.labelled_mesh import triangle_areas
from scenes.surfaces.catalogue import Cylinder, Plane
from scenes.surfaces.surface import cross

FLOOR = Plane((0.3, -0.2, 0.0), (0, 0, 1), (1, 0, 0))
CUTS = (Plane((0.41, 0, 0), (1, 0.3, 0.2)), Plane((0, 1.07, 0), (-0.5, -1, 0)))
BEYOND = 10.0  # metres: what a half-plane is drawn to


def random_cells(seed: int, shape: tuple[int, int] = (24, 31)) -> tuple[ChartGrid, np.ndarray]:
    """Cells of 5 cm on the floor, three in four of them."""
    grid = ChartGrid.over(FLOOR, np.zeros(2), np.array(shape[::-1]) * 0.05, 0.05, full_turn=False)
    return grid, np.random.default_rng(seed).random(shape) < 0.75


def random_trims(seed: int, shape: tuple[int, int]) -> tuple[Trim, ...]:
    """A line and a circle, each through some of the cells."""
    rng = np.random.default_rng(seed)
    line = ChartLine(np.array([0.7, 0.6]), np.array([0.6, 0.8]))
    half = rng.random((2, *shape)) < 0.5
    return Trim(line, 1.0, half[0]), Trim(Circle(np.array([0.8, 0.7]), 0.5), -1.0, half[1])


def kept_area(grid: ChartGrid, cells: np.ndarray, trims: tuple[Trim, ...]) -> float:
    """Area of the cells on the inner side of cuts and trims, each cut by itself; circles by their chords."""
    area = 0.0
    for row, column in np.argwhere(cells):
        cell = shapely.box(*grid.uv_of(row, column), *grid.uv_of(row + 1, column + 1))
        for cut in CUTS:
            cell = cell.intersection(half_plane(cut))
        for trim in trims:
            if trim.cells[row, column] and isinstance(trim.curve, ChartLine):
                along, across = BEYOND * trim.curve.direction, BEYOND * trim.curve.normal
                ends = trim.curve.point + along, trim.curve.point - along
                cell = cell.intersection(shapely.Polygon([*ends, ends[1] + across, ends[0] + across]))
            elif trim.cells[row, column]:
                cell = cell.difference(shapely.Point(trim.curve.centre).buffer(trim.curve.radius, 256))
        area += cell.area
    return area


def half_plane(cut: Plane) -> shapely.Polygon:
    """The side of a cut that the floor keeps."""
    gradient = cut.normal_direction[:2]
    low = -cut.distance(FLOOR.from_uv(np.zeros((1, 2))))[0] / np.linalg.norm(gradient)
    normal = gradient / np.linalg.norm(gradient)
    along = np.array([-normal[1], normal[0]]) * BEYOND
    ends = low * normal + along, low * normal - along
    return shapely.Polygon([*ends, ends[1] + BEYOND * normal, ends[0] + BEYOND * normal])


@pytest.mark.parametrize("merged", [True, False])
@pytest.mark.parametrize("seed", [0, 1])
def test_cells_lose_what_lies_beyond_cuts_and_trims(seed: int, merged: bool) -> None:
    """The area is that of cells cut one by one; a chord of a circle stands for its arc."""
    grid, cells = random_cells(seed)
    trims = random_trims(seed, grid.shape)
    for some, slack in (((), 1e-9), (trims[:1], 1e-9), (trims, 2e-3)):
        mesh = mesh_cells(grid, cells, CUTS, some, merged=merged)
        area = float(triangle_areas(mesh.vertices[mesh.faces]).sum())
        assert area == pytest.approx(kept_area(grid, cells, some), rel=slack)
    assert cells.ravel()[mesh.face_cell].all()
    a, b, c = mesh.vertices[mesh.faces].transpose(1, 0, 2)
    assert (np.cross(b - a, c - a)[:, 2] >= 0).all()  # counter-clockwise from the normal's side


def test_rectangles_cover_the_cells_once() -> None:
    """Merged or not, the same cells are covered; merged by fewer faces, on a cylinder along its axis only."""
    grid, cells = random_cells(3)
    around = ChartGrid.over(
        Cylinder((0, 0, 0), (0, 0, 1), 0.3), np.zeros(2), np.array([1.55, 1.2]), 0.05, full_turn=False
    )
    for over, rows_join in ((grid, False), (around, True)):
        single = mesh_cells(over, cells, (), merged=False)
        joined = mesh_cells(over, cells, (), merged=True)
        assert len(single.faces) == 2 * cells.sum() > len(joined.faces)
        covered = np.zeros(cells.shape, dtype=int)
        for face in joined.cells[joined.faces]:
            low, high = face.min(axis=0).astype(int), face.max(axis=0).astype(int)
            covered[low[0] : high[0], low[1] : high[1]] += 1
            assert not rows_join or high[1] - low[1] == 1
        np.testing.assert_array_equal(covered, 2 * cells)


def test_nothing_left_is_an_empty_mesh() -> None:
    """No cells, or none this side of the cuts."""
    grid, cells = random_cells(0)
    away = Plane((100.0, 0, 0), (1, 0, 0))
    for chosen, cuts in ((np.zeros_like(cells), CUTS), (np.zeros_like(cells), ()), (cells, (away,))):
        assert not len(mesh_cells(grid, chosen, cuts, merged=True).faces)


@pytest.mark.parametrize("is_mirrored", [False, True])
def test_pixels_are_joined_as_plain_formulas_say(is_mirrored: bool) -> None:
    """Neighbours within the longest edge, counter-clockwise from the sensor however the columns run."""
    rng = np.random.default_rng(0)
    row, column = np.mgrid[:20, :30] * 0.1
    points = np.stack([column, row, 2 + rng.normal(0, 0.04, row.shape)], axis=-1)
    points = points[:, ::-1] if is_mirrored else points
    members, step = rng.random(row.shape) < 0.9, rng.uniform(0.1, 0.3, row.shape)
    points[~members] = np.nan
    origin = np.zeros(3)
    found = {tuple(face) for face in mesh_range_image(points, members, step, origin).tolist()}
    flat, expected, volumes = points.reshape(-1, 3), [], []
    for i in range(19):
        for j in range(29):
            a, b, c, d = 30 * i + j, 30 * i + j + 1, 30 * i + j + 31, 30 * i + j + 30
            for face in ((a, d, c), (a, c, b)):
                corner = flat[list(face)]
                longest = np.linalg.norm(corner - np.roll(corner, 1, axis=0), axis=1).max()
                if longest <= step.ravel()[list(face)].min():
                    expected.append(face)
                    volumes.append(np.linalg.det(origin - corner))
    turned = np.median(volumes) < 0
    assert found == {(a, c, b) if turned else (a, b, c) for a, b, c in expected}


def test_pixels_without_neighbours_join_nothing() -> None:
    """A row, a column and no pixel at all."""
    for shape in ((1, 5), (5, 1), (0, 0)):
        members = np.ones(shape, dtype=np.bool_)
        faces = mesh_range_image(np.zeros((*shape, 3)), members, np.ones(shape), np.zeros(3))
        assert faces.shape == (0, 3)
        assert faces.dtype == np.int32


def test_cross_is_numpys_to_the_last_bit() -> None:
    """The vector product, term by term."""
    for one, other in np.random.default_rng(0).normal(size=(50, 2, 3)):
        np.testing.assert_array_equal(cross(one, other), np.cross(one, other))
