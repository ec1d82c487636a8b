# SPDX-License-Identifier: MIT
"""Layer of what is unknown in a completed model: hidden, neither measured nor inferred."""

from __future__ import annotations

import numpy as np

from completion.result.completed_model import CompletedModel
from nbv.report.figures import picture
from nbv.report.viewer.layers import Category, Classes, Layer

MEASURED = Category("measured", picture.MEASURED)
INFERRED = Category("inferred", picture.INFERRED)
UNKNOWN = Category("unknown", picture.UNKNOWN, "hatched")
STATES = (MEASURED, INFERRED, UNKNOWN)


def unknown_layer(completion: CompletedModel, names: tuple[Category, ...]) -> Layer:
    """Return where surfaces may go on, but were hidden, and nothing is inferred; `names` are theirs."""
    parts = [(number, one.unknown) for number, one in enumerate(completion.surfaces, start=1)]
    start = np.cumsum([0, *(len(part.vertices) for _, part in parts)])
    faces = [part.faces + first for (_, part), first in zip(parts, start, strict=False)]
    vertices = np.concatenate([np.zeros((0, 3)), *(part.vertices for _, part in parts)])
    counts = [len(part.faces) for _, part in parts]
    number = np.repeat([number for number, _ in parts], counts).astype(np.uint16)
    state = np.full(len(number), STATES.index(UNKNOWN), np.uint16)
    return Layer(
        "unknown",
        "unknown: hidden, not inferred",
        completion.drawing_from_reference.apply(vertices),
        np.concatenate([np.zeros((0, 3), np.int64), *faces]),
        UNKNOWN,
        channels=(Classes("state", "State", STATES, state), Classes("surface", "Surface", names, number)),
        is_framed=False,
    )
