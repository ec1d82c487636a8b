# SPDX-License-Identifier: MIT
"""Platforms: large level surface that is no place to stand is told, with its area; furniture is not."""

import pytest

from nbv.visibility.site import find_site
from tests.helpers.buildings import Building, house

WIDE = (3.0, 2.5)


def hall(*, stairs=False, roof=True, height=2.8):
    """A hall of 9 by 7 by 6 m with a suspended slab of 3 by 2.5 m along a wall, and perhaps stairs to it."""
    made = Building()
    made.box("slab", (0, 0, -0.2), (9, 7, 0))
    if roof:
        made.box("roof", (0, 0, 6), (9, 7, 6.2))
    for axis, at, end in ((1, 0.1, 7), (1, 8.9, 7), (0, 0.1, 9), (0, 6.9, 9)):
        made.wall(axis, at, 0, end, 0, 6, 0.2)
    made.box("deck", (3.0, 0.2, height - 0.2), (3.0 + WIDE[0], 0.2 + WIDE[1], height))
    if stairs:
        n = 14
        for k in range(n):
            x = 6.0 + (n - 1 - k) * 0.19
            made.box("tread", (x, 0.2, 0), (x + 0.19, 1.4, (k + 1) * height / (n + 1)))
    return made


def test_a_suspended_slab_without_stairs_is_told_with_its_area_and_height():
    site = find_site(hall().scene())
    (platform,) = site.rooms.floors.platforms
    assert platform.floor_m2 == pytest.approx(WIDE[0] * WIDE[1], rel=0.05)
    assert platform.level_m == pytest.approx(2.8)
    assert platform.drop_m == pytest.approx(2.8)
    x, y, z = platform.place
    assert 3 < x < 6
    assert 0.2 < y < 2.7
    assert z == pytest.approx(2.8)
    (said,) = [warning for warning in site.warnings if "platform" in warning]
    assert said.startswith(
        f"1 platform left out as places to stand, {platform.floor_m2:.1f} m2 at 2.80 m height"
    )
    assert site.platform_entries()[0]["floor_m2"] == platform.floor_m2


def test_with_stairs_it_is_floor():
    site = find_site(hall(stairs=True).scene())
    assert not site.rooms.floors.platforms
    assert not any("platform" in warning for warning in site.warnings)
    assert (abs(site.positions[:, 2] - 2.8 - 0.4) < 1e-6).any()


@pytest.mark.long
def test_roofs_furniture_and_what_is_low_are_no_platforms():
    assert not find_site(hall(height=1.1).scene()).rooms.floors.platforms
    for seed in (11, 33):
        assert not find_site(house(seed, storeys=1 + seed // 33).scene()).rooms.floors.platforms
