# SPDX-License-Identifier: MIT
"""Options of back sides: from which probability a symmetry is asserted, and how large things are."""

from __future__ import annotations

from dataclasses import dataclass

from scenes.checks import InputError, Value


@dataclass(frozen=True, kw_only=True, slots=True)
class BackOptions(Value):
    """What is inferred of the unseen sides of things.

    Parameters
    ----------
    least : float
        Probability from which surface implied by a symmetry counts as inferred; below, it is unknown.
    size_m : tuple of float
        Smallest and largest diagonal of a thing's box, metres; others are left out.

    Raises
    ------
    InputError
        A probability outside 0.5..1, sizes that are not two growing positive numbers.
    """

    least: float = 0.8
    size_m: tuple[float, float] = (0.1, 3.0)

    def __post_init__(self) -> None:
        if not 0.5 <= self.least <= 1:
            raise InputError(f"least must lie between 0.5 and 1, got {self.least}")
        low, high = self.size_m
        if not 0 < low < high:
            raise InputError(f"size_m must be two growing positive lengths, got {self.size_m}")
