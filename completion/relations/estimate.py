# SPDX-License-Identifier: MIT
"""The joint estimate of all surfaces under the accepted relations, and the tests of each relation.

Each fit is the origin of a linear chart in which the data say x' Sigma^-1 x, whatever the number of points.
Relations c(x) = 0, or c(x) ~ N(0, R) where things are built within a tolerance, give

    x = Sigma A' S^-1 (A x - c),  S = A Sigma A' + R,  covariance Sigma - Sigma A' S^-1 A Sigma,

repeated from where the last round came to, A and c made anew there (Gauss-Newton on the constraints).

A relation that holds misses by c, of which W = c' S^-1 c has the chi-square distribution, or W over its rank
the F distribution where the covariances' scale was estimated (Wald's test).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise

import numpy as np
from scipy.linalg import LinAlgError, block_diag, cho_factor, cho_solve, qr
from scipy.sparse import csr_array
from scipy.special import chdtrc, fdtrc

from completion.fitting.result import SurfaceFit
from completion.relations.constraint import constrain
from completion.relations.equations import Constraint, Placement, RelationFrame, place
from completion.relations.limits import DETERMINED_SHARE, EXACT_SD, PART_SHARE
from completion.relations.relation import Relation
from scenes.checks import BoolArray, FloatArray, InputError

_N_ROUNDS = 20
_LOOSE = (0.0, 1e-14, 1e-12, 1e-10, 1e-8)  # of an equation's variance: what it may be off
_GROWTH = 0.2  # of the rank, after which all is solved together again
_EVERY = 60  # equations, up to which that is done after each
_ROUNDING = 1e-9  # metres or radians: what is measured without noise is no better known
_HELD = 1e-9  # of an equation's derivative, which is rounding
_LOST = 1e6  # deviations: a step beyond them leads nowhere
_STILL = 1e-12  # standard deviations: a step that is smaller is the last


@dataclass(frozen=True, slots=True, eq=False)
class ImposedRelation:
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

    def __init__(self, estimate: JointEstimate) -> None:
        super().__init__()
        self._estimate = estimate

    def __missing__(self, number: int) -> Placement:
        placement = place(self._estimate.fits[number].surface, self._estimate.change(number))
        self[number] = placement
        return placement


class JointEstimate:
    """The surfaces of fits, moved as far as the relations that are imposed want it.

    Parameters
    ----------
    fits : sequence of SurfaceFit
        Planes, spheres, cylinders, cones and tori with finite covariances. A parameter without variance,
        among others with some, is held exactly.
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
        self._is_free = np.concatenate(
            [
                np.ones(0),
                *((np.diag(fit.covariance) > 0) | (not np.diag(fit.covariance).any()) for fit in fits),
            ]
        )
        self.prior_sd = np.sqrt(np.diag(self._prior))
        self.x = np.zeros(first[-1])
        self.covariance = self._prior.copy()
        self.imposed: list[ImposedRelation] = []
        self._n_solved = 0
        self.at = _Placements(self)
        radii = [
            (radius, by[0], self.columns(number))
            for number, at in ((number, self.at[number]) for number in range(len(fits)))
            for radius, by in ((at.radius, at.by_radius), (at.ring_radius, at.by_ring_radius))
            if radius > 0 and at.half_angle == 0
        ]
        self._radii = np.array([radius for radius, *_ in radii])
        self._by_radii = np.zeros((len(radii), len(self.x)))
        for k, (_, by, stretch) in enumerate(radii):
            self._by_radii[k, stretch] = by
        self.frame = RelationFrame({number: self.at[number] for number in range(len(fits))}, up)

    @property
    def n_unknowns(self) -> int:
        """Parameters of all surfaces."""
        return len(self.x)

    @property
    def rank(self) -> int:
        """Degrees of freedom that the imposed relations take away."""
        return sum(len(relation.rows) for relation in self.imposed)

    def change(self, number: int) -> FloatArray:
        """How far the parameters (k,) of a surface have moved from its fit."""
        return np.asarray(self.x[self.columns(number)])

    def covariance_of(self, number: int) -> FloatArray:
        """Covariance (k, k) of the parameters of a surface, given the relations.

        What relations determine has none: where rounding leaves less than nothing, it is 0.
        """
        stretch = self.columns(number)
        left: FloatArray = self.covariance[stretch, stretch].copy()
        scale = np.outer(self.prior_sd[stretch], self.prior_sd[stretch])
        values, vectors = np.linalg.eigh(left / scale)
        return left if values[0] >= 0 else np.asarray((vectors * np.maximum(values, 0)) @ vectors.T * scale)

    def constraint(self, relation: Relation) -> Constraint:
        """The equations of a relation where the surfaces are now."""
        return constrain(relation, self.at, self.frame)

    def variance(self, constraint: Constraint, *, prior: bool = False) -> FloatArray:
        """Covariance (m, m) of the equations' values, with nothing imposed where `prior`."""
        n = len(constraint.value)
        covariance = np.zeros((n, n))
        for number, block in constraint.blocks.items():
            for two, other in constraint.blocks.items():
                among = (self._prior if prior else self.covariance)[self.columns(number), self.columns(two)]
                covariance += block @ among @ other.T
        return covariance

    def built_within(self, constraint: Constraint) -> FloatArray:
        """Variances (m,) of the equations by how exactly things are built."""
        return np.asarray(np.square(self.built_sd)[list(constraint.rows)])

    @property
    def cost(self) -> float:
        """How far the surfaces were moved, squared, in standard deviations: x' Sigma^-1 x."""
        unit = self.x / self.prior_sd
        scaled = self._prior / np.outer(self.prior_sd, self.prior_sd)
        return float(unit @ np.linalg.lstsq(scaled, unit, rcond=None)[0])

    def is_held(self, constraint: Constraint) -> BoolArray:
        """Which equations (m,) are of parameters alone that fits hold exactly, so that nothing moves them."""
        slopes = np.concatenate([block * self._is_free[self.columns(number)]
                                 for number, block in constraint.blocks.items()], axis=1)  # fmt: skip
        whole = np.concatenate(list(constraint.blocks.values()), axis=1)
        return np.asarray(np.linalg.norm(slopes, axis=1) <= _HELD * np.linalg.norm(whole, axis=1))

    def freedom_of(self, surfaces: Sequence[int]) -> float:
        """Degrees of freedom of a test of these surfaces: those of the least well known covariance."""
        return (
            min((self._doubt.freedom[surface] for surface in surfaces), default=np.inf)
            if self._doubt.freedom
            else np.inf
        )

    def moved_sd(self, number: int) -> float:
        """How far a surface was moved: the most along any principal direction, in deviations."""
        stretch = self.columns(number)
        scale, prior = self.prior_sd[stretch], self._prior[stretch, stretch]
        values, vectors = np.linalg.eigh(prior / np.outer(scale, scale))
        along = vectors.T @ (self.x[stretch] / scale)
        return float(np.max(np.abs(along) / np.sqrt(np.maximum(values, np.finfo(np.float64).eps))))

    def has_radii(self, x: FloatArray) -> bool:
        """Whether radii are above 0 where the surfaces' parameters have moved by x (p,)."""
        return bool((self._radii + self._by_radii @ x > _HELD * self._radii).all())

    def impose(self, relation: Relation, rows: list[int]) -> bool:
        """Impose some equations of a relation, and move the surfaces by one step.

        False, and nothing is imposed, where that would leave a surface no radius.
        """
        constraint = self.constraint(relation).only(rows)
        where = np.concatenate(
            [np.arange(self.n_unknowns)[self.columns(block)] for block in constraint.blocks]
        )
        jacobian = np.concatenate(list(constraint.blocks.values()), axis=1)
        gain = self.covariance[:, where] @ jacobian.T
        spread = jacobian @ gain[where] + np.diag(self.built_within(constraint))
        by = np.linalg.solve(spread, gain.T)
        moved = self.x - constraint.value @ by
        if not self.has_radii(moved):
            return False
        self.imposed.append(ImposedRelation(relation, rows))
        self.x = moved
        self.covariance -= gain @ by
        self.at.clear()
        return True

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
            step = np.abs(moved - self.x) / self.prior_sd
            if not step.max() < _LOST or not self.has_radii(moved):
                break
            self.x = moved
            self.at.clear()
            if step.max() < _STILL:
                break
        jacobian, _, within = self.equations()
        gain, factor = self.factor(jacobian, within)
        self.covariance = self._prior - gain @ cho_solve(factor, gain.T)

    def equations(self) -> tuple[csr_array, FloatArray, FloatArray]:
        """All equations that are imposed: their derivative (m, n), value (m,), variance as built (m,)."""
        parts = [self.constraint(relation.relation).only(relation.rows) for relation in self.imposed]
        data, row, column, first = [], [], [], 0
        for part in parts:
            n = len(part.value)
            for number, block in part.blocks.items():
                stretch = self.columns(number)
                data.append(block.ravel())
                row.append(np.repeat(np.arange(first, first + n), stretch.stop - stretch.start))
                column.append(np.tile(np.arange(stretch.start, stretch.stop), n))
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

    def anew(self) -> JointEstimate:
        """Return the estimate from the same fits with nothing imposed, that begins where this one is."""
        other = JointEstimate(self.fits, self.frame.up, self.built_sd, self._doubt)
        other.x = self.x.copy()
        other.at.clear()
        return other

    def columns(self, number: int) -> slice:
        """Where the parameters of a surface are among all."""
        return self._columns[number]


@dataclass(frozen=True, slots=True, eq=False)
class WaldTest:
    """What a relation is worth, given what is imposed.

    Attributes
    ----------
    rows : list of int
        Its equations that are not determined yet, the best known first.
    chi2, p : float
        Squared misfit of these in standard deviations, and the probability of one so large if it holds.
    log_density : float
        Of these equations' misfit.
    is_met : bool
        Whether the others, which are determined, hold.
    constraint : Constraint
        The equations where the estimate is.
    """

    rows: list[int]
    chi2: float
    p: float
    log_density: float
    is_met: bool
    constraint: Constraint


def wald_test(relation: Relation, estimate: JointEstimate) -> WaldTest:
    """Tell what a relation is worth, given those that are imposed.

    An equation counts as determined where what is imposed leaves less than a millionth of the variance that
    the fits alone give it.
    """
    constraint = estimate.constraint(relation)
    prior, now = estimate.variance(constraint, prior=True), estimate.variance(constraint)
    scale = np.sqrt(np.maximum(np.diag(prior), np.finfo(np.float64).tiny))
    may_move = ~estimate.is_held(constraint)
    rows = _independent(now * np.outer(may_move, may_move) / np.outer(scale, scale))
    free = [k for k in range(len(scale)) if k not in rows]
    value = constraint.value
    if not rows:
        is_met = _is_met(value, scale)
        return WaldTest(rows, chi2=0.0, p=1.0, log_density=0.0, is_met=is_met, constraint=constraint)
    spread = now + np.diag(estimate.built_within(constraint))
    inner = spread[np.ix_(rows, rows)]
    whitened = np.linalg.solve(inner, value[rows])
    square = float(value[rows] @ whitened)
    left = value[free] - spread[np.ix_(free, rows)] @ whitened
    _, log_volume = np.linalg.slogdet(2 * np.pi * inner)
    p = probability(square, len(rows), estimate.freedom_of(relation.surfaces))
    return WaldTest(
        rows,
        chi2=square,
        p=p,
        log_density=float(-(log_volume + square) / 2),
        is_met=_is_met(left, scale[free]),
        constraint=constraint,
    )


def multiplier_tests(estimate: JointEstimate) -> list[float]:
    """Return the probability of each imposed relation's misfit, given all the others.

    By the Lagrange multipliers lambda = S^-1 c0: W = lambda_k' [(S^-1)_kk]^-1 lambda_k.
    """
    jacobian, value, within = estimate.equations()
    _, factor = estimate.factor(jacobian, within)
    multiplier = cho_solve(factor, jacobian @ estimate.x - value)
    inverse = cho_solve(factor, np.eye(len(value)))
    tests, first = [], 0
    for relation in estimate.imposed:
        stretch = slice(first, first + len(relation.rows))
        square = float(multiplier[stretch] @ np.linalg.solve(inverse[stretch, stretch], multiplier[stretch]))
        freedom = estimate.freedom_of(relation.relation.surfaces)
        tests.append(probability(square, len(relation.rows), freedom))
        first += len(relation.rows)
    return tests


def probability(square: float, rank: int, freedom: float) -> float:
    """Return the probability of a squared misfit that is at least so large, where a relation holds."""
    if np.isfinite(freedom):
        return float(fdtrc(rank, freedom, square / rank))
    return float(chdtrc(rank, square))


def what_determines(constraint: Constraint, estimate: JointEstimate) -> list[int]:
    """Return the places among the imposed of those relations that determine the equations.

    They are the ones whose derivatives have a part in the sum that gives the equations' derivatives.
    """
    jacobian, _, _ = estimate.equations()
    members = np.zeros((len(constraint.value), estimate.n_unknowns))
    for number, block in constraint.blocks.items():
        members[:, estimate.columns(number)] = block
    scaled = jacobian.toarray() * estimate.prior_sd
    size = np.linalg.norm(scaled, axis=1, keepdims=True)
    share, *_ = np.linalg.lstsq((scaled / size).T, (members * estimate.prior_sd).T, rcond=1e-9)
    weight = np.abs(share).max(axis=1) / max(float(np.abs(share).max()), np.finfo(np.float64).tiny)
    which = np.repeat(np.arange(len(estimate.imposed)), [len(relation.rows) for relation in estimate.imposed])
    return sorted(set(which[weight > PART_SHARE].tolist()))


def with_only(relations: Sequence[Relation], estimate: JointEstimate) -> JointEstimate:
    """Return an estimate from the same fits with these relations imposed, where they say something.

    Derivatives are those where the surfaces are now, until all is solved.
    """
    other = estimate.anew()
    for relation in relations:
        rows = wald_test(relation, other).rows
        if rows:
            other.impose(relation, rows)
    other.solve()
    return other


def _is_met(value: FloatArray, scale: FloatArray) -> bool:
    """Whether equations that are determined hold, within a small part of what the fits say of them."""
    return bool((np.abs(value) <= EXACT_SD * scale).all())


def _independent(unit: FloatArray) -> list[int]:
    """Equations (m, m) in their own deviations that are not determined by others, the best first."""
    if not (np.diag(unit) > DETERMINED_SHARE).any():
        return []
    values, vectors = np.linalg.eigh((unit + unit.T) / 2)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    _, triangle, order = qr(root.T, mode="economic", pivoting=True)
    known = np.square(np.diag(triangle)) > DETERMINED_SHARE
    return sorted(int(k) for k in order[: int(np.count_nonzero(known))])
