# SPDX-License-Identifier: MIT
"""Lattices: patterns and lattices through several candidates, and how many as regular arise by chance.

A hole of which a third is seen is no circle by itself: its centre and radius are too uncertain to be met by
a lattice through others. Two well-seen holes determine its place. Of the lattices through all pairs of like
candidates, few have no plate where a hole should be; these are weighed as wholes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import gammaln

from completion.features.holes import limits
from completion.features.holes.circles import HoleCandidates, rim_scores
from completion.features.holes.patterns import CIRCLE, GRID, PARAMETERS, ROW, SYMMETRIES, Pattern, fit_pattern
from completion.features.holes.plates import Openings, PlateSurvey
from scenes.checks import BoolArray, FloatArray, IntArray

_N_THROWN = 8_000  # places that tell how rare a hole's looks are


def log_chance(
    pattern: Pattern,
    places: IntArray,
    chosen: IntArray,
    candidates: HoleCandidates,
    *,
    area: float,
    spacing: float,
    evidence: FloatArray | None = None,
) -> float:
    """Log of the expected number of patterns as regular, among candidates thrown on the plate at random.

    A-contrario detection (Desolneux, Moisan, Morel 2000). n circles can be chosen in N^n ways; the patterns
    of p parameters are a surface of that dimension in the 2 n coordinates of their centres, of measure
    integral sqrt(det J'J); what lies within the residual's length of it is a tube, whose share of all
    configurations, area^n, is the probability. Radii count likewise. N is, for each, the number of
    candidates at least as evident.

    Parameters
    ----------
    pattern : Pattern
        As fitted.
    places, chosen : (n,) int
        Numbers of holes of the pattern, and of the candidates that are there.
    candidates : HoleCandidates
        All.
    area, spacing : float
        Of the plate, and of its points.
    evidence : (n,) float, optional
        Of the circles where the pattern has them; without it, of the candidates where they are.
    """
    n, p = len(chosen), len(pattern.x)
    own = candidates.evidence[chosen] if evidence is None else evidence
    more = len(candidates) - np.searchsorted(np.sort(candidates.evidence), own, side="left")
    ways = float(np.log(np.maximum(more, np.arange(1, n + 1))).sum())
    symmetry = SYMMETRIES[pattern.kind] * (pattern.count if pattern.kind == CIRCLE else 1)
    slopes = pattern.slopes[places].reshape(2 * n, p)
    sign, determinant = np.linalg.slogdet(slopes.T @ slopes)
    alone = np.einsum("ij,ij->j", slopes, slopes)
    if sign <= 0 or determinant < limits.SINGULAR + np.log(np.maximum(alone, 1e-300)).sum():
        return np.inf  # these holes do not tell where the others are
    measure = 0.5 * determinant + _log_room(pattern, area)
    off = candidates.centres[chosen] - pattern.centres[places]
    freedom = 2 * n - p
    square = float(np.einsum("ij,ij->", off, off)) + freedom * (limits.EXACT_CANDIDATE * spacing) ** 2
    tube = freedom / 2 * np.log(np.pi * square) - gammaln(freedom / 2 + 1) if freedom else 0.0
    at_places = ways - np.log(symmetry) + measure + tube - n * np.log(area)
    skipped = gammaln(pattern.count + 1) - gammaln(n + 1) - gammaln(pattern.count - n + 1)
    return float(at_places + _log_alike(candidates, chosen, spacing) + skipped + np.log(limits.N_COUNTS))


def _log_room(pattern: Pattern, area: float) -> float:
    """Log of the measure of all parameters that patterns of this shape may have on a plate."""
    longest = np.sqrt(area)
    if pattern.kind == CIRCLE:
        return float(np.log(area * 2 * np.pi / pattern.count * longest / 2))
    room = np.log(area * 2 * np.pi * longest / max(pattern.shape[0] - 1, 1))
    return float(room + (np.log(longest / max(pattern.shape[1] - 1, 1)) if pattern.kind == GRID else 0.0))


def _log_alike(candidates: HoleCandidates, chosen: IntArray, spacing: float) -> float:
    """Log of the probability that radii are as equal as those chosen (n,), of candidates as they are."""
    radii: FloatArray = candidates.radii[chosen]
    freedom = len(radii) - 1
    wide = 2 * np.sqrt(np.pi) * max(float(candidates.radii.std()), limits.EXACT_CANDIDATE * spacing)
    square = float(((radii - radii.mean()) ** 2).sum()) + freedom * (limits.EXACT_CANDIDATE * spacing) ** 2
    tube = freedom / 2 * np.log(np.pi * square) - gammaln(freedom / 2 + 1) + 0.5 * np.log(freedom + 1)
    return float(min(tube - freedom * np.log(wide), 0.0))


@dataclass(frozen=True, slots=True, eq=False)
class Looks:
    """Places (m, 2) thrown on a plate, and how much each looks like a hole of one radius: nats, rising."""

    places: FloatArray
    evidence: FloatArray

    def rarity(self, evidence: FloatArray) -> FloatArray:
        """Return less the log of the share of places of the plate that look (n,) as much like a hole."""
        return _log_rarity(evidence, self.evidence, _N_THROWN)

    def rarity_where_lost(self, evidence: FloatArray, own: FloatArray, radius: float) -> FloatArray:
        """Return the same of places at which a hole might be, but for the holes `own` (k, 2) of a pattern.

        These places are no fewer than are lost before anything is measured.
        """
        beside = self.evidence[cKDTree(own).query(self.places)[0] > radius]
        return _log_rarity(evidence, beside, max(len(beside), limits.LOST_SHARE * _N_THROWN))


def _log_rarity(evidence: FloatArray, thrown: FloatArray, n_places: float) -> FloatArray:
    as_many = len(thrown) - np.searchsorted(thrown, evidence, side="left")
    return np.asarray(np.log(n_places + 1) - np.log(as_many + 1))


def looks(radius: float, soft: float, survey: PlateSurvey, opened: Openings) -> Looks:
    """Measure how much places thrown on a plate look like holes of a radius that is known to `soft`.

    Measured on the plate itself, losses and all: a model's log odds say less than how often they occur.
    Places that are plainly none are left out.
    """
    rng = np.random.default_rng(0)
    corner, extent = survey.corner, np.array(survey.counts.shape) * survey.cell
    places = corner + extent * rng.uniform(size=(_N_THROWN, 2))
    places = places[~survey.is_no_hole(places, np.full(_N_THROWN, radius))]
    radii = np.full(len(places), radius)
    thrown = rim_scores(survey, places, radii, np.full(len(places), soft)).evidence
    thrown += opened.evidence(places, radii, survey.spacing)
    order = np.argsort(thrown, kind="stable")
    return Looks(places[order], thrown[order])


_MULTIPLES = (1, 2, 3)  # pitches between two candidates
_MOST_TRIED, _MOST = 100, 6


@dataclass(frozen=True, slots=True, eq=False)
class Proposal:
    """A pattern, the candidates at its places, and the log of how many such chance makes."""

    pattern: Pattern
    places: IntArray
    chosen: IntArray
    log_chance: float


@dataclass(frozen=True, slots=True, eq=False)
class Search:
    """What is searched for patterns: candidates, their tree, the plate, and what is given."""

    candidates: HoleCandidates
    area: float
    spacing: float
    given: Mapping[str, float]
    tree: cKDTree

    @classmethod
    def of(
        cls, candidates: HoleCandidates, area: float, spacing: float, given: Mapping[str, float]
    ) -> Search:
        """Return the search of some candidates."""
        return cls(candidates, area, spacing, given, cKDTree(candidates.centres))

    def alike(self, first: IntArray | int, two: IntArray) -> BoolArray:
        """Whether radii of candidates (n,), or of one, and of others (n,) are alike."""
        radii = self.candidates.radii
        least = limits.ALIKE[0] * self.spacing + limits.ALIKE[1] * np.minimum(radii[first], radii[two])
        return np.asarray(np.abs(radii[first] - radii[two]) < least)


def proposals(
    kind: str, candidates: HoleCandidates, area: float, spacing: float, given: Mapping[str, float]
) -> list[Proposal]:
    """Return the patterns of a kind that chance explains worst, of which at least three holes are candidates.

    Pairs of like candidates are one, two or three pitches apart (along a row and a grid), or some share of
    a turn (triples, on a circle); all candidates near the other places of the lattice are matched, and the
    pattern is fitted to them.
    """
    if len(candidates) < limits.LEAST_HOLES:
        return []
    search = Search.of(candidates, area, spacing, given)
    begun = {ROW: _rows, GRID: _grids, CIRCLE: _circles}[kind](search)
    seen, tried = set[tuple[int, ...]](), list[Proposal]()
    ordered = sorted(begun, key=lambda triple: -_promise(search, triple[0], triple[1]))
    for pattern, places, chosen in ordered:
        key = (*sorted(chosen.tolist()), pattern.count)
        if key in seen or len(tried) >= _MOST_TRIED:
            continue
        seen.add(key)
        proposal = _fit_proposal(search, pattern, places, chosen)
        if proposal is not None:
            tried.append(proposal)
    best, taken = list[Proposal](), list[set[int]]()
    for proposal in sorted(tried, key=lambda proposal: proposal.log_chance):
        if all(len(set(proposal.chosen.tolist()) & other) < 2 for other in taken) or len(best) < 2:
            best.append(proposal)
            taken.append(set(proposal.chosen.tolist()))
    return best[:_MOST]


def _promise(search: Search, pattern: Pattern, places: IntArray) -> float:
    """Log odds, roughly, of so many matches in the window of a lattice that they span against chance."""
    i, j = np.divmod(places, pattern.shape[1])
    n = len(places)
    window = pattern.count if pattern.kind == CIRCLE else (np.ptp(i) + 1) * (np.ptp(j) + 1)
    ways = gammaln(window + 1) - gammaln(n + 1) - gammaln(window - n + 1)
    by_chance = len(search.candidates) * np.pi * (limits.NEARBY * search.spacing) ** 2 / search.area
    return float(-n * np.log(by_chance) - ways)


def _fit_proposal(search: Search, begun: Pattern, places: IntArray, chosen: IntArray) -> Proposal | None:
    """The pattern fitted; candidates that make it more probable by chance are left out, the worst first."""
    held = np.array([name in search.given for name in PARAMETERS[begun.kind]])
    candidates, best = search.candidates, None
    for _ in range(3):
        pattern = fit_pattern(begun, places, candidates.centres[chosen], held)
        if pattern.kind != CIRCLE:
            pattern, places = _trim_pattern(pattern, places)
        pattern = replace(
            pattern, radius=search.given.get("radius", float(np.median(candidates.radii[chosen])))
        )
        if not _fits(pattern, search.spacing):
            break
        chance = log_chance(pattern, places, chosen, candidates, area=search.area, spacing=search.spacing)
        if best is not None and chance >= best.log_chance:
            break
        best = Proposal(pattern, places, chosen, chance)
        if len(chosen) <= limits.LEAST_HOLES + (begun.kind == GRID):
            break
        off = np.hypot(*(candidates.centres[chosen] - pattern.centres[places]).T)
        off = off + np.abs(candidates.radii[chosen] - pattern.radius)
        kept = np.arange(len(chosen)) != off.argmax()
        begun, places, chosen = pattern, places[kept], chosen[kept]
    return best


def _fits(pattern: Pattern, spacing: float) -> bool:
    """Whether holes are apart, and the shape is one of its kind."""
    if pattern.kind == CIRCLE:
        apart = 2 * pattern.x[3] * np.sin(np.pi / pattern.count)
    else:
        apart = pattern.x[3:].min()
    least = (2, 2) if pattern.kind == GRID else (limits.LEAST_HOLES, 1)
    return bool(
        apart > 2 * pattern.radius + limits.RIM_GAP * spacing and min(np.array(pattern.shape) - least) >= 0
    )


def _trim_pattern(pattern: Pattern, places: IntArray) -> tuple[Pattern, IntArray]:
    """The part of a row or grid that its outermost candidates span."""
    i, j = np.divmod(places, pattern.shape[1])
    low, shape = (int(i.min()), int(j.min())), (int(np.ptp(i)) + 1, int(np.ptp(j)) + 1)
    return pattern.resize(low, shape), (i - low[0]) * shape[1] + (j - low[1])


def pairs(search: Search) -> tuple[IntArray, IntArray, FloatArray]:
    """Pairs of like candidates a pitch apart: numbers (m,) twice, and the pitch (m, 2)."""
    first, two = np.triu_indices(len(search.candidates), 1)
    like = search.alike(first, two)
    first, two = first[like], two[like]
    step = search.candidates.centres[two] - search.candidates.centres[first]
    first, two = np.tile(first, len(_MULTIPLES)), np.tile(two, len(_MULTIPLES))
    pitch = np.concatenate([step / m for m in _MULTIPLES])
    length = np.hypot(*pitch.T)
    fits = length > 2 * search.candidates.radii[first]
    if "pitch" in search.given:
        fits &= np.abs(length - search.given["pitch"]) < limits.NEARBY * search.spacing
    return first[fits], two[fits], pitch[fits]


def _match_candidates(search: Search, places: FloatArray, first: IntArray, reach: FloatArray) -> IntArray:
    """The candidate (m, k) near each of places (m, k, 2) that is like the first (m,) of its row, else -1."""
    flat = places.reshape(-1, 2)
    _, near = search.tree.query(flat, k=min(3, len(search.candidates)))
    near = near.reshape(len(flat), -1)
    owner = np.repeat(first, places.shape[1])
    best = np.full(len(flat), -1)
    for column in near.T[::-1]:
        gap = np.hypot(*(search.candidates.centres[column] - flat).T)
        good = (gap < np.broadcast_to(reach, places.shape[:2]).ravel()) & search.alike(owner, column)
        best = np.where(good, column, best)
    return best.reshape(places.shape[:2])


_Begun = Iterator[tuple[Pattern, IntArray, IntArray]]


def _rows(search: Search) -> _Begun:
    """Rows through pairs, where a third candidate fits."""
    first, _, pitch = pairs(search)
    if not len(first):
        return
    number = np.arange(-limits.MOST_IN_LINE, limits.MOST_IN_LINE + 1)
    places = search.candidates.centres[first][:, None] + number[None, :, None] * pitch[:, None]
    reach = limits.NEARBY * search.spacing * (1 + 0.25 * np.abs(number))
    reach = np.minimum(reach[None, :], 0.3 * np.hypot(*pitch.T)[:, None])
    match = _match_candidates(search, places, first, reach)
    for row in np.flatnonzero((match >= 0).sum(axis=1) >= limits.LEAST_HOLES):
        at = np.flatnonzero(match[row] >= 0)
        angle, length = np.arctan2(pitch[row, 1], pitch[row, 0]), float(np.hypot(*pitch[row]))
        for run in _runs(number[at]):
            kept = at[run]
            if len(kept) < limits.LEAST_HOLES:
                continue
            x = np.array([*search.candidates.centres[first[row]], angle, search.given.get("pitch", length)])
            pattern = Pattern(ROW, (len(number), 1), x, 0.0)
            yield pattern, kept, match[row, kept]


def _runs(numbers: IntArray) -> list[IntArray]:
    """Parts (positions) of increasing numbers that nowhere skip more than two."""
    cuts = np.flatnonzero(np.diff(numbers) > 3) + 1
    return list(np.split(np.arange(len(numbers)), cuts))


def _grids(search: Search) -> _Begun:
    """Grids through pairs and a third candidate across."""
    first, _, pitch = pairs(search)
    candidates = search.candidates
    span = np.arange(-8, 9)
    i, j = (g.ravel() for g in np.meshgrid(span, span, indexing="ij"))
    for row in range(len(first)):
        length = float(np.hypot(*pitch[row]))
        along = pitch[row] / length
        across = np.array([-along[1], along[0]])
        offset = (candidates.centres - candidates.centres[first[row]]) @ np.stack([along, across], axis=1)
        steps = np.round(offset[:, 0] / length)
        near = np.abs(offset[:, 0] - steps * length) < limits.NEARBY * search.spacing * (
            1 + 0.25 * np.abs(steps)
        )
        near &= (offset[:, 1] > 2 * candidates.radii[first[row]]) & search.alike(
            first[row], np.arange(len(candidates))
        )
        widths = np.unique(np.round([offset[k, 1] / m for k in np.flatnonzero(near) for m in (1, 2)], 9))
        widths = widths[widths > 2 * candidates.radii[first[row]]]
        if "pitch_2" in search.given:
            widths = widths[np.abs(widths - search.given["pitch_2"]) < 2 * limits.NEARBY * search.spacing]
        if not len(widths):
            continue
        places = (
            candidates.centres[first[row]]
            + i[:, None] * pitch[row]
            + widths[:, None, None] * j[:, None] * across
        )
        reach = limits.NEARBY * search.spacing * (1 + 0.25 * (np.abs(i) + np.abs(j)))
        reach = np.minimum(reach[None], 0.3 * np.minimum(length, widths)[:, None])
        match = _match_candidates(search, places, np.full(len(widths), first[row]), reach)
        for number in np.flatnonzero((match >= 0).sum(axis=1) >= 4):
            at = np.flatnonzero(match[number] >= 0)
            if len(np.unique(i[at])) < 2 or len(np.unique(j[at])) < 2:
                continue
            x = [*candidates.centres[first[row]], np.arctan2(along[1], along[0]), length, widths[number]]
            x[3:] = [
                search.given.get(name, value) for name, value in zip(PARAMETERS[GRID][3:], x[3:], strict=True)
            ]
            yield Pattern(GRID, (len(span), len(span)), np.array(x), 0.0), at, match[number, at]


def _circles(search: Search) -> _Begun:
    """Bolt circles through triples whose angles are shares of a turn."""
    candidates, longest = search.candidates, np.sqrt(search.area)
    counts = np.arange(3, limits.MOST_IN_LINE + 1)
    if "count" in search.given:
        counts = counts[counts == round(search.given["count"])]
    number = np.arange(len(candidates))
    for a in range(len(candidates) - 2):
        b, c = (k + a + 1 for k in np.triu_indices(len(candidates) - a - 1, 1))
        like = search.alike(a, b) & search.alike(a, c) & search.alike(b, c)
        b, c = b[like], c[like]
        middle, radius = _through(candidates.centres[a], candidates.centres[b], candidates.centres[c])
        fits = (radius > 2 * candidates.radii[a] / np.sqrt(3)) & (radius < longest)
        if "circle_radius" in search.given:
            fits &= np.abs(radius - search.given["circle_radius"]) < 2 * limits.NEARBY * search.spacing
        b, c, middle, radius = b[fits], c[fits], middle[fits], radius[fits]
        turn = [_turn(candidates.centres[k] - middle) for k in (np.full(len(b), a), b, c)]
        for n in counts:
            off = [
                np.abs((share := (angles - turn[0]) * n / (2 * np.pi)) - np.round(share))
                for angles in turn[1:]
            ]
            tolerance = 1.5 * limits.NEARBY * search.spacing / radius * n / (2 * np.pi)
            good = (off[0] < tolerance) & (off[1] < tolerance) & (tolerance < 0.25)
            good &= 2 * radius * np.sin(np.pi / n) > 2 * candidates.radii[a]
            rows = np.flatnonzero(good)
            if not len(rows):
                continue
            angles = turn[0][rows, None] + 2 * np.pi * np.arange(n) / n
            ring = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
            places = middle[rows, None] + radius[rows, None, None] * ring
            match = _match_candidates(
                search, places, np.full(len(rows), a), np.array(1.5 * limits.NEARBY * search.spacing)
            )
            enough = np.maximum(limits.LEAST_HOLES, np.ceil(0.5 * n))
            for k in np.flatnonzero((match >= 0).sum(axis=1) >= enough):
                at = np.flatnonzero(match[k] >= 0)
                if match[k, at].min() < a:
                    continue  # it was met from that one
                size = search.given.get("circle_radius", float(radius[rows[k]]))
                x = np.array([*middle[rows[k]], turn[0][rows[k]], size])
                yield Pattern(CIRCLE, (int(n), 1), x, 0.0), at, number[match[k, at]]


def _turn(offset: FloatArray) -> FloatArray:
    return np.asarray(np.arctan2(offset[:, 1], offset[:, 0]))


def _through(first: FloatArray, two: FloatArray, three: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Centres (m, 2) and radii (m,) of circles through a place (2,) and pairs of places (m, 2)."""
    b, c = two - first, three - first
    twice = 2 * (b[:, 0] * c[:, 1] - b[:, 1] * c[:, 0])
    with np.errstate(divide="ignore", invalid="ignore"):
        bb, cc = (b**2).sum(axis=1), (c**2).sum(axis=1)
        offset = np.column_stack([c[:, 1] * bb - b[:, 1] * cc, b[:, 0] * cc - c[:, 0] * bb]) / twice[:, None]
        radius = np.hypot(*offset.T)
    offset = np.where(np.isfinite(radius)[:, None], offset, 0.0)
    return first + offset, np.where(np.isfinite(radius), radius, np.inf)


_CIRCLE_COUNTS = range(4, 17)  # of a circle
_MOST_BEYOND = 4  # places beyond either end of a pattern that are looked at
_MOST_WIDE = 3  # steps of a grid between its first candidates


def lattices(
    kind: str, candidates: HoleCandidates, survey: PlateSurvey, given: Mapping[str, float]
) -> list[Proposal]:
    """Return the patterns of a kind through pairs (triples, of a grid) that have room for three holes.

    Each is as small as the candidates that it goes through allow: a window of its lattice is sought by
    whoever weighs it. Candidates at its other places are among those that it is said to hold.
    """
    if len(candidates) < 2:
        return []
    search = Search.of(candidates, survey.area, survey.spacing, given)
    begun = {ROW: _row_lattices, GRID: _grid_lattices, CIRCLE: _circle_lattices}[kind](search, survey)
    return [Proposal(pattern, *matches(pattern, candidates, survey.spacing), 0.0) for pattern in begun]


def matches(pattern: Pattern, candidates: HoleCandidates, spacing: float) -> tuple[IntArray, IntArray]:
    """Return the places (m,) of a pattern at which candidates are, and their numbers (m,)."""
    if not len(candidates):
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    off = np.linalg.norm(pattern.centres[:, None] - candidates.centres, axis=2)
    apart = np.abs(candidates.radii - pattern.radius)
    unlike = (off > limits.NEARBY * spacing) | (
        apart > limits.ALIKE[0] * spacing + limits.ALIKE[1] * pattern.radius
    )
    cost = np.where(unlike, np.inf, off + apart)
    places = np.flatnonzero(np.isfinite(cost.min(axis=1)))
    return places, cost[places].argmin(axis=1)


def count_range(pattern: Pattern, seen: BoolArray, survey: PlateSurvey) -> tuple[int, int]:
    """Return how many holes a pattern has at least and at most, where `seen` (count,) of them were.

    At least those from the first to the last that were seen. At most as many more as there is room for: an
    end hole whose place is lost can be counted by nobody.
    """
    if pattern.kind == CIRCLE or not seen.any():
        return pattern.count, pattern.count
    least = [int(np.ptp(at)) + 1 for at in np.nonzero(seen.reshape(pattern.shape))]
    (n, m), most = pattern.shape, list(pattern.shape)
    # the first line beyond each end, the way on, and its shape
    lines = [((-1, 0), (-1, 0), (1, m)), ((n, 0), (1, 0), (1, m)),
             ((0, -1), (0, -1), (n, 1)), ((0, m), (0, 1), (n, 1))]  # fmt: skip
    for number, (first, way, shape) in enumerate(lines if pattern.kind == GRID else lines[:2]):
        for k in range(_MOST_BEYOND):
            beyond = pattern.resize((first[0] + k * way[0], first[1] + k * way[1]), shape)
            if survey.is_no_hole(beyond.centres, np.full(beyond.count, pattern.radius)).any():
                break
            most[number // 2] += 1
    return least[0] * least[1], most[0] * most[1]


def _steps(search: Search, survey: PlateSurvey) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
    """Pairs (m,) of like candidates, the pitch (m, 2) and the radius (m,), with room for holes between."""
    first, two, pitch = pairs(search)
    radius = (search.candidates.radii[first] + search.candidates.radii[two]) / 2
    room = np.hypot(*pitch.T) > 2 * radius + limits.RIM_GAP * search.spacing
    for place in (search.candidates.centres[first] + pitch, search.candidates.centres[two] - pitch):
        room &= ~survey.is_no_hole(place, radius)
    return first[room], two[room], pitch[room], radius[room]


def _row_lattices(search: Search, survey: PlateSurvey) -> Iterator[Pattern]:
    """Rows with room for a third hole beside the first two, or between."""
    indices, two, pitch, radius = _steps(search, survey)
    first, last = search.candidates.centres[indices], search.candidates.centres[two]
    length = np.hypot(*pitch.T)
    count = np.rint(np.hypot(*(last - first).T) / length).astype(np.int64) + 1
    beside = ~(survey.is_no_hole(first - pitch, radius) & survey.is_no_hole(last + pitch, radius))
    for k in np.flatnonzero(beside | (count > 2)):
        middle, angle = (first[k] + last[k]) / 2, np.arctan2(pitch[k, 1], pitch[k, 0])
        size = search.given.get("pitch", float(length[k]))
        radius_k = search.given.get("radius", float(radius[k]))
        pattern = Pattern(ROW, (int(count[k]), 1), np.array([*middle, angle, size]), radius_k)
        low = -int(count[k] == 2 and not survey.is_no_hole(first[k] - pitch[k], radius[k]))
        yield pattern.resize((low, 0), (max(pattern.shape[0], 3), 1))


def _grid_lattices(search: Search, survey: PlateSurvey) -> Iterator[Pattern]:
    """Grids through pairs and a third candidate across, with room in all of the rectangle of these."""
    first, two, pitch, radius = _steps(search, survey)
    candidates = search.candidates
    length = np.hypot(*pitch.T)
    for k in range(len(first)):
        along = pitch[k] / length[k]
        across = np.array([-along[1], along[0]])
        offset = (candidates.centres - candidates.centres[first[k]]) @ np.stack([along, across], axis=1)
        steps = np.rint(offset[:, 0] / length[k]).astype(np.int64)
        n_along = int(
            np.rint(np.hypot(*(candidates.centres[two[k]] - candidates.centres[first[k]])) / length[k])
        )
        least = 2 * radius[k] + limits.RIM_GAP * search.spacing
        near = np.abs(offset[:, 0] - steps * length[k]) < limits.NEARBY * search.spacing * (
            1 + 0.25 * np.abs(steps)
        )
        near &= (np.abs(offset[:, 1]) > least) & search.alike(first[k], np.arange(len(candidates)))
        near &= (steps >= -_MOST_WIDE) & (steps <= n_along + _MOST_WIDE)
        for third in np.flatnonzero(near):
            for n_across in range(1, _MOST_WIDE + 1):
                width = abs(float(offset[third, 1])) / n_across
                if width < least:
                    break
                low, high = min(0, int(steps[third])), max(n_along, int(steps[third]))
                shape = (high - low + 1, n_across + 1)
                middle = (
                    candidates.centres[first[k]] + (low + high) / 2 * pitch[k] + offset[third, 1] / 2 * across
                )
                x = np.array([*middle, np.arctan2(along[1], along[0]), length[k], width])
                x[3:] = [search.given.get(name, value)
                         for name, value in zip(("pitch", "pitch_2"), x[3:], strict=True)]  # fmt: skip
                pattern = Pattern(GRID, shape, x, search.given.get("radius", float(radius[k])))
                if not survey.is_no_hole(pattern.centres, np.full(pattern.count, radius[k])).any():
                    yield pattern


def _circle_lattices(search: Search, survey: PlateSurvey) -> Iterator[Pattern]:
    """Bolt circles through pairs, any share of a turn apart, with room for all holes."""
    indices, two, pitch, radius = _steps(search, survey)
    first, last = search.candidates.centres[indices], search.candidates.centres[two]
    whole = np.hypot(*(pitch - (last - first)).T) < 1e-9  # each pair once
    first, last, radius = first[whole], last[whole], radius[whole]
    half, longest = np.hypot(*(last - first).T) / 2, np.sqrt(search.area) / 2
    across = np.column_stack([first[:, 1] - last[:, 1], last[:, 0] - first[:, 0]]) / (2 * half[:, None])
    for n in _CIRCLE_COUNTS if "count" not in search.given else [round(search.given["count"])]:
        for step in range(1, n // 2 + 1):
            size = half / np.sin(np.pi * step / n)
            fits = (2 * size * np.sin(np.pi / n) > 2 * radius + limits.RIM_GAP * search.spacing) & (
                size < longest
            )
            if "circle_radius" in search.given:
                fits &= np.abs(size - search.given["circle_radius"]) < 2 * limits.NEARBY * search.spacing
            high = np.sqrt(np.maximum(size**2 - half**2, 0.0))
            for side in (1, -1) if 2 * step != n else (1,):
                k = np.flatnonzero(fits)
                middle = (first[k] + last[k]) / 2 + side * high[k, None] * across[k]
                begin = np.arctan2(*(first[k] - middle).T[::-1])
                turn = begin[:, None] + 2 * np.pi * np.arange(n) / n
                ring = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
                places = middle[:, None] + size[k, None, None] * ring
                radii = np.broadcast_to(radius[k, None], turn.shape)
                for m in np.flatnonzero(~survey.is_no_hole(places, radii).any(axis=1)):
                    circle = search.given.get("circle_radius", float(size[k[m]]))
                    x = np.array([*middle[m], begin[m], circle])
                    yield Pattern(CIRCLE, (n, 1), x, search.given.get("radius", float(radius[k[m]])))
