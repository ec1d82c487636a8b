# SPDX-License-Identifier: MIT
"""Desks before a simulated Kinect: what the projector does not light is filled, panes are not."""

import numpy as np
import pytest

from benchmarks.cases.desks import desk_case
from benchmarks.suites.silence import moats, most_likely, parts_of
from completion.extension.confidence import TRUST


def test_the_same_seed_gives_the_same_desk():
    assert desk_case(3).fingerprint == desk_case(3).fingerprint != desk_case(4).fingerprint


@pytest.mark.long
def test_moats_of_a_held_out_desk_are_filled():
    found = moats(2103)
    assert found.shadow > 500
    assert found.shadow_filled >= 0.95 * found.shadow
    area = float(found.silent_m2.sum())
    assert float(found.right_m2.sum()) >= 0.98 * area > 0


@pytest.mark.long
def test_a_wide_pane_or_panel_stays_open():
    """Beside the mat on it, this desk has a black pane over half a metre wide behind it."""
    found = moats(2105)
    assert found.dark - found.dark_filled > 100 * 100
    assert float(found.silent_m2.sum()) < 0.3


@pytest.mark.long
def test_constants_come_from_the_parts_of_desks():
    parts = parts_of(1003)
    assert {part.is_unlit for part in parts} == {True, False}
    found = most_likely(parts)
    assert found.shape == TRUST.shape
    assert ((found[..., 0] > 0) & (found[..., 0] < 1) & (found[..., 1] > 0)).all()
    wrong = [part._replace(right=0.0) for part in parts]
    widths = np.array([part.width for part in parts])
    start, length = np.moveaxis(np.stack([found, most_likely(wrong)]), -1, 0)[..., None]
    told = (start * np.exp(-np.square(widths / length))).mean(axis=-1)
    assert told[1].mean() < told[0].mean() / 2


@pytest.mark.parametrize("part", [0, 1])
def test_trust_is_a_probability(part):
    assert ((TRUST[part, :, 0] > 0.5) & (TRUST[part, :, 0] < 1)).all()
    assert np.all(TRUST[part, :, 1] > 0)
