# SPDX-License-Identifier: MIT
"""What a cover is: the chosen candidates, and how many any choice must have."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from nbv.cover.certificate import Certificate
from nbv.run.wording import count


@dataclass(frozen=True, slots=True)
class LowerBound:
    """At least `views` are needed with these candidates and samples; `kind` says by which argument.

    Registration constraints are left aside: they only ever ask for more.
    """

    views: int
    kind: str

    def describe(self) -> str:
        """Return the bound in words."""
        return (
            f"at least {count(self.views, 'view is', 'views are')} needed with these candidates and samples, "
            f"registration constraints left aside ({self.kind})"
        )

    def to_json(self) -> dict[str, Any]:
        """Return the entry of `plan.json`."""
        return {"views": self.views, "kind": self.kind}


@dataclass(frozen=True, slots=True, eq=False)
class Cover:
    """A choice of candidates.

    Attributes
    ----------
    chosen : tuple of int
        Numbers of the candidates, each adding most to those before it.
    is_complete : bool
        Whether they cover what was wanted; a limit on their number may forbid it.
    bound : LowerBound
        How many any complete choice has at least.
    certificate : Certificate
        Multipliers that prove the bound of the linear relaxation.
    steps : int
        Swaps tried.
    was_cut_short : bool
        Whether the clock ended the search: another machine may then find another cover.
    """

    chosen: tuple[int, ...]
    is_complete: bool
    bound: LowerBound
    certificate: Certificate
    steps: int = 0
    was_cut_short: bool = False

    @property
    def is_smallest(self) -> bool:
        """Whether no complete choice is smaller."""
        return self.is_complete and len(self.chosen) <= self.bound.views
