# SPDX-License-Identifier: MIT
"""Claims of several planes for one place: the most probable has it, and what is not in question stays."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from completion.extension.claims import overlap_m2, settle_claims
from completion.extension.patch import Patch
from scenes.surfaces.catalogue import Plane
from tests.completion.extension.test_patch import extended

FLATNESS_M = 0.003


@pytest.fixture(scope="module")
def wall() -> Patch:
    """A wall with a strip that something hides."""
    return extended("...##... ...##... ...##...")


def moved(patch: Patch, *, tilt_deg=0.0, behind_m=0.0, flipped=False, factor=0.9) -> Patch:
    """The same patch on another plane, with lower confidence."""
    plane, middle = patch.grid.surface, patch.grid.centres()[patch.hypothesised.ravel()].mean(axis=0)
    turn = Rotation.from_rotvec(np.radians(tilt_deg) * np.array(plane.v_direction))
    point = middle + turn.apply(plane.point - middle) - behind_m * plane.normal_direction
    normal = turn.apply(np.array(plane.normal_direction)) * (-1 if flipped else 1)
    other = Plane(point, normal, turn.apply(np.array(plane.u_direction)))
    return replace(patch, grid=replace(patch.grid, surface=other), confidence=patch.confidence * factor)


@pytest.mark.parametrize("given", [{}, {"tilt_deg": 2.0}, {"behind_m": 0.01}])
def test_the_less_probable_of_two_claims_goes(wall, given):
    other = moved(wall, **given)
    assert overlap_m2([wall, other], FLATNESS_M) > 0.9 * wall.hypothesised_m2
    for patches in ([wall, other], [other, wall]):
        settled = settle_claims(patches, FLATNESS_M)
        assert overlap_m2(settled, FLATNESS_M) == 0
        kept, lost = settled if patches[0] is wall else settled[::-1]
        np.testing.assert_array_equal(kept.hypothesised, wall.hypothesised)
        assert lost.hypothesised_m2 < 0.1 * wall.hypothesised_m2
        assert set(np.unique(lost.provenance[~lost.hypothesised & ~lost.observed])) <= {-1}


@pytest.mark.parametrize("given", [{"behind_m": 0.5}, {"tilt_deg": 40.0}, {"flipped": True}])
def test_planes_that_are_not_one_keep_theirs(wall, given):
    patches = [wall, moved(wall, **given)]
    for before, after in zip(patches, settle_claims(patches, FLATNESS_M), strict=True):
        assert after is before


def test_of_equal_claims_the_first_surface_keeps_its_own(wall):
    first, second = settle_claims([wall, moved(wall, factor=1.0)], FLATNESS_M)
    assert first is wall
    assert not second.hypothesised.any()


def test_what_is_cut_off_from_the_measured_part_goes_too(wall):
    rows, columns = np.nonzero(wall.hypothesised)
    middle = (columns == columns.min()) | (columns == columns.max())
    sides = np.zeros(wall.grid.shape, dtype=np.bool_)
    sides[rows[middle], columns[middle]] = True
    rival = replace(moved(wall, factor=1.0), hypothesised=sides, confidence=np.full(sides.shape, 1.0))
    _, lost = settle_claims([rival, wall], FLATNESS_M)
    assert not lost.hypothesised.any()


def test_nothing_changes_without_planes_that_claim():
    assert settle_claims([], FLATNESS_M) == []
    assert overlap_m2([], FLATNESS_M) == 0
