# SPDX-License-Identifier: MIT
"""Layer of the closed shapes of things: what a symmetry implies, and what only closes them."""

from __future__ import annotations

import numpy as np

from completion.backs.closing import MEASURED as SEEN
from completion.result.completed_model import CompletedModel
from nbv.report.viewer.layers import Category, Classes, Layer
from nbv.report.viewer.unknown_layer import INFERRED, STATES, UNKNOWN
from scenes.checks import FloatArray, IntArray


def things_layer(completion: CompletedModel, names: tuple[Category, ...]) -> Layer:
    """Return the sides of things that nobody saw; `names` are of the surfaces, of which they are none."""
    parts, faces, states, n = list[FloatArray](), list[IntArray](), list[IntArray](), 0
    for one in completion.things:
        if one.back is None:
            continue
        shape, unseen = one.back.shape, one.back.shape.origin != SEEN
        parts.append(shape.vertices)
        faces.append(shape.faces[unseen].astype(np.int64) + n)
        states.append(np.where(one.is_inferred[unseen], STATES.index(INFERRED), STATES.index(UNKNOWN)))
        n += len(shape.vertices)
    state = np.concatenate([np.zeros(0, np.int64), *states]).astype(np.uint16)
    return Layer(
        "things",
        "sides of things that nobody saw",
        np.concatenate([np.zeros((0, 3)), *parts]),
        np.concatenate([np.zeros((0, 3), np.int64), *faces]),
        UNKNOWN,
        channels=(
            Classes("state", "State", STATES, state),
            Classes("surface", "Surface", names, np.zeros(len(state), np.uint16)),
        ),
        shown=False,
        is_framed=False,
    )
