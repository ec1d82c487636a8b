# SPDX-License-Identifier: MIT
"""Colours of states and verdicts can be told apart, by colour-blind eyes and in a grey print too.

Dichromacies as of Machado, Oliveira & Fernandes (2009), at full severity; differences by CIEDE2000.
"""

from itertools import combinations

import numpy as np
import pytest
from skimage.color import deltaE_ciede2000, rgb2lab

from nbv.inspection.verdict_colours import rgb_of
from nbv.report.blocks.page import state_colours
from nbv.report.figures.plots import _DARK, LIGHT

EYES = {
    "normal": np.eye(3),
    "protanopia": [
        [0.152286, 1.052583, -0.204868],
        [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ],
    "deuteranopia": [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ],
    "tritanopia": [
        [1.255528, -0.076749, -0.178779],
        [-0.078411, 0.930809, 0.147602],
        [0.004733, 0.691367, 0.303900],
    ],
    "grey print": np.tile([0.2126, 0.7152, 0.0722], (3, 1)),
}
LEAST, LEAST_GREY = 15.0, 10.0
COLOURS = {name: np.array(rgb_of(colour)) for name, colour in state_colours().items()}
COLOURS["unreachable"] = 0.38 * COLOURS["unknown"] + 0.62  # as style.css mixes it
STATES = ("measured", "modelled", "inferred", "unknown", "unreachable")
VERDICTS = ("within", "deviates", "undecided", "missing", "hidden", "not-seen", "not-tested")
MARKS = {
    "modelled": "dots",
    "unknown": "hatch",
    "hidden": "hatch",
    "not-seen": "dots",
    "not-tested": "outline",
}


def seen(rgb, eye):
    """An sRGB colour as an eye sees it."""
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    mixed = np.clip(np.asarray(EYES[eye]) @ linear, 0, 1)
    return np.where(mixed <= 0.0031308, 12.92 * mixed, 1.055 * mixed ** (1 / 2.4) - 0.055)


def difference(one, other, eye):
    return float(deltaE_ciede2000(*(rgb2lab(seen(COLOURS[name], eye)) for name in (one, other))))


@pytest.mark.parametrize("names", [STATES, VERDICTS], ids=["states", "verdicts"])
@pytest.mark.parametrize("eye", [eye for eye in EYES if eye != "grey print"])
def test_colours_differ_to_every_eye(names, eye):
    found = {pair: difference(*pair, eye) for pair in combinations(names, 2)}
    assert min(found.values()) >= LEAST, sorted(found.items(), key=lambda one: one[1])[:3]


@pytest.mark.parametrize("names", [STATES, VERDICTS], ids=["states", "verdicts"])
def test_a_grey_print_tells_them_by_tone_or_by_mark(names):
    alike = [
        (one, other, round(difference(one, other, "grey print"), 1))
        for one, other in combinations(names, 2)
        if MARKS.get(one) == MARKS.get(other) and difference(one, other, "grey print") < LEAST_GREY
    ]
    assert alike == []


def test_what_is_inferred_is_blue_and_plots_have_the_same_colours():
    red, green, blue = COLOURS["inferred"]
    assert blue > 1.5 * green > 1.5 * red
    for theme in (LIGHT, _DARK):
        assert (theme.measured, theme.modelled) == (state_colours()["measured"], state_colours()["modelled"])
