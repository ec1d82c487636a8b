# SPDX-License-Identifier: MIT
"""Silence: shadows of the projector and enclosed holes are filled; panes, doorways and frames are not."""

import numpy as np
import pytest

from completion import CompletionOptions, complete
from completion.evidence.evidence import Label
from completion.extension.confidence import silent_parts, trust
from completion.extension.patch import Patch, Provenance
from completion.result.record import completion_record
from scenes.checks import BoolArray, FloatArray, InputError
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection
from scenes.scan.range_image import RangeImage

CAMERA = PinholeProjection.from_fov(240, 180, 60)
WALL_M, BOX_M, SIGMA_M = 2.0, 1.2, 0.001
MIDDLE = np.s_[60:120, 100:140]


def scan_of(depth: FloatArray) -> RangeImage:
    noise = np.random.default_rng(0).normal(0, SIGMA_M, depth.shape)
    return RangeImage((depth + noise) / CAMERA.directions()[..., 2], CAMERA, Pose.identity(), sigma_m=SIGMA_M)


def wall() -> FloatArray:
    return np.full(CAMERA.shape, WALL_M)


def wall_patch(depth: FloatArray, **options) -> Patch:
    found = complete(scan_of(depth), CompletionOptions(texture=False, **options))
    assert found.free_space_violation_m2 == 0
    return max(found.patches, key=lambda patch: patch.observed_m2)


def filled(patch: Patch, silent: BoolArray) -> float:
    """Share of pixels without return behind which the wall is inferred, for that reason."""
    ray = CAMERA.directions()[silent]
    uv = patch.grid.surface.to_uv(WALL_M / ray[:, 2:] * ray)
    column, row = np.floor((uv - patch.grid.corner) / patch.grid.cell).astype(np.int64).T
    rows, columns = patch.grid.shape
    inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
    why = patch.provenance[row[inside], column[inside]]
    return float(np.count_nonzero(why == Provenance.NO_RETURN)) / np.count_nonzero(silent)


def box_with_moat(width: int, left: bool = True) -> tuple[FloatArray, BoolArray]:
    depth, moat = wall(), np.zeros(CAMERA.shape, dtype=np.bool_)
    depth[MIDDLE] = BOX_M
    moat[60:120, (100 - width if left else 140) : (100 if left else 140 + width)] = True
    depth[moat] = np.nan
    return depth, moat


def parallax_px(baseline_m: float) -> int:
    return round(CAMERA.fx * baseline_m * (1 / BOX_M - 1 / WALL_M))


@pytest.mark.parametrize("projector_m", [None, 0.1])
def test_the_moat_beside_a_box_is_filled_as_no_return(projector_m):
    depth, moat = box_with_moat(parallax_px(0.1))
    patch = wall_patch(depth, projector_m=projector_m)
    assert filled(patch, moat) > 0.95
    unlit = patch.evidence.labels == Label.UNLIT
    assert unlit.any()
    assert (patch.provenance[unlit & patch.hypothesised] == Provenance.NO_RETURN).all()
    assert patch.confidence[unlit & patch.hypothesised].max() < 1


def test_a_moat_on_the_lit_side_is_only_an_enclosed_hole():
    depth, moat = box_with_moat(parallax_px(0.1), left=False)
    patch = wall_patch(depth, projector_m=0.1)
    assert not (patch.evidence.labels == Label.UNLIT).any()
    assert filled(patch, moat) > 0.9


def test_without_a_projector_there_is_no_shadow():
    depth, _ = box_with_moat(parallax_px(0.1))
    assert not (wall_patch(depth, projector_m=0.0).evidence.labels == Label.UNLIT).any()


def hole(half: int) -> tuple[FloatArray, BoolArray]:
    depth, silent = wall(), np.zeros(CAMERA.shape, dtype=np.bool_)
    silent[90 - half : 90 + half, 120 - half : 120 + half] = True
    depth[silent] = np.nan
    return depth, silent


def test_the_wider_an_enclosed_hole_the_less_it_is_believed():
    confidence = []
    for half in (3, 8, 13):
        depth, silent = hole(half)
        patch = wall_patch(depth)
        assert filled(patch, silent) > 0.9
        confidence.append(patch.confidence[patch.provenance == Provenance.NO_RETURN].min())
    assert confidence[0] > 0.9 > confidence[1] > confidence[2] > 0.5


def test_a_hole_as_wide_as_a_window_stays_open():
    depth, silent = hole(55)  # more than a metre
    assert filled(wall_patch(depth), silent) < 0.05


def test_what_is_dark_at_the_edge_of_the_image_stays_open():
    depth, silent = wall(), np.zeros(CAMERA.shape, dtype=np.bool_)
    silent[:, :12] = True
    depth[silent] = np.nan
    assert filled(wall_patch(depth), silent) == 0


def test_a_hole_with_free_space_on_one_side_stays_open():
    depth, silent = hole(8)
    depth[82:98, 128:150] = 4.0  # seen through
    assert filled(wall_patch(depth), silent) < 0.1


def test_parts_are_cut_by_width_and_held_against_their_rim():
    silent = np.zeros((60, 60), dtype=np.bool_)
    silent[10:40, 10:40] = True
    silent[24:27, 40:60] = True  # a mouth, out to the border
    parts = list(silent_parts(silent, ~silent, np.ones((60, 60), dtype=np.bool_), 0.01, wraps=False))
    cells = np.concatenate([part.cells for part in parts])
    assert len(np.unique(cells)) == len(cells) == silent.sum()
    assert [part.half_width_m for part in parts] == sorted((p.half_width_m for p in parts), reverse=True)
    assert parts[0].enclosed > 0.9
    assert parts[0].half_width_m == pytest.approx(0.15, rel=0.5)
    mouth = next(part for part in parts if 25 * 60 + 55 in part.cells)
    assert 0.5 < mouth.enclosed < 1


@pytest.mark.parametrize("wraps", [False, True])
def test_parts_are_the_same_wherever_in_the_chart_they_lie(wraps):
    rng = np.random.default_rng(2)
    silent = np.pad(rng.random((30, 40)) < 0.8, 1)
    solid = ~silent & (rng.random(silent.shape) < 0.7)
    within = rng.random(silent.shape) < 0.9
    own = list(silent_parts(silent, solid, within, 0.01, wraps=wraps))
    around = [np.pad(one, ((7, 3), (5, 11))) for one in (silent, solid, within)]
    row, column = np.divmod(np.arange(silent.size), silent.shape[1])
    there = (row + 7) * around[0].shape[1] + column + 5
    moved = list(silent_parts(*around, 0.01, wraps=wraps))
    assert len(own) == len(moved) > 10
    for one, other in zip(own, moved, strict=True):
        np.testing.assert_array_equal(there[one.cells], other.cells)
        assert (one.half_width_m, one.enclosed) == (other.half_width_m, other.enclosed)


def test_what_is_not_silent_is_trusted():
    depth, _ = hole(8)
    patch = wall_patch(depth)
    hidden = patch.shadows.region >= 0
    trusted = trust(
        patch.grid, patch.evidence, hidden, patch.hypothesised, within=patch.is_within, is_wall=True
    )
    silent = hidden & np.isin(patch.evidence.labels, (Label.NO_RETURN, Label.UNLIT))
    assert (trusted[~silent] == 1).all()
    assert (trusted[silent] < 1).all()


def test_the_record_tells_where_the_projector_stands():
    depth, _ = box_with_moat(parallax_px(0.1))
    for projector_m in (0.1, -0.2, 0.0):
        found = complete(scan_of(depth), CompletionOptions(texture=False, projector_m=projector_m))
        (told,) = completion_record(found)["projector"]
        assert told["right_m"] - told["left_m"] == projector_m


def test_a_projector_metres_away_is_refused():
    with pytest.raises(InputError, match="projector_m"):
        CompletionOptions(projector_m=5.0)
