# SPDX-License-Identifier: MIT
"""Equations c(x) = 0 of surfaces' parameters, with their derivatives, and what they are measured in."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from completion.relations.engine.placement import Placement
from scenes.checks import FloatArray

ANGLE, LENGTH, RADIUS = 0, 1, 2  # what a row is of

Rows = tuple[FloatArray | np.float64, dict[int, FloatArray]]
"""Values of equations, and their derivatives by the parameters of each surface."""


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """What relations are measured in that is not of the surfaces: where they began, and which way is up.

    `kept` remembers what was worked out of where they began, by the surfaces that it is of.
    """

    start: Mapping[int, Placement]  # by number
    up: FloatArray | None = None  # (3,) unit vector
    kept: dict[tuple[int, ...], Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False)
class Constraint:
    """The equations of a relation at a place.

    Attributes
    ----------
    value : (m,) float
        c, metres and radians.
    blocks : dict of int to (m, k) float
        Derivative by the k parameters of each of its surfaces.
    rows : (m,) int
        ANGLE, LENGTH or RADIUS: what each equation is of.
    """

    value: FloatArray
    blocks: dict[int, FloatArray]
    rows: tuple[int, ...]

    def only(self, kept: Sequence[int]) -> Constraint:
        """Some of the equations."""
        some = list(kept)
        blocks = {one: block[some] for one, block in self.blocks.items()}
        return Constraint(self.value[some], blocks, tuple(self.rows[k] for k in some))


def built(rows: Rows, what: int) -> Constraint:
    """Equations that are all of one thing (ANGLE, LENGTH or RADIUS)."""
    value = np.atleast_1d(np.asarray(rows[0], dtype=np.float64))
    blocks = {number: np.atleast_2d(block) for number, block in rows[1].items()}
    return Constraint(value, blocks, (what,) * len(value))


def stacked(parts: Sequence[Constraint]) -> Constraint:
    """Equations below one another; each part may be of some of the surfaces."""
    widths = {number: block.shape[1] for part in parts for number, block in part.blocks.items()}
    blocks = {
        number: np.concatenate([part.blocks.get(number, np.zeros((len(part.rows), width))) for part in parts])
        for number, width in widths.items()
    }
    return Constraint(
        np.concatenate([part.value for part in parts]), blocks, sum((part.rows for part in parts), ())
    )


def weighted(parts: Sequence[tuple[float, Rows]]) -> Rows:
    """The sum of values, each with its weight, and its derivatives."""
    blocks: dict[int, FloatArray] = {}
    for weight, (_, some) in parts:
        for number, block in some.items():
            blocks[number] = blocks[number] + weight * block if number in blocks else weight * block
    return sum((weight * np.asarray(value) for weight, (value, _) in parts), np.zeros(())), blocks
