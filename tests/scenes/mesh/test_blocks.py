# SPDX-License-Identifier: MIT
"""Tests of blocks of space: nothing is lost, surfaces stay whole, and files show the blocks as nodes."""

import io

import numpy as np
import pytest
import trimesh

from scenes.io.meshes.glb_writer import glb_of
from scenes.mesh.blocks import BoxLattice, in_blocks
from scenes.mesh.labelled_mesh import triangle_areas
from scenes.mesh.mesh_parts import MeshPart


def loose(rng, n, size):
    """Small triangles anywhere in a box, which belong to no surface."""
    middles = rng.uniform(0, 1, (n, 1, 3)) * np.array(size)
    corners = middles + rng.normal(scale=0.02, size=(n, 3, 3))
    colour = rng.integers(0, 255, (3 * n, 3), dtype=np.uint8)
    return MeshPart("observed remainder", corners.reshape(-1, 3), np.arange(3 * n).reshape(-1, 3), 0, colour)


def square(name, number, low, side):
    corners = np.array(low) + side * np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]])
    return MeshPart(name, corners, np.array([[0, 1, 2], [0, 2, 3]]), number)


def areas(parts):
    return [triangle_areas(part.vertices[part.faces]).sum() for part in parts]


@pytest.mark.parametrize("seed", range(3))
def test_every_triangle_is_in_one_block_with_its_colours(seed):
    rng = np.random.default_rng(seed)
    whole = loose(rng, 500, (60, 25, 9))
    parts = in_blocks([whole])
    assert sum(areas(parts)) == pytest.approx(areas([whole])[0])
    assert len({part.name for part in parts}) == len(parts) > 8
    blocks = BoxLattice.over([whole])
    assert blocks.counts.tolist() in ([6, 2, 1], [6, 3, 1])
    colour_of = {tuple(at): tuple(c) for at, c in zip(whole.vertices, whole.colour, strict=True)}
    for part in parts:
        numbers = blocks.numbers(part.vertices[part.faces].mean(axis=1))
        assert {f"block {' '.join(map(str, n))}" for n in numbers.tolist()} == {part.block}
        assert [colour_of[tuple(at)] for at in part.vertices] == [tuple(c) for c in part.colour]


def test_surfaces_stay_whole_and_wide_ones_are_in_no_block():
    rng = np.random.default_rng(0)
    table, floor = (
        square("observed 1 plane", 1, (31, 3, 1), 1.0),
        square("observed 2 plane", 2, (0, 0, 0), 40),
    )
    found = {part.name: part for part in in_blocks([table, floor, loose(rng, 50, (40, 40, 3))])}
    assert found["observed 1 plane"].block == "block 4 1 1"
    assert found["observed 2 plane"].block == ""
    assert found["observed 2 plane"].vertices is floor.vertices


def test_small_models_have_no_blocks():
    parts = [loose(np.random.default_rng(0), 50, (14, 5, 3)), square("observed 1 plane", 1, (0, 0, 0), 1.0)]
    assert [part.block for part in in_blocks(parts)] == ["", ""]
    assert in_blocks(parts)[0] is parts[0]
    assert in_blocks([]) == []


def test_blocks_are_nodes_of_a_glb():
    parts = in_blocks(
        [square("observed 1 plane", 1, (31, 3, 1), 1.0), loose(np.random.default_rng(1), 90, (40, 40, 3))]
    )
    scene = trimesh.load(io.BytesIO(glb_of(parts)), file_type="glb")
    above = scene.graph.transforms.parents
    assert above["observed 1 plane"] == "block 4 1 1"
    assert {above[part.name] for part in parts} == {part.block for part in parts}
    assert sum(mesh.area for mesh in scene.geometry.values()) == pytest.approx(sum(areas(parts)), rel=1e-4)
    moved = scene.to_mesh().bounds  # y up: x, z, -y
    low = np.min([part.vertices.min(axis=0) for part in parts], axis=0)
    assert moved[0][:2] == pytest.approx([low[0], low[2]], abs=1e-4)
