# SPDX-License-Identifier: MIT
"""The joint estimate: all surfaces' parameters and their covariance, given the relations accepted so far.

Each fit is the origin of a linear chart in which the data say x' Sigma^-1 x, whatever the number of points.
Relations c(x) = 0, or c(x) ~ N(0, R) where things are built within a tolerance, give

    x = Sigma A' S^-1 (A x - c),  S = A Sigma A' + R,  covariance Sigma - Sigma A' S^-1 A Sigma,

repeated from where the last round came to, A and c made anew there (Gauss-Newton on the constraints).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise

import numpy as np
from scipy.linalg import LinAlgError, block_diag, cho_factor, cho_solve
from scipy.sparse import csr_array

from completion.fitting.result import SurfaceFit
from completion.relations.engine.constraint import constrain
from completion.relations.engine.equations import Constraint, Frame, Placement, place
from completion.relations.engine.relation import Relation
from scenes.checks import FloatArray, InputError

_N_ROUNDS = 20
_LOOSE = (0.0, 1e-14, 1e-12, 1e-10, 1e-8)  # of an equation's variance: what it may be off
_GROWTH = 0.2  # of the rank, after which all is solved together again
_EVERY = 60  # equations, up to which that is done after each
_ROUNDING = 1e-9  # metres or radians: what is measured without noise is no better known
_STILL = 1e-12  # standard deviations: a step that is smaller is the last


@dataclass(frozen=True, slots=True, eq=False)
class Imposed:
    """A relation that is imposed, and which of its equations say something that others do not."""

    relation: Relation
    rows: list[int]


@dataclass(frozen=True, slots=True, eq=False)
class Doubt:
    """What is doubtful of the covariances of n fits.

    Attributes
    ----------
    freedom : sequence of float
        Degrees of freedom (n,) from which the scale of each covariance was estimated; inf where it is known.
        Empty: all are known.
    shared : (p, p) float, optional
        Covariance of all p parameters, fit by fit, by errors that are not in the fits' own covariances and
        that several may share.
    """

    freedom: Sequence[float] = ()
    shared: FloatArray | None = None


NO_DOUBT = Doubt()


class _Placements(dict[int, Placement]):
    """Where each surface is; made when it is asked for, until `clear`."""

    def __init__(self, estimate: Estimate) -> None:
        super().__init__()
        self._estimate = estimate

    def __missing__(self, number: int) -> Placement:
        found = place(self._estimate.fits[number].surface, self._estimate.change(number))
        self[number] = found
        return found


class Estimate:
    """The surfaces of fits, moved as far as the relations that are imposed want it.

    Parameters
    ----------
    fits : sequence of SurfaceFit
        Planes, spheres, cylinders, cones and tori with finite covariances.
    up : (3,) float, optional
        Unit vector against gravity.
    sd : (3,) float
        How far things are built off what they are meant to be: angles in radians, lengths and radii in
        metres. Zeros: relations hold exactly.
    doubt : Doubt
        How well the covariances are known, and what errors the surfaces share.

    Raises
    ------
    InputError
        A surface that has no relations, or a covariance that is not finite.
    """

    def __init__(
        self, fits: Sequence[SurfaceFit], up: FloatArray | None, sd: FloatArray, doubt: Doubt = NO_DOUBT
    ) -> None:
        for number, fit in enumerate(fits):
            if not np.isfinite(fit.covariance).all():
                raise InputError(
                    f"surface {number}: its covariance is not finite: too few points for relations"
                )
        self.fits, self._doubt, self.built_sd = fits, doubt, sd
        first = [0, *accumulate(len(fit.covariance) for fit in fits)]
        self._columns = [slice(low, high) for low, high in pairwise(first)]
        self._prior = block_diag(np.zeros((0, 0)), *(fit.covariance for fit in fits))
        self._prior += _ROUNDING**2 * np.eye(len(self._prior))
        if doubt.shared is not None:
            self._prior = self._prior + doubt.shared
        self.prior_sd = np.sqrt(np.diag(self._prior))
        self.x = np.zeros(first[-1])
        self.covariance = self._prior.copy()
        self.imposed: list[Imposed] = []
        self._n_solved = 0
        self.at = _Placements(self)
        self.frame = Frame({number: self.at[number] for number in range(len(fits))}, up)

    @property
    def n_unknowns(self) -> int:
        """Parameters of all surfaces."""
        return len(self.x)

    @property
    def rank(self) -> int:
        """Degrees of freedom that the imposed relations take away."""
        return sum(len(one.rows) for one in self.imposed)

    def change(self, number: int) -> FloatArray:
        """How far the parameters (k,) of a surface have moved from its fit."""
        return np.asarray(self.x[self.columns(number)])

    def covariance_of(self, number: int) -> FloatArray:
        """Covariance (k, k) of the parameters of a surface, given the relations."""
        own = self.columns(number)
        return np.asarray(self.covariance[own, own])

    def constraint(self, relation: Relation) -> Constraint:
        """The equations of a relation where the surfaces are now."""
        return constrain(relation, self.at, self.frame)

    def variance(self, constraint: Constraint, *, prior: bool = False) -> FloatArray:
        """Covariance (m, m) of the equations' values, with nothing imposed where `prior`."""
        n = len(constraint.value)
        found = np.zeros((n, n))
        for one, block in constraint.blocks.items():
            for two, other in constraint.blocks.items():
                among = (self._prior if prior else self.covariance)[self.columns(one), self.columns(two)]
                found += block @ among @ other.T
        return found

    def built_within(self, constraint: Constraint) -> FloatArray:
        """Variances (m,) of the equations by how exactly things are built."""
        return np.asarray(np.square(self.built_sd)[list(constraint.rows)])

    @property
    def cost(self) -> float:
        """How far the surfaces were moved, squared, in standard deviations: x' Sigma^-1 x."""
        unit = self.x / self.prior_sd
        scaled = self._prior / np.outer(self.prior_sd, self.prior_sd)
        return float(unit @ np.linalg.lstsq(scaled, unit, rcond=None)[0])

    def freedom_of(self, surfaces: Sequence[int]) -> float:
        """Degrees of freedom of a test of these surfaces: those of the least well known covariance."""
        return (
            min((self._doubt.freedom[one] for one in surfaces), default=np.inf)
            if self._doubt.freedom
            else np.inf
        )

    def moved_sd(self, number: int) -> float:
        """How far a surface was moved: the most along any principal direction, in deviations."""
        own = self.columns(number)
        scale, prior = self.prior_sd[own], self._prior[own, own]
        values, vectors = np.linalg.eigh(prior / np.outer(scale, scale))
        along = vectors.T @ (self.x[own] / scale)
        return float(np.max(np.abs(along) / np.sqrt(np.maximum(values, np.finfo(np.float64).eps))))

    def impose(self, relation: Relation, rows: list[int]) -> None:
        """Impose some equations of a relation, and move the surfaces by one step."""
        constraint = self.constraint(relation).only(rows)
        self.imposed.append(Imposed(relation, rows))
        where = np.concatenate([np.arange(self.n_unknowns)[self.columns(one)] for one in constraint.blocks])
        jacobian = np.concatenate(list(constraint.blocks.values()), axis=1)
        gain = self.covariance[:, where] @ jacobian.T
        spread = jacobian @ gain[where] + np.diag(self.built_within(constraint))
        by = np.linalg.solve(spread, gain.T)
        self.x = self.x - constraint.value @ by
        self.covariance -= gain @ by
        self.at.clear()

    def settle(self) -> None:
        """Solve, where so much was imposed since that derivatives may have changed."""
        if self.rank > self._n_solved + (_GROWTH * self._n_solved if self._n_solved > _EVERY else 0):
            self.solve()

    def solve(self) -> None:
        """Move the surfaces to where all that is imposed holds together, derivatives made anew there."""
        if not self.imposed:
            return
        self._n_solved = self.rank
        for _ in range(_N_ROUNDS):
            jacobian, value, within = self.equations()
            gain, factor = self.factor(jacobian, within)
            moved = gain @ cho_solve(factor, jacobian @ self.x - value)
            step, self.x = np.abs(moved - self.x) / self.prior_sd, moved
            self.at.clear()
            if step.max() < _STILL:
                break
        jacobian, _, within = self.equations()
        gain, factor = self.factor(jacobian, within)
        self.covariance = self._prior - gain @ cho_solve(factor, gain.T)

    def equations(self) -> tuple[csr_array, FloatArray, FloatArray]:
        """All equations that are imposed: their derivative (m, n), value (m,), variance as built (m,)."""
        parts = [self.constraint(one.relation).only(one.rows) for one in self.imposed]
        data, row, column, first = [], [], [], 0
        for part in parts:
            n = len(part.value)
            for number, block in part.blocks.items():
                own = self.columns(number)
                data.append(block.ravel())
                row.append(np.repeat(np.arange(first, first + n), own.stop - own.start))
                column.append(np.tile(np.arange(own.start, own.stop), n))
            first += n
        places = np.concatenate(row), np.concatenate(column)
        jacobian = csr_array((np.concatenate(data), places), shape=(first, self.n_unknowns))
        value = np.concatenate([part.value for part in parts])
        return jacobian, value, np.concatenate([self.built_within(part) for part in parts])

    def factor(self, jacobian: csr_array, within: FloatArray) -> tuple[FloatArray, tuple[FloatArray, bool]]:
        """Sigma A' as (n, m), and the Cholesky factor of S.

        Equations that are told apart where they were tested may depend on one another where all of them hold.
        Then each holds to as small a part of its own deviation as makes S positive definite.
        """
        gain = np.asarray((jacobian @ self._prior).T)
        variance = np.asarray(jacobian @ gain + np.diag(within))
        for share in _LOOSE:
            try:
                return gain, cho_factor(variance + np.diag(share * np.diag(variance)))
            except LinAlgError:
                continue
        raise InputError(
            f"the {len(variance)} equations of the relations depend on one another; state fewer of them"
        )

    def anew(self) -> Estimate:
        """Return the estimate from the same fits with nothing imposed, that begins where this one is."""
        other = Estimate(self.fits, self.frame.up, self.built_sd, self._doubt)
        other.x = self.x.copy()
        other.at.clear()
        return other

    def columns(self, number: int) -> slice:
        """Where the parameters of a surface are among all."""
        return self._columns[number]
