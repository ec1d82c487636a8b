# SPDX-License-Identifier: MIT
"""Patches as STEP: what a CAD kernel reads back is the patch."""

import numpy as np

from completion.fitting.patches.spline import SplinePatch
from tests.helpers.step_examples import needs_kernel, read_back

needs_kernel()

from completion.export.step.faces import is_valid  # noqa: E402
from completion.export.step.kernel import kernel, patch_step  # noqa: E402


def test_the_file_holds_the_patch(tmp_path) -> None:
    rng = np.random.default_rng(0)
    grid = np.stack(np.meshgrid(np.linspace(0, 0.1, 7), np.linspace(0, 0.2, 9), indexing="ij"), axis=-1)
    patch = SplinePatch(np.dstack([grid, 0.02 * rng.normal(size=(7, 9))]), (3, 5))
    data = patch_step(patch, "blend")
    shape, modules = read_back(data, tmp_path), kernel()
    walk = modules.TopExp.TopExp_Explorer(shape, modules.TopAbs.TopAbs_ShapeEnum.TopAbs_FACE)
    face = modules.TopoDS.TopoDS.Face(walk.Current())
    walk.Next()
    assert not walk.More()
    assert is_valid(face)
    surface = modules.BRep.BRep_Tool.Surface_s(face)
    uv = rng.uniform(0, 1, (200, 2))
    read = np.array([surface.Value(*(float(one) for one in row)).Coord() for row in uv])
    assert np.abs(read - 1000 * patch.at(uv)).max() < 1e-9  # mm
    assert data == patch_step(patch, "blend")
    assert b"B_SPLINE_SURFACE" in data
