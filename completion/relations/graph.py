# SPDX-License-Identifier: MIT
"""The graph of relations: what became of each, how free the surfaces still are, and where they are now."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from completion.fitting.result import SurfaceFit
from completion.relations.engine.equations import moved
from completion.relations.engine.estimate import Estimate
from completion.relations.engine.relation import Relation, Status
from completion.relations.options import RelationOptions
from scenes.checks import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class RelationGraph:
    """Surfaces and their relations.

    Attributes
    ----------
    fits : tuple of SurfaceFit
        The surfaces where the relations hold, with their covariances given these.
    relations : tuple of Relation
        All that were stated or proposed, in the order in which they were examined.
    moved_sd : tuple of float
        How far each surface was moved, the greatest part of it, in the standard deviations of its fit.
    unknowns, rank : int
        Parameters of all surfaces, and how many of them the relations take away.
    options : RelationOptions
        How exactly things were taken to be built, and what was looked for.
    covariance : (unknowns, unknowns) float
        Of the parameters of all surfaces, one after the other, given the relations.
    """

    fits: tuple[SurfaceFit, ...]
    relations: tuple[Relation, ...]
    moved_sd: tuple[float, ...]
    unknowns: int
    rank: int
    options: RelationOptions
    covariance: FloatArray

    @classmethod
    def of(cls, estimate: Estimate, relations: Sequence[Relation], options: RelationOptions) -> RelationGraph:
        """Return what the estimate came to."""
        fits, moves = [], []
        for number, fit in enumerate(estimate.fits):
            change = estimate.change(number)
            fits.append(
                replace(fit, surface=moved(fit.surface, change), covariance=estimate.covariance_of(number))
            )
            moves.append(estimate.moved_sd(number))
        return cls(
            fits=tuple(fits),
            relations=tuple(relations),
            moved_sd=tuple(moves),
            unknowns=estimate.n_unknowns,
            rank=estimate.rank,
            options=options,
            covariance=estimate.covariance,
        )

    @property
    def free(self) -> int:
        """Degrees of freedom that are left."""
        return self.unknowns - self.rank

    @property
    def accepted(self) -> tuple[Relation, ...]:
        """The relations that are imposed."""
        return tuple(one for one in self.relations if one.status is Status.ACCEPTED)

    def numbered(self, status: Status) -> int:
        """How many relations came to a status."""
        return sum(one.status is status for one in self.relations)

    def __repr__(self) -> str:
        counts = ", ".join(f"{self.numbered(status)} {status.value}" for status in Status)
        return f"RelationGraph({len(self.fits)} surfaces, {counts}, {self.free} of {self.unknowns} free)"


_MOST_TILT = float(np.radians(10.0))  # standard deviation of a direction, both ways together
_MOST_SHARE = 0.1  # of a radius that may be doubtful


def is_settled(fit: SurfaceFit) -> bool:
    """Whether a surface is known so well that its equations are linear within what is doubtful of it."""
    told = fit.parameter_deviations()
    if max(told.get("direction", 0.0), told.get("normal", 0.0)) >= _MOST_TILT:
        return False
    radii = [name for name in ("radius", "tube_radius") if name in told]
    return all(told[name] < _MOST_SHARE * float(getattr(fit.surface, name)) for name in radii)
