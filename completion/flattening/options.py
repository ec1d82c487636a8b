# SPDX-License-Identifier: MIT
"""Options of flattening."""

from __future__ import annotations

from dataclasses import dataclass

from scenes.checks import InputError


@dataclass(frozen=True, slots=True, kw_only=True)
class FlatteningOptions:
    """What is kept, and how finely a surface is looked at.

    Attributes
    ----------
    level : float
        Relief is kept where a wall without any would show such a region, anywhere on it, with at most this
        probability.
    cell_m : float or None
        Side of the cells of a mesh's planes, metres; None takes the spacing of the vertices.
    most_cells : int
        A plane of more cells than this gets larger ones.
    clears_relief : bool
        Whether the ripple is taken away from relief too, where the two part.
    rounding_m : float
        Difference of heights that rounding alone makes, metres: of a sensor whose ranges come in steps. What
        is no higher is no relief, however evident.
    """

    level: float = 0.01
    cell_m: float | None = None
    most_cells: int = 120_000
    clears_relief: bool = True
    rounding_m: float = 0.0

    def __post_init__(self) -> None:
        if not 0 < self.level < 1:
            raise InputError(f"the level is a probability between 0 and 1, not {self.level}")
        if self.cell_m is not None and not 0 < self.cell_m < float("inf"):
            raise InputError(f"the side of a cell is a length above 0, not {self.cell_m} m")
        if not 0 <= self.rounding_m < float("inf"):
            raise InputError(f"rounding makes heights differ by 0 m or more, not {self.rounding_m}")
        if self.most_cells < 1000:
            raise InputError(f"at least 1,000 cells are needed, not {self.most_cells}")
