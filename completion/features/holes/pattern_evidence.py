# SPDX-License-Identifier: MIT
"""Evidence of a whole pattern by all its holes and the webs between them, and its most evident part."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from completion.features.holes import limits
from completion.features.holes.circles import HoleCandidates, rim_scores
from completion.features.holes.lattices import Looks, Proposal, log_chance, looks, matches
from completion.features.holes.patterns import CIRCLE, GRID, PARAMETERS, ROW, Pattern, centres_of
from completion.features.holes.plates import Openings, PlateSurvey
from scenes.checks import BoolArray, FloatArray, IntArray


def are_joined(pattern: Pattern, survey: PlateSurvey) -> bool:
    """Whether along one direction of a pattern nothing was measured between any two neighbours: slots."""
    for neighbours in _neighbours(pattern):
        counted, expected = _on_webs(pattern, neighbours, survey)
        telling = expected > limits.WEB_POINTS
        if telling.any() and (counted[telling] == 0).all():
            return True
    return False


def open_sides(rims: BoolArray) -> BoolArray:
    """Tell of which holes a whole side is open, by the sectors (n, k) in which they have a rim."""
    return _gaps(rims, limits.OPEN_SECTORS)


def are_notches(pattern: Pattern, rims: BoolArray, seen: BoolArray) -> bool:
    """Whether all holes that were `seen` (n,) are open on the same side, or all inwards, or all outwards.

    Lost patches open each hole elsewhere; notches, slots, and circles that lie in a larger one, alike.
    """
    if not seen.any():
        return False
    offset = pattern.centres - pattern.x[:2]
    outwards = np.arctan2(offset[:, 1], offset[:, 0])
    k = rims.shape[1]
    turned = np.stack(
        [np.roll(rim, -round(turn / (2 * np.pi) * k)) for rim, turn in zip(rims, outwards, strict=True)]
    )
    inward_too = [rims, turned] if pattern.shape[1] > 1 or pattern.kind == CIRCLE else [rims]
    common = np.stack([np.asarray(frame[seen]).any(axis=0) for frame in inward_too])
    return bool(_gaps(common, limits.OPEN_ALIKE).any())


def _gaps(rims: BoolArray, size: int) -> BoolArray:
    """Tell in which rows (n, k), each a ring, `size` sectors side by side have no rim."""
    twice = np.concatenate([rims, rims], axis=1)
    runs: BoolArray = np.stack(
        [~twice[:, first : first + size].any(axis=1) for first in range(rims.shape[1])]
    )
    return np.asarray(runs.any(axis=0))


def _neighbours(pattern: Pattern) -> list[IntArray]:
    """Pairs (m, 2) of neighbours along each direction."""
    numbers = np.arange(pattern.count).reshape(pattern.shape)
    if pattern.kind == CIRCLE:
        return [np.stack([numbers.ravel(), np.roll(numbers.ravel(), -1)], axis=1)]
    along = np.stack([numbers[:-1].ravel(), numbers[1:].ravel()], axis=1)
    across = np.stack([numbers[:, :-1].ravel(), numbers[:, 1:].ravel()], axis=1)
    return [pairs for pairs in (along, across) if len(pairs)]


def _on_webs(pattern: Pattern, pairs: IntArray, survey: PlateSurvey) -> tuple[IntArray, FloatArray]:
    """Points (m,) of the plate between two holes each, and how many there should be."""
    centres, radius = pattern.centres, pattern.radius
    first, two = centres[pairs[:, 0]], centres[pairs[:, 1]]
    step = two - first
    length = np.hypot(*step.T)
    owner, offset = survey.near((first + two) / 2, length / 2)
    along = step / length[:, None]
    u = np.einsum("ij,ij->i", offset, along[owner])
    v = offset[:, 1] * along[owner, 0] - offset[:, 0] * along[owner, 1]
    inside = np.abs(v) < limits.WEB_WIDTH * radius
    for sign in (-1, 1):
        inside &= np.hypot(u - sign * length[owner] / 2, v) > radius
    counted = np.bincount(owner[inside], minlength=len(pairs))
    # a rectangle less two segments of circles
    half = limits.WEB_WIDTH * radius
    caps = half * np.sqrt(radius**2 - half**2) + radius**2 * np.arcsin(half / radius)
    area = np.maximum(2 * half * length - 2 * caps, 0.0)
    return counted, survey.density_at((first + two) / 2) * area


_MARGIN = {ROW: 3, GRID: 1, CIRCLE: 0}  # places beyond what was proposed
_LOOKS = float(np.log(3.0))  # of a hole that was no candidate: places that it might have had
_FITTED_NATS = 3.0  # that a circle gains by its own centre and radius
_STEPS, _N_ROUNDS = (0.4, 0.2), 8  # spacings that a pattern's holes move at most, and how often


@dataclass(frozen=True, slots=True, eq=False)
class WeighedPattern:
    """A pattern and what says that it is there.

    Attributes
    ----------
    pattern : Pattern
        Of the plate's chart.
    places, chosen : (n,) int
        Its holes that are candidates, and their numbers.
    evidence : float
        Less the log of how many such patterns chance makes, with what its other holes add; nats.
    holes : (count,) float
        Log odds of each hole.
    rims : (count, 16) bool
        Sectors in which the plate begins at the rim.
    filled : (count,) bool
        Whether measured surface fills it.
    joined : bool
        Whether nothing of the plate is between neighbours.
    blocked : bool
        Whether beams came back from behind the plate, but none through a hole.
    """

    pattern: Pattern
    places: IntArray
    chosen: IntArray
    evidence: float
    holes: FloatArray
    rims: BoolArray
    filled: BoolArray
    joined: bool
    blocked: bool

    @property
    def seen(self) -> BoolArray:
        """Return which holes (count,) were seen."""
        return np.asarray((self.holes > limits.SEEN_NATS) & (self.rims.sum(axis=1) >= 3) & ~self.filled)


@dataclass(frozen=True, slots=True, eq=False)
class Ground:
    """What patterns of one plate are weighed on."""

    survey: PlateSurvey
    opened: Openings
    candidates: HoleCandidates
    area: float
    looks: dict[tuple[int, float], Looks] = field(default_factory=dict)  # by radius and softness

    def weigh(self, pattern: Pattern, proposal: Proposal | WeighedPattern, soft: float) -> WeighedPattern:
        """Weigh a pattern of which some holes are candidates, its places known to `soft` spacings.

        A candidate that is far from its place tells less than the place itself: the farthest ones are left
        out as long as that makes the whole more evident.
        """
        holes, rims, filled = self.holes(pattern, soft)
        places, chosen = proposal.places, proposal.chosen
        evidence = self._evidence(pattern, places, chosen, holes, soft)
        while len(places) > _least_seen(pattern):
            off = np.hypot(*(self.candidates.centres[chosen] - pattern.centres[places]).T)
            kept = (
                np.arange(len(places))
                != (off + np.abs(self.candidates.radii[chosen] - pattern.radius)).argmax()
            )
            less = self._evidence(pattern, places[kept], chosen[kept], holes, soft)
            if less <= evidence:
                break
            places, chosen, evidence = places[kept], chosen[kept], less
        return WeighedPattern(
            pattern=pattern,
            places=places,
            chosen=chosen,
            evidence=evidence,
            holes=holes,
            rims=rims,
            filled=filled,
            joined=are_joined(pattern, self.survey),
            blocked=self.opened.none_passed(pattern.centres, pattern.radius),
        )

    def _evidence(
        self, pattern: Pattern, places: IntArray, chosen: IntArray, holes: FloatArray, soft: float
    ) -> float:
        """Against chance, with what holes (count,) that are no candidates add.

        A circle is the most evident one near it: three parameters gain a nat each, since a rim's edge is no
        regular parameter. So a candidate counts as no more than its hole at the pattern's place, and three.
        """
        candidates = self.candidates
        alone = np.minimum(candidates.evidence[chosen], holes[places] + _FITTED_NATS)
        chance = log_chance(
            pattern, places, chosen, candidates, area=self.area, spacing=self.survey.spacing, evidence=alone
        )
        other = np.ones(pattern.count, dtype=np.bool_)
        other[places] = False
        more = self._rarities(holes[other], pattern, soft).sum()
        return float(more - chance + np.clip(alone, -limits.MOST_HOLE_NATS, 0.0).sum())

    def _rarities(self, holes: FloatArray, pattern: Pattern, soft: float) -> FloatArray:
        """What holes (n,) that were no candidates add: by how rare they are on this plate, once seen."""
        against = np.clip(holes, -limits.MOST_HOLE_NATS, 0.0)
        if not (holes > limits.SEEN_NATS).any():
            return against
        rare = self._thrown(pattern.radius, soft).rarity(holes) - _LOOKS
        return np.where(holes > limits.SEEN_NATS, np.maximum(rare, 0.0), against)

    def _thrown(self, radius: float, soft: float) -> Looks:
        """How much places of this plate look like holes of about a radius, known to `soft` spacings."""
        spacing = self.survey.spacing
        size = round(float(np.log(radius / spacing)) / limits.RADIUS_STEP)
        if (size, soft) not in self.looks:
            as_large = spacing * float(np.exp(size * limits.RADIUS_STEP))
            width = max(soft * spacing, self.survey.plate.noise)
            self.looks[size, soft] = looks(as_large, width, self.survey, self.opened)
        return self.looks[size, soft]

    def worth(self, pattern: Pattern, soft: float) -> FloatArray:
        """What each hole (count,) of a pattern is worth to it, nats: less than nothing where nobody saw one.

        Of the places of this plate at which a hole might be, one in twenty looks as much like one as what
        ends a pattern, at most: arcs of lost patches continue no row.
        """
        holes = np.clip(self.holes(pattern, soft)[0], -limits.MOST_HOLE_NATS, limits.MOST_HOLE_NATS)
        seen = holes > limits.SEEN_NATS
        if seen.any():
            thrown = self._thrown(pattern.radius, soft)
            rare = thrown.rarity_where_lost(holes[seen], pattern.centres, pattern.radius)
            holes[seen] = np.minimum(holes[seen], rare - limits.SURE_NATS)
        return np.asarray(holes + limits.UNSEEN_NATS)

    def holes(self, pattern: Pattern, soft: float) -> tuple[FloatArray, BoolArray, BoolArray]:
        """Log odds, sectors with a rim, and whether filled, of each hole (count,) of a pattern."""
        survey, centres = self.survey, pattern.centres
        radii = np.full(pattern.count, pattern.radius)
        width = max(soft * survey.spacing, survey.plate.noise)
        # points on the rim itself are outside: of exact ones there are many
        inner = np.maximum(radii - width, 0.5 * radii)
        scores = rim_scores(survey, centres, inner, np.full(pattern.count, width))
        more = self.opened.evidence(centres, radii, survey.spacing)
        return scores.evidence + more, scores.seen, scores.filled > limits.SURE_NATS


def best_window(
    proposal: Proposal | WeighedPattern, ground: Ground, given: Mapping[str, float]
) -> WeighedPattern | None:
    """Weigh the part of a proposal's lattice whose holes' evidence sums to most.

    An exact search of all windows with at least three holes along (two by two in grids), or with the counts
    that are given. None where fewer candidates are left than a pattern needs.
    """
    pattern, margin = proposal.pattern, _MARGIN[proposal.pattern.kind]
    if pattern.kind == CIRCLE:
        return ground.weigh(pattern, proposal, limits.SOFT_WINDOW)
    n_along, n_across = pattern.shape
    asked = (given.get("count"), given.get("count_2") if pattern.kind == GRID else 1)
    margins = [max(margin, int(n or 0) - size) for n, size in zip(asked, pattern.shape, strict=True)]
    margins = [margins[0], margins[1] if pattern.kind == GRID else 0]
    low = (-margins[0], -margins[1])
    wide = pattern.resize(low, (n_along + 2 * margins[0], n_across + 2 * margins[1]))
    value = ground.worth(wide, limits.SOFT_WINDOW)
    window = _best_window(value.reshape(wide.shape), pattern.kind, asked)
    if window is None:
        return None
    i, j, shape = window
    kept = _part(proposal, (i + low[0], j + low[1]), shape)
    return None if kept is None else ground.weigh(kept.pattern, kept, limits.SOFT_WINDOW)


def _part(whole: Proposal | WeighedPattern, low: tuple[int, int], shape: tuple[int, int]) -> Proposal | None:
    """The part of a row or grid from the hole `low` on; None where too few candidates are left."""
    at = np.stack(np.divmod(whole.places, whole.pattern.shape[1])) - np.array(low)[:, None]
    inside = ((at >= 0) & (at < np.array(shape)[:, None])).all(axis=0)
    kept = whole.pattern.resize(low, shape)
    if inside.sum() < _least_seen(kept):
        return None
    return Proposal(kept, at[0, inside] * shape[1] + at[1, inside], whole.chosen[inside], 0.0)


def cut_ends(weighed: WeighedPattern, ground: Ground, given: Mapping[str, float]) -> WeighedPattern:
    """Weigh the part of a row or grid between the first and the last holes that were seen."""
    pattern = weighed.pattern
    holes, rims, filled = ground.holes(pattern, limits.SOFT_REFINED)
    seen = replace(weighed, holes=holes, rims=rims, filled=filled).seen
    if pattern.kind == CIRCLE or "count" in given or "count_2" in given or not seen.any():
        return weighed
    at = np.nonzero(seen.reshape(pattern.shape))
    low, shape = (int(at[0].min()), int(at[1].min())), (int(np.ptp(at[0])) + 1, int(np.ptp(at[1])) + 1)
    least = (3, 1) if pattern.kind == ROW else (2, 2)
    if shape == pattern.shape or shape[0] < least[0] or shape[1] < least[1]:
        return weighed
    kept = _part(weighed, low, shape)
    return weighed if kept is None else ground.weigh(kept.pattern, kept, limits.SOFT_REFINED)


def climb_pattern(begun: WeighedPattern, ground: Ground, given: Mapping[str, float]) -> WeighedPattern:
    """Move a pattern to where its holes are most evident together, and weigh it with the candidates there.

    Steps of each parameter and the radius, by which no hole moves more than some share of the spacing.
    """
    pattern, spacing = begun.pattern, ground.survey.spacing
    free = [k for k, name in enumerate((*PARAMETERS[pattern.kind], "radius")) if name not in given]
    x = np.array([*pattern.x, pattern.radius])
    farthest = np.append(np.linalg.norm(pattern.slopes, axis=1).max(axis=0), 1.0)
    for step in _STEPS:
        moves = np.concatenate([np.diag(sign * step * spacing / farthest)[free] for sign in (1, -1)])
        now = -np.inf
        for _ in range(_N_ROUNDS):
            tried = np.vstack([x, x + moves])
            values = _together(pattern, tried, ground, step)
            if values[1:].max() <= max(now, values[0]) + 1e-9:
                break
            x, now = tried[1 + values[1:].argmax()], float(values[1:].max())
    moved = replace(pattern, x=x[:-1], radius=float(x[-1]))
    places, chosen = matches(moved, ground.candidates, spacing)
    if len(places) < _least_seen(pattern):
        return begun
    again = best_window(Proposal(moved, places, chosen, 0.0), ground, given)
    return begun if again is None or again.evidence < begun.evidence else again


def _together(pattern: Pattern, tried: FloatArray, ground: Ground, step: float) -> FloatArray:
    """Evidence (w,) of all holes together of patterns with parameters and radii (w, p + 1)."""
    centres, n = centres_of(pattern, tried[:, :-1]), pattern.count
    radii = np.repeat(np.maximum(tried[:, -1], 1e-9), n)
    soft = np.full(len(radii), max(step * ground.survey.spacing, ground.survey.plate.noise))
    scores = rim_scores(ground.survey, centres.reshape(-1, 2), radii, soft).evidence
    return np.asarray(np.clip(scores, -2 * limits.MOST_HOLE_NATS, None).reshape(-1, n).sum(axis=1))


def _best_window(
    value: FloatArray, kind: str, asked: tuple[float | None, float | None]
) -> tuple[int, int, tuple[int, int]] | None:
    """First place and shape of the window of values (k, l) with the greatest sum."""
    summed = np.pad(value.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))
    least = (3, 1) if kind == ROW else (2, 2)
    best, most = None, -np.inf
    sizes = [[int(n)] if n is not None else range(m, size + 1)
             for n, m, size in zip(asked, least, value.shape, strict=True)]  # fmt: skip
    for a in sizes[0]:
        for b in sizes[1]:
            if a > value.shape[0] or b > value.shape[1]:
                continue
            total = summed[a:, b:] - summed[:-a, b:] - summed[a:, :-b] + summed[:-a, :-b]
            if total.max() > most:
                most = float(total.max())
                i, j = np.unravel_index(int(total.argmax()), total.shape)
                best = (int(i), int(j), (a, b))
    return best


def _least_seen(pattern: Pattern) -> int:
    """How many candidates a pattern needs: as many as tell its parameters."""
    return 3 if pattern.kind == GRID else 2
