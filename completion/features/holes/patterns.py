# SPDX-License-Identifier: MIT
"""Patterns: the holes of a row, a grid or a bolt circle by few parameters, and their joint refinement."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtr

from completion.features.holes import limits
from completion.features.holes.circles import N_SECTORS, rim_scores
from completion.features.holes.plates import HolePlate, Openings, PlateSurvey
from completion.fitting.limits import TUKEY
from completion.fitting.robust import scale_within, tukey_weights
from scenes.checks import BoolArray, FloatArray, IntArray

ROW, GRID, CIRCLE = "hole-row", "hole-grid", "bolt-circle"
KINDS = (ROW, GRID, CIRCLE)
LEAST_SEEN = {ROW: 3, GRID: 4, CIRCLE: 3}  # holes of a pattern that must be seen
PARAMETERS = {
    ROW: ("u", "v", "angle", "pitch"),
    GRID: ("u", "v", "angle", "pitch", "pitch_2"),
    CIRCLE: ("u", "v", "angle", "circle_radius"),
}
SYMMETRIES = {ROW: 2, GRID: 4, CIRCLE: 2}  # times the count of a circle, which begins anywhere


@dataclass(frozen=True, slots=True, eq=False)
class Pattern:
    """Equal holes at regular places of a chart.

    Attributes
    ----------
    kind : str
        "hole-row", "hole-grid" or "bolt-circle".
    shape : (int, int)
        Holes along and across; across is 1 but for grids.
    x : (p,) float
        Its middle (two numbers), the angle of its direction or first hole, its pitches or circle's radius.
    radius : float
        Of each hole.
    """

    kind: str
    shape: tuple[int, int]
    x: FloatArray
    radius: float

    @property
    def count(self) -> int:
        """Return how many holes it has."""
        return self.shape[0] * self.shape[1]

    @property
    def steps(self) -> FloatArray:
        """Return pitches (count, 2) from the middle, along and across; angles from the first on a circle."""
        i, j = np.divmod(np.arange(self.count), self.shape[1])
        if self.kind == CIRCLE:
            return np.column_stack([2 * np.pi * i / self.count, np.zeros(self.count)])
        return np.column_stack([i - (self.shape[0] - 1) / 2, j - (self.shape[1] - 1) / 2])

    @property
    def centres(self) -> FloatArray:
        """Return the centres (count, 2)."""
        return self._place_holes()[0]

    @property
    def slopes(self) -> FloatArray:
        """Return the derivatives (count, 2, p) of the centres."""
        return self._place_holes()[1]

    def _place_holes(self) -> tuple[FloatArray, FloatArray]:
        middle, angle, steps = self.x[:2], self.x[2], self.steps
        slopes = np.zeros((self.count, 2, len(self.x)))
        slopes[:, 0, 0] = slopes[:, 1, 1] = 1.0
        if self.kind == CIRCLE:
            turn = angle + steps[:, 0]
            out = np.column_stack([np.cos(turn), np.sin(turn)])
            slopes[:, :, 2] = self.x[3] * np.column_stack([-out[:, 1], out[:, 0]])
            slopes[:, :, 3] = out
            return middle + self.x[3] * out, slopes
        along = np.array([np.cos(angle), np.sin(angle)])
        across = np.array([-along[1], along[0]])
        offset = steps[:, :1] * self.x[3] * along
        slopes[:, :, 2] = steps[:, :1] * self.x[3] * across
        slopes[:, :, 3] = steps[:, :1] * along
        if self.kind == GRID:
            offset = offset + steps[:, 1:] * self.x[4] * across
            slopes[:, :, 2] -= steps[:, 1:] * self.x[4] * along
            slopes[:, :, 4] = steps[:, 1:] * across
        return middle + offset, slopes

    def resize(self, low: tuple[int, int], shape: tuple[int, int]) -> Pattern:
        """Return the same lattice with another part of it: from the hole `low`, which may be negative, on."""
        if self.kind == CIRCLE:
            return self
        begin = np.array(low) + (np.array(shape) - 1) / 2 - (np.array(self.shape) - 1) / 2
        along = np.array([np.cos(self.x[2]), np.sin(self.x[2])])
        x = self.x.copy()
        x[:2] += begin[0] * self.x[3] * along
        if self.kind == GRID:
            x[:2] += begin[1] * self.x[4] * np.array([-along[1], along[0]])
        return replace(self, shape=shape, x=x)


def fit_pattern(
    begun: Pattern, places: IntArray, centres: FloatArray, held: BoolArray, n_rounds: int = 4
) -> Pattern:
    """Fit a pattern to centres (m, 2) of some of its holes by Gauss-Newton; `held` (p,) stay as they are."""
    x, free = begun.x.copy(), ~held
    for _ in range(n_rounds):
        now = replace(begun, x=x)
        error = (centres - now.centres[places]).ravel()
        slopes = now.slopes[places][:, :, free].reshape(len(error), -1)
        x[free] += np.linalg.lstsq(slopes, error, rcond=None)[0]
    return replace(begun, x=x)


_PER_PARAMETER = 8  # walkers
_BURNT, _KEPT = 80, 160  # rounds
_STRETCH = 2.0  # of Goodman & Weare


@dataclass(frozen=True, slots=True, eq=False)
class PatternRefinement:
    """A pattern, the covariance (p + 1, p + 1) of its parameters and radius, and evaluations spent."""

    pattern: Pattern
    covariance: FloatArray
    evaluations: int


@dataclass(frozen=True, slots=True, eq=False)
class _Rims:
    """Points about rims, and where surface begins at them."""

    owner: IntArray  # (m,) hole of a point
    offset: FloatArray  # (m, 2) from its hole's first centre
    seen: BoolArray  # (n, k) sectors
    centres: FloatArray  # (n, 2) first ones
    rate: FloatArray  # (n,) points an area
    radius: float  # first one
    stray: float
    noise: float
    spacing: float

    def log_likelihood(self, centres: FloatArray, radii: FloatArray) -> FloatArray:
        """Of w patterns with centres (w, n, 2) and radii (w,)."""
        moved = centres - self.centres
        far = np.linalg.norm(self.offset - moved[:, self.owner], axis=2)
        points = np.log(self.stray + (1 - self.stray) * ndtr((far - radii[:, None]) / self.noise)).sum(axis=1)
        turns = 2 * np.pi * (np.arange(N_SECTORS) + 0.5) / N_SECTORS
        out = np.stack([np.cos(turns), np.sin(turns)])
        reach = radii[:, None, None] + moved @ out
        area = np.einsum("wnk,nk,n->w", reach**2, self.seen, self.rate * np.pi / N_SECTORS)
        gone = np.abs(radii - self.radius) > limits.MOST_MOVE * self.spacing
        gone |= radii < 0.8 * limits.LEAST_RADIUS * self.spacing
        gone |= np.linalg.norm(moved, axis=2).max(axis=1) > limits.MOST_MOVE * self.spacing
        return np.where(gone, -np.inf, points + (1 - self.stray) * area)


def refine(
    begun: Pattern, survey: PlateSurvey, held: BoolArray, used: BoolArray, *, rng: np.random.Generator
) -> PatternRefinement:
    """Refine a pattern: mean and covariance of its posterior by an affine-invariant ensemble.

    The edge of a Poisson process is no regular parameter: its likelihood jumps, and errors shrink with the
    number of points rather than with its root. The posterior's mean is efficient there, and its spread is an
    honest error, where least squares are neither (Ibragimov & Has'minskii 1981). Sampled by stretch moves
    (Goodman & Weare 2010). `held` (p + 1,) stay as they are, the radius last; holes
    that are not `used` (count,) say nothing.
    """
    pattern, spent = begun, 0
    covariance = np.zeros((len(begun.x) + 1,) * 2)
    for last in (False, True):
        rims = _rims(
            pattern, survey, used, limits.SOFT_RIM * survey.spacing if not last else 0.05 * survey.spacing
        )
        spread = _first_spread(pattern, survey, held) if not last else _root(covariance)
        n = (_BURNT, _KEPT if last else _BURNT)
        drawn = _sample_posterior(pattern, rims, spread, held, rounds=n, rng=rng)
        spent += drawn.shape[0]
        mean, covariance = drawn.mean(axis=0), np.cov(drawn.T)
        mean[held] = np.array([*pattern.x, pattern.radius])[held]
        covariance[held], covariance[:, held] = 0.0, 0.0
        pattern = replace(pattern, x=mean[:-1], radius=float(mean[-1]))
    return PatternRefinement(pattern, covariance, spent)


def _rims(pattern: Pattern, survey: PlateSurvey, used: BoolArray, soft: float) -> _Rims:
    centres, radii = pattern.centres, np.full(pattern.count, pattern.radius)
    soft = max(soft, survey.plate.noise)
    seen = rim_scores(survey, centres, radii, np.full(len(radii), soft)).seen
    owner, offset = survey.near(centres, np.where(used, radii + limits.RIM_BAND * survey.spacing, 0.0))
    near = np.hypot(*offset.T) > pattern.radius - limits.RIM_BAND * survey.spacing
    owner, offset, seen = owner[near], offset[near], seen & used[:, None]
    noise = max(survey.plate.noise, 1e-3 * survey.spacing)
    rate = survey.density_at(centres)
    return _Rims(
        owner=owner, offset=offset, seen=seen, centres=centres, rate=rate, radius=pattern.radius,
        stray=survey.stray, noise=noise, spacing=survey.spacing,
    )  # fmt: skip


def _first_spread(pattern: Pattern, survey: PlateSurvey, held: BoolArray) -> FloatArray:
    """Root (p + 1, p + 1) of the covariance if each centre were known to a share of the spacing."""
    slopes = pattern.slopes.reshape(-1, len(pattern.x))
    root = np.zeros((len(held),) * 2)
    root[:-1, :-1] = _root(np.asarray(np.linalg.pinv(slopes.T @ slopes)))
    root[-1, -1] = 1.0
    return limits.SOFT_RIM * survey.spacing * root


def _root(covariance: FloatArray) -> FloatArray:
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def _sample_posterior(
    pattern: Pattern, rims: _Rims, spread: FloatArray, held: BoolArray,
    *, rounds: tuple[int, int], rng: np.random.Generator,
) -> FloatArray:  # fmt: skip
    """Draws (m, p + 1) of the posterior."""
    middle = np.array([*pattern.x, pattern.radius])
    free = np.flatnonzero(~held)
    half = _PER_PARAMETER * len(middle) // 2
    walkers = np.tile(middle, (2 * half, 1))
    walkers[:, free] += (rng.normal(size=(2 * half, len(middle))) @ spread.T)[:, free]

    def log_likelihood(places: FloatArray) -> FloatArray:
        centres = centres_of(pattern, places[:, :-1])
        return rims.log_likelihood(centres, places[:, -1])

    values, kept = log_likelihood(walkers), list[FloatArray]()
    outside = ~np.isfinite(values)
    walkers[outside], values[outside] = middle, log_likelihood(middle[None])[0]
    for number in range(sum(rounds)):
        for side in (slice(0, half), slice(half, None)):
            others = walkers[half:] if side.start == 0 else walkers[:half]
            z = ((_STRETCH - 1) * rng.random(half) + 1) ** 2 / _STRETCH
            partner = others[rng.integers(half, size=half)]
            tried = partner + z[:, None] * (walkers[side] - partner)
            tried[:, held] = middle[held]
            new = log_likelihood(tried)
            level = np.log(rng.random(half)) - (len(free) - 1) * np.log(z)
            accepted = new > values[side] + level
            walkers[side] = np.where(accepted[:, None], tried, walkers[side])
            values[side] = np.where(accepted, new, values[side])
        if number >= rounds[0]:
            kept.append(walkers.copy())
    return np.asarray(np.concatenate(kept))


def centres_of(pattern: Pattern, x: FloatArray) -> FloatArray:
    """Centres (w, n, 2) of patterns of one shape with parameters (w, p)."""
    steps, angle = pattern.steps, x[:, 2:3]
    if PARAMETERS[pattern.kind][3] == "circle_radius":
        turn = angle + steps[:, 0]
        ring = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
        return np.asarray(x[:, None, :2] + x[:, 3, None, None] * ring)
    along = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    places = x[:, None, :2] + (x[:, 3:4] * steps[:, 0])[:, :, None] * along
    if x.shape[1] > 4:
        across = np.stack([-np.sin(angle), np.cos(angle)], axis=-1)
        places = places + (x[:, 4:5] * steps[:, 1])[:, :, None] * across
    return np.asarray(places)


_N_ROUNDS = 12
_EXACT = 1e-9  # of the radius: residuals of points without noise


@dataclass(frozen=True, slots=True, eq=False)
class Walls:
    """Points (m, 2) of the chart that should lie on rims, and the holes whose they are (m,)."""

    places: FloatArray
    owner: IntArray


def assign_faces(pattern: Pattern, plate: HolePlate, opened: Openings, points: FloatArray) -> IntArray:
    """Number the faces that points (n, 3) are on: 1 the plate, from 2 the walls of its holes, 0 none."""
    faces = _owners(pattern, plate, opened, points) + 2
    faces[faces == 1] = 0
    faces[np.abs(plate.chart(points)[1]) < plate.slab] = 1
    return faces


def _owners(pattern: Pattern, plate: HolePlate, opened: Openings, points: FloatArray) -> IntArray:
    """The hole (n,) on whose wall each of points (n, 3) is, -1 for none."""
    places, height = plate.chart(points)
    deep = (np.abs(height) > 1.5 * plate.slab) & (np.abs(height) < limits.WALL_DEPTH * pattern.radius)
    if opened.outward:
        deep &= height * opened.outward < 0
    return _nearest_rim(pattern, places, deep, opened.reach)


def walls(pattern: Pattern, plate: HolePlate, opened: Openings, points: FloatArray) -> Walls:
    """Gather those of points (n, 3) that are on walls; or places (n, 2) near rims: a mesh's corners."""
    if points.shape[1] == 2:
        places, owner = points, _nearest_rim(pattern, points, np.ones(len(points), np.bool_), opened.reach)
    else:
        places, owner = plate.chart(points)[0], _owners(pattern, plate, opened, points)
    return Walls(places[owner >= 0], owner[owner >= 0])


def _nearest_rim(pattern: Pattern, places: FloatArray, chosen: BoolArray, reach: float) -> IntArray:
    """The hole (n,) on whose rim places (n, 2) are, of those that are chosen (n,); else -1."""
    owner = np.full(len(places), -1)
    for k, centre in enumerate(pattern.centres):
        gap = np.abs(np.hypot(*(places - centre).T) - pattern.radius)
        owner[chosen & (gap < reach)] = k
    return owner


def sharpen_pattern(
    coarse: PatternRefinement, bore_walls: Walls, seen: BoolArray, survey: PlateSurvey, held: BoolArray
) -> PatternRefinement | None:
    """Fit a pattern to points on its holes' walls by robust Gauss-Newton.

    Residuals are distances from the circles, weighed by Tukey's function; `held` (p + 1,) stay as they are.
    None where less than six tenths of the holes that were `seen` (count,) have a wall, or what is
    near the rims is no straight wall: a countersink.
    """
    pattern, spacing = coarse.pattern, survey.spacing
    per_hole = np.bincount(bore_walls.owner, minlength=pattern.count)
    if (per_hole[seen] >= limits.WALL_POINTS).mean() < limits.WALLED_SHARE if seen.any() else True:
        return None
    free, x = ~held, np.array([*pattern.x, pattern.radius])
    sigma, radii = 0.5 * spacing, pattern.radius
    for _ in range(_N_ROUNDS):
        residual, slopes = _residual(replace(pattern, x=x[:-1], radius=float(x[-1])), bore_walls)
        sigma = max(scale_within(np.abs(residual[np.abs(residual) < TUKEY * sigma]), sigma), _EXACT * radii)
        weights = tukey_weights(residual, TUKEY * sigma)
        root = np.sqrt(weights)
        step = np.linalg.lstsq(root[:, None] * slopes[:, free], -root * residual, rcond=None)[0]
        x[free] += np.clip(step, -spacing, spacing)
    if sigma > max(limits.NO_WALL * spacing, 2 * survey.plate.noise):
        return None
    normal = slopes[:, free].T @ (weights[:, None] * slopes[:, free])
    covariance = np.zeros((len(x),) * 2)
    covariance[np.ix_(free, free)] = sigma**2 * np.linalg.pinv(normal)
    moved = replace(pattern, x=x[:-1], radius=float(x[-1]))
    if np.hypot(*(moved.centres - pattern.centres).T).max() > spacing:
        return None
    return PatternRefinement(moved, covariance, coarse.evaluations + _N_ROUNDS)


def _residual(pattern: Pattern, bore_walls: Walls) -> tuple[FloatArray, FloatArray]:
    """Distances (m,) of the points outside their circles, and their derivatives (m, p + 1)."""
    offset = bore_walls.places - pattern.centres[bore_walls.owner]
    far = np.maximum(np.hypot(*offset.T), 1e-300)
    out = offset / far[:, None]
    slopes = -np.einsum("mi,mip->mp", out, pattern.slopes[bore_walls.owner])
    return far - pattern.radius, np.column_stack([slopes, -np.ones(len(far))])
