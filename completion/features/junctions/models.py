# SPDX-License-Identifier: MIT
"""Models of junctions: surfaces of few parameters in their frames, with starting values and a robust fit.

The fit is Levenberg-Marquardt on robust distances, with noise and outliers as a mixture.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from completion.features.engine.template import Measurements
from completion.features.junctions.limits import LEAST_SIGMA, OUTLIERS, SAME_SURFACE, WITHIN_SD
from scenes.checks import BoolArray, FloatArray, IntArray

POSE = ("turn_x", "turn_y", "turn_z", "x", "y", "z")


@dataclass(frozen=True, slots=True, eq=False)
class ProfileSection:
    """What a shape says of points in its frame.

    Attributes
    ----------
    distance : (n,) float
        Signed distances.
    slope : (n, 3) float
        Their derivatives by place.
    by_shape : (n, s) float
        Their derivatives by the numbers of the shape.
    face : (n,) int
        The face that each is beside, from 1.
    """

    distance: FloatArray
    slope: FloatArray
    by_shape: FloatArray
    face: IntArray


def rotation(vector: FloatArray) -> FloatArray:
    """Return the matrix (3, 3) that turns about a vector (3,) by its length (Rodrigues)."""
    angle = float(np.sqrt(vector @ vector))
    x, y, z = vector
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    if angle < 1e-8:
        return np.asarray(np.eye(3) + cross)
    sine, versine = np.sin(angle) / angle, (1 - np.cos(angle)) / angle**2
    return np.asarray(np.eye(3) + sine * cross + versine * (cross @ cross))


Profile = Callable[[FloatArray, FloatArray], ProfileSection]
"""From points (n, 3) in the frame and the numbers of the shape (s,) to distances and derivatives."""


@dataclass(frozen=True, slots=True, eq=False)
class Model:
    """A surface somewhere: its parameters are three turns and three shifts in its own frame, and its shape.

    Attributes
    ----------
    profile : callable
        What the shape is.
    turn : (3, 3) float
        Rows: axes of its frame.
    origin : (3,) float
        Of its frame.
    shape : (s,) float
        Its numbers.
    is_free : (6 + s,) bool
        Which parameters may move: not those that do nothing, nor those that are given.
    ties : (6 + s, m) float, optional
        Steps of all parameters by those of the m that move; by default each moves by itself.
    """

    profile: Profile
    turn: FloatArray
    origin: FloatArray
    shape: FloatArray
    is_free: BoolArray
    ties: FloatArray | None = None

    @property
    def basis(self) -> FloatArray:
        """Steps of all parameters (6 + s, m) by those of the m that move."""
        return np.eye(len(self.is_free))[:, self.is_free] if self.ties is None else self.ties

    def local(self, points: FloatArray) -> FloatArray:
        """Return points (n, 3) in its frame."""
        return np.asarray((points - self.origin) @ self.turn.T)

    def section(self, points: FloatArray) -> ProfileSection:
        """Return what its shape says of points (n, 3)."""
        return self.profile(self.local(points), self.shape)

    def distance(self, points: FloatArray) -> FloatArray:
        """Return the signed distances (n,) of points (n, 3)."""
        return self.section(points).distance

    def linearise(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the distances (n,) of points (n, 3), and their derivatives (n, m) by what moves."""
        local = self.local(points)
        at = self.profile(local, self.shape)
        (x, y, z), (u, v, w) = local.T, at.slope.T
        turned = [y * w - z * v, z * u - x * w, x * v - y * u]
        every = np.vstack([*turned, -u, -v, -w, at.by_shape.T])
        return at.distance, (self.basis.T @ every).T

    def move(self, step: FloatArray) -> Model:
        """Return it after a step (m,)."""
        every = self.basis @ step
        turned = rotation(every[:3]) @ self.turn
        return replace(
            self, turn=turned, origin=self.origin + every[3:6] @ self.turn, shape=self.shape + every[6:]
        )


def tangent_arcs(local: FloatArray, shape: FloatArray) -> ProfileSection:
    """Return the distances of points (n, 3) to two arcs along z that touch in x = y = 0.

    d(x, y; k) = (2 x + k (x^2 + y^2)) / (1 + sqrt(1 + k (2 x + k (x^2 + y^2)))) with the curvatures (2,): the
    first where y > 0. Each is of either sign, or none: its circle's middle lies at x = -1 / k. The side is
    decided by the plane y = 0, not by the nearer surface, which noise would decide near the joint.
    """
    x, y = local[:, 0], local[:, 1]
    is_first = y > 0
    k = np.where(is_first, shape[0], shape[1])
    square = x * x + y * y
    s = 2 * x + k * square
    root = np.maximum(np.sqrt(np.maximum(1 + k * s, 0.0)), 1e-9)
    distance = s / (1 + root)
    slope = np.column_stack([(1 + k * x) / root, k * y / root, np.zeros(len(x))])
    by_k = (square - distance**2) / (2 * root)
    by_shape = np.column_stack([np.where(is_first, by_k, 0.0), np.where(is_first, 0.0, by_k)])
    return ProfileSection(distance, slope, by_shape, np.where(is_first, 1, 2))


def edge(local: FloatArray, shape: FloatArray) -> ProfileSection:
    """Return the distances of points (n, 3) to two planes that meet along z and lean by an angle (1,)."""
    cosine, sine = np.cos(shape[0]), np.sin(shape[0])
    x, y, side = local[:, 0], np.abs(local[:, 1]), np.where(local[:, 1] > 0, 1.0, -1.0)
    slope = np.column_stack([np.full(len(x), cosine), side * sine, np.zeros(len(x))])
    by_shape = (y * cosine - x * sine)[:, None]
    return ProfileSection(x * cosine + y * sine, slope, by_shape, np.where(side > 0, 1, 2))


def elbow(local: FloatArray, shape: FloatArray) -> ProfileSection:
    """Return the distances of points (n, 3) to a bend of a tube about z, and the straight tubes beyond.

    The shape (3,): half the angle of the bend, which lies about the x axis; its radius; the tube's. The
    tubes touch the bend where it ends. Faces: 1 the bend, 2 the tube at y > 0, 3 the other.
    """
    half, bend, tube = shape
    cosine, sine = np.cos(half), np.sin(half)
    x, y, z = local.T
    side = np.where(y > 0, 1.0, -1.0)
    beyond = np.abs(y) * cosine - x * sine
    is_tube = beyond > 0
    out = np.maximum(np.hypot(x, y), 1e-12)
    u = np.where(is_tube, x * cosine + np.abs(y) * sine, out) - bend
    w = np.maximum(np.hypot(u, z), 1e-12)
    by_x = np.where(is_tube, cosine, x / out)
    by_y = np.where(is_tube, side * sine, y / out)
    share = u / w
    slope = np.column_stack([share * by_x, share * by_y, z / w])
    by_shape = np.column_stack([np.where(is_tube, share * beyond, 0.0), -share, np.full(len(x), -1.0)])
    return ProfileSection(w - tube, slope, by_shape, np.where(is_tube, np.where(side > 0, 2, 3), 1))


N_DIRECTIONS = 12
_SPLITS = (0.15, 0.25, 0.35, 0.45, 0.55, 0.65, 0.75, 0.85)  # of an arc, where a joint may be
_N_REWEIGHTED = 6  # rounds


class Unit(NamedTuple):
    """What was measured, about its median and at unit RMS."""

    measured: Measurements
    centre: FloatArray  # (3,) in the old unit
    factor: float  # new units in an old one

    @property
    def points(self) -> FloatArray:
        """Return the points (n, 3)."""
        return self.measured.points

    def outside(self, points: FloatArray) -> FloatArray:
        """Return points (..., 3) in the old unit."""
        return np.asarray(points / self.factor + self.centre)


def at_unit(measured: Measurements) -> Unit:
    """Return what was measured at unit RMS."""
    centre = np.median(measured.points, axis=0)
    square = ((measured.points - centre) ** 2).sum(axis=1)
    factor = 1 / max(float(np.sqrt(square.mean())), 1e-300)
    beams = measured.beams and replace(measured.beams, origins=measured.beams.origins - centre)
    moved = replace(measured, points=measured.points - centre, beams=beams)
    return Unit(moved.scale(factor), centre, factor)


def flat_starts(
    points: FloatArray,
    profile: Profile,
    shapes: FloatArray,
    is_free: BoolArray,
    ties: FloatArray | None = None,
    n_directions: int = N_DIRECTIONS,
) -> list[Model]:
    """Return starts in the principal frame of points (n, 3), with each of the shapes (m, s).

    x lies along the direction of least variance, z in so many directions across it.
    """
    centre = points.mean(axis=0)
    _, axes = np.linalg.eigh((points - centre).T @ (points - centre))
    normal, first, second = axes.T
    starts = []
    for angle in np.arange(n_directions) * np.pi / n_directions:
        along = np.cos(angle) * first + np.sin(angle) * second
        turn = np.stack([normal, np.cross(along, normal), along])
        starts += [Model(profile, turn, centre, shape, is_free, ties=ties) for shape in shapes]
    return starts


def split_starts(single: Model, points: FloatArray, sigma: float, is_free: BoolArray) -> list[Model]:
    """Return starts for two tangent arcs from one arc that points (n, 3) fit best, with noise of sigma.

    For each of some joints along the arc, what both sides bend more or less than it is linear in the
    distances from it: c + b s + a1 s^2 / 2 where s > 0, and a2 where s < 0, with s the length of arc from the
    joint; solved with weights that fall with the distance left over (Cauchy's). The model most likely by
    these is a better start than one of guessed bends: outliers hide which of several valleys is the deepest.
    """
    k, local, far = float(single.shape[0]), single.local(points), single.distance(points)
    near = np.abs(far) < WITHIN_SD * sigma
    angles = np.arctan2(k * local[:, 1], 1 + k * local[:, 0]) if k else local[:, 1]
    starts = []
    for angle in np.quantile(angles[near] if near.any() else angles, _SPLITS):
        s = (angles - angle) / k if k else angles - angle
        shift_out, lean, *bends = _bent(s, far, near, sigma)
        cosine, sine = (np.cos(angle), np.sin(angle)) if k else (1.0, 0.0)
        arc = np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        place = np.array([(cosine - 1) / k, sine / k, 0.0]) if k else np.array([0.0, angle, 0.0])
        leaning = np.array([[1.0, -lean, 0.0], [lean, 1.0, 0.0], [0.0, 0.0, np.hypot(1.0, lean)]])
        turn = leaning / np.hypot(1.0, lean) @ arc
        origin = single.origin + (place + shift_out * arc[0]) @ single.turn
        shape = k - np.array(bends)
        starts.append(Model(single.profile, turn @ single.turn, origin, shape, is_free))
    return starts


def _bent(s: FloatArray, far: FloatArray, near: BoolArray, sigma: float) -> FloatArray:
    """Coefficients (4,) of distances (n,) by lengths of arc s (n,): 1, s, s^2 / 2 on each side."""
    square = s**2 / 2
    columns = np.column_stack([np.ones(len(s)), s, np.where(s > 0, square, 0), np.where(s > 0, 0, square)])
    weight = near.astype(np.float64)
    for _ in range(_N_REWEIGHTED):
        root = np.sqrt(weight)
        solution = np.linalg.lstsq(root[:, None] * columns, root * far, rcond=None)[0]
        weight = 1 / (1 + ((far - columns @ solution) / sigma) ** 2) ** 2
    return np.asarray(solution)


_N_MIXTURE_ROUNDS = 60


@dataclass(frozen=True, slots=True)
class Mixture:
    """Density of distances: (1 - share) N(d; 0, sigma) + share / reach.

    Attributes
    ----------
    sigma : float
        Of the noise.
    share : float
        Of outliers.
    reach : float
        Over which outliers are spread, across the surface.
    """

    sigma: float
    share: float
    reach: float

    @classmethod
    def of(cls, distances: FloatArray, reach: float, sigma: float, least: float) -> Mixture:
        """Return the most likely mixture of distances (n,), from a sigma near it and never below a least one.

        Expectation and maximisation (Dempster, Laird & Rubin 1977): a cut would take the outliers within it
        for noise, and the noise for larger than it is.
        """
        mixture = cls(max(sigma, least), 0.2, reach)
        square = distances**2
        for _ in range(_N_MIXTURE_ROUNDS):
            weight = mixture.weights(distances)
            total = float(weight.sum())
            if total < 1:
                break
            new = max(float(np.sqrt(weight @ square / total)), least)
            share = float(np.clip(1 - total / len(distances), *OUTLIERS))
            done = abs(new - mixture.sigma) < 1e-5 * new
            mixture = cls(new, share, reach)
            if done:
                break
        return mixture

    def weights(self, distances: FloatArray) -> FloatArray:
        """Return how likely each of the distances (n,) is noise (n,)."""
        normal = (1 - self.share) * self._normal(distances)
        return np.asarray(normal / (normal + self.share / self.reach))

    def log_densities(self, distances: FloatArray) -> FloatArray:
        """Return the logarithms (n,) of the density of distances (n,)."""
        return np.log((1 - self.share) * self._normal(distances) + self.share / self.reach)

    def _normal(self, distances: FloatArray) -> FloatArray:
        return np.asarray(np.exp(-0.5 * (distances / self.sigma) ** 2) / (np.sqrt(2 * np.pi) * self.sigma))


def thickness(points: FloatArray) -> float:
    """Return the extent of points (n, 3) along the direction in which they vary least."""
    centred = points - points.mean(axis=0)
    _, axes = np.linalg.eigh(centred.T @ centred)
    return float(max(np.ptp(centred @ axes[:, 0]), 1e-300))


_N_SAMPLE, _N_BEST = 600, 4  # points that all starts see; starts that see all points
_CAUCHY = (0.3, 0.1, 0.03)  # scales at unit RMS
_N_STEPS, _N_ROUNDS = 12, 30
_DAMPING = 1e-3
_LEAST_STEP, _COARSE_STEP = 1e-6, 1e-2  # of all residuals, by which the last step changes them

Weights = Callable[[FloatArray], FloatArray]
"""From distances (n,) to weights (n,)."""


class Descent(NamedTuple):
    """Where a descent ended."""

    model: Model
    mixture: Mixture  # of the distances
    log_likelihood: float  # of all points that it saw
    evaluations: int


def cauchy(scale: float) -> Weights:
    """Return Cauchy's weights at a scale, from distances (n,) to (n,)."""
    return lambda distance: 1 / (1 + (distance / scale) ** 2)


def descend(
    model: Model, points: FloatArray, weights: Weights, n_steps: int = _N_STEPS, least: float = _LEAST_STEP
) -> tuple[Model, int]:
    """Return the model after steps of reweighted, damped least squares on points (n, 3), and how many."""
    damping, n_spent = _DAMPING, 0
    distance, slopes = model.linearise(points)
    for _ in range(n_steps):
        weight = weights(distance)
        matrix, gradient = slopes.T @ (weight[:, None] * slopes), slopes.T @ (weight * distance)
        before = float(weight @ distance**2)
        scale = np.maximum(np.diag(matrix), 1e-12 * max(float(np.trace(matrix)), 1e-300))
        gained = False
        for _ in range(6):
            step = np.asarray(np.linalg.solve(matrix + damping * np.diag(scale), -gradient), dtype=float)
            moved = model.move(step)
            new, new_slopes = moved.linearise(points)
            n_spent += 1
            if np.isfinite(new).all() and float(weight @ new**2) <= before:
                gained = True
                break
            damping *= 10
        if not gained:
            break
        model, distance, slopes = moved, new, new_slopes
        damping = max(damping / 10, 1e-9)
        if float(np.sqrt((step**2 * scale).sum())) < least * max(np.sqrt(before), 1e-300):
            break
    return model, n_spent


def descend_from(
    starts: Sequence[Model], points: FloatArray, reach: float, near: Sequence[Model] = ()
) -> list[Descent]:
    """Return where several starts lead, the most likely first.

    Each goes down by Cauchy's weights at falling scales on 600 of the points; the four most likely go on as
    mixtures of noise and outliers on all. Those that are `near` a solution need no such way down, which may
    lead them off, and four of them go on as well.

    Parameters
    ----------
    starts : sequence of Model
        Of one kind.
    points : (n, 3) float
        At unit RMS about the origin, as the models are.
    reach : float
        Of outliers, across the surface.
    """
    sample = points[:: max(1, len(points) // _N_SAMPLE)]
    coarse = [_coarse(start, sample, reach) for start in starts]
    coarse.sort(key=lambda descent: -descent.log_likelihood)
    begun = sorted(
        (_begun(model, points, reach) for model in near), key=lambda descent: -descent.log_likelihood
    )
    chosen = _distinct(coarse, sample)[:_N_BEST] + _distinct(begun, sample)[:_N_BEST]
    fine = [descend_to_rest(descent, points) for descent in _distinct(chosen, sample)]
    spent = sum(descent.evaluations for descent in coarse)
    fine.sort(key=lambda descent: -descent.log_likelihood)
    return [descent._replace(evaluations=descent.evaluations + spent) for descent in fine]


def _coarse(start: Model, sample: FloatArray, reach: float) -> Descent:
    """Where Cauchy's weights lead on a sample (n, 3)."""
    model, spent = start, 0
    for scale in _CAUCHY:
        model, n = descend(model, sample, cauchy(scale), least=_COARSE_STEP)
        spent += n
    distances = model.distance(sample)
    mixture = Mixture.of(distances, reach, _CAUCHY[-1], LEAST_SIGMA)
    return Descent(model, mixture, float(mixture.log_densities(distances).sum()), spent)


def _begun(start: Model, points: FloatArray, reach: float) -> Descent:
    """A start as it is, by all points (n, 3)."""
    distances = start.distance(points)
    mixture = Mixture.of(distances, reach, _CAUCHY[-1], LEAST_SIGMA)
    return Descent(start, mixture, float(mixture.log_densities(distances).sum()), 1)


def _distinct(pairs: Sequence[Descent], sample: FloatArray) -> list[Descent]:
    """Those that are not the same surface as one before."""
    kept: list[Descent] = []
    sizes: list[FloatArray] = []
    for descent in pairs:
        size = np.abs(descent.model.distance(sample))
        if all(np.abs(size - other).mean() > SAME_SURFACE for other in sizes):
            kept.append(descent)
            sizes.append(size)
    return kept


def descend_to_rest(descent: Descent, points: FloatArray, n_rounds: int = _N_ROUNDS) -> Descent:
    """Return where all points (n, 3) lead, weighed by how likely each is noise, until the scale stands."""
    model, mixture, spent = descent.model, descent.mixture, descent.evaluations
    for _ in range(n_rounds):
        before = mixture.sigma
        mixture = Mixture.of(model.distance(points), mixture.reach, before, LEAST_SIGMA)
        model, n = descend(model, points, mixture.weights, 4)
        spent += n
        if abs(mixture.sigma - before) < 1e-4 * before:
            break
    distances = model.distance(points)
    mixture = Mixture.of(distances, mixture.reach, mixture.sigma, LEAST_SIGMA)
    return Descent(model, mixture, float(mixture.log_densities(distances).sum()), spent)
