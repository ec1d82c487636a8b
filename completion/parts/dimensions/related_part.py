# SPDX-License-Identifier: MIT
"""What dimensions read of a part: its surfaces as measured and where relations hold, and these relations."""

from __future__ import annotations

from typing import Protocol

from completion.fitting.result import SurfaceFit
from completion.parts.division.divided_part import DividedPart
from completion.relations.graph import RelationGraph


class RelatedPart(DividedPart, Protocol):
    """What is read of a part (`Part`)."""

    @property
    def measured(self) -> tuple[SurfaceFit, ...]:
        """The surfaces as their own points say."""

    @property
    def relations(self) -> RelationGraph | None:
        """What the surfaces of `related` are to each other."""

    @property
    def related(self) -> tuple[int, ...]:
        """Places of these surfaces."""
