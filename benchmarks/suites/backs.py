# SPDX-License-Identifier: MIT
"""Back sides of things: symmetries, the surface they imply, closed shapes, volumes and depths, beside peers.

Things of about 150 kinds stand on a bare floor and are scanned from one to three sides, with noise of 0.1 %
of their size and occluders over up to 40 %. "tuning" kinds fitted the models (`backs-fit`), "held-out" ones
did not.
A symmetry is true where 85 % of the whole true surface maps within 1.5 % of the size (axes 2 %).
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from benchmarks.cases.backs.case import (
    CUPBOARDS,
    ThingCase,
    TrueThing,
    kinds_of,
    make_case,
    occupied,
)
from benchmarks.methods.backs import least_contradicted, superquadric
from benchmarks.run import head, row, suite
from benchmarks.store import each
from completion.backs.closing import close
from completion.backs.intervals import Extent, closed_by
from completion.backs.pipeline import Back, find_back
from completion.backs.probability import elements_of, features
from completion.backs.symmetry import Symmetry
from completion.backs.views import prepare_sight, scale_of
from completion.backs.weights import VOLUMES
from scenes.checks import BoolArray, FloatArray

_NEAR, _NEAR_AXIS, _MAPPED = 0.015, 0.02, 0.85
_IOU_CELL, _VOLUME_CELL = 0.025, 0.008  # shares of size
_EXTENTS = ("width", "depth", "height")
_SOLID = 0.02  # share of size^3
_PEERS = ("closed", "hull in shadow", "superquadric", "mirror always")


@dataclass(frozen=True, slots=True)
class Tested:
    """A hypothesis: its kind, the terms of its model, its probability, the share of the surface it maps."""

    kind: str
    terms: list[float]
    probability: float
    mapped: float
    accepted: bool

    @property
    def is_true(self) -> bool:
        """Whether enough of the surface maps."""
        return self.mapped >= _MAPPED


@dataclass(frozen=True, slots=True)
class Scored:
    """What was found of one thing, beside the truth; lengths are shares of its size."""

    kind: str
    covered: float
    hypotheses: list[Tested]
    n_asserted: int
    within: list[float]  # share of asserted surface within 1 % and 2 %
    in_free: int  # asserted points that true beams passed
    recall: float  # share of the hidden surface with asserted surface within 2 %
    iou: dict[str, float]
    volumes: list[float]  # true, closed, least, most
    closed_by: str
    is_symmetric: bool
    extents: dict[str, list[float]]  # width, depth, height: true, estimate, least, most or inf
    cpu_s: float

    @property
    def is_solid(self) -> bool:
        """Whether it takes up more than 2 % of its size^3."""
        return self.volumes[0] > _SOLID


def score(kind: str, seed: int, n_views: int, wall: bool, peers: bool) -> Scored | None:
    """Find the back of a thing and compare it with the truth; None where it is covered too much."""
    case = make_case(kind, seed, n_views, wall=wall, occluded=not wall)
    if case is None:
        return None
    start = time.process_time()
    back = find_back(case.views, case.setting)
    cpu_s = time.process_time() - start
    thing = TrueThing(case.corners)
    tested = [_tested(one, thing, back) for one in back.hypotheses]
    away = thing.distance(back.asserted.points)
    n = len(away)
    grid = _grid(case.corners, _IOU_CELL)
    true = occupied(case.corners, *grid)
    shapes = {"closed": back.shape.vertices[back.shape.faces]}
    if peers:
        shapes |= _peers(case, back)
    iou = {name: _iou(true, occupied(corners, *grid)) for name, corners in shapes.items()}
    fine = _grid(case.corners, _VOLUME_CELL)
    volume = float(occupied(case.corners, *fine).sum()) * _VOLUME_CELL**3
    return Scored(
        kind=kind, covered=case.covered, hypotheses=tested, n_asserted=n,
        within=[float((away <= limit).mean()) if n else float("nan") for limit in (0.01, 0.02)],
        in_free=_in_free(case, back.asserted.points), recall=_recall(case, thing, back), iou=iou,
        volumes=[volume, back.volume.closed, back.volume.least, back.volume.most],
        closed_by=closed_by(back.chosen), is_symmetric=thing.has_mirror(),
        extents={name: _extent(case, getattr(back.extents, name)) for name in _EXTENTS}, cpu_s=cpu_s,
    )  # fmt: skip


def _extent(case: ThingCase, extent: Extent) -> list[float]:
    true = float(np.ptp(case.corners.reshape(-1, 3) @ np.array(extent.way)))
    return [true, extent.estimate, extent.least, np.inf if extent.most is None else extent.most]


def _held(some: Sequence[Scored], name: str) -> str:
    """How many extents their intervals held, of those that are bounded, and how wide these are."""
    known = np.array([one.extents[name] for one in some])
    known = known[np.isfinite(known[:, 3])]
    held = (known[:, 2] - 1e-3 <= known[:, 0]) & (known[:, 0] <= known[:, 3] + 1e-3)
    width = 100 * np.median(known[:, 3] - known[:, 2]) if len(known) else np.nan
    return f"{held.sum()} of {len(known)} held, median interval {width:.1f} % of size"


def _tested(one: Symmetry, thing: TrueThing, back: Back) -> Tested:
    near = _NEAR if one.kind == "mirror" else _NEAR_AXIS
    mapped = thing.share_mapped(one.isometries(9), near)
    terms: list[float] = features(one).tolist()
    return Tested(one.kind, terms, one.probability, mapped, any(one is other for other in back.sure))


def _grid(corners: FloatArray, cell: float) -> tuple[FloatArray, float, tuple[int, ...]]:
    low, high = corners.reshape(-1, 3).min(axis=0) - 0.35, corners.reshape(-1, 3).max(axis=0) + 0.35
    low[2] = -cell / 2
    return low, cell, tuple(np.ceil((high - low) / cell).astype(int).tolist())


def _iou(one: BoolArray, other: BoolArray) -> float:
    return float((one & other).sum() / max((one | other).sum(), 1))


def _peers(case: ThingCase, back: Back) -> dict[str, FloatArray]:
    """Closed triangles of the peers, from the same pixels."""
    scale = scale_of(case.views, case.setting)
    sights = [prepare_sight(view, scale) for view in case.views]
    points = np.concatenate([view.points for view in case.views])
    hull = close(sights, [], np.zeros((0, 3)), case.setting, scale=scale)
    taken = elements_of(least_contradicted(back.hypotheses), 2)
    moved = [points @ one.isometry[:, :3].T + one.isometry[:, 3] for one in taken]
    mirror = close(sights, taken, np.concatenate([np.zeros((0, 3)), *moved]), case.setting, scale=scale)
    return {
        "hull in shadow": hull.vertices[hull.faces],
        "superquadric": superquadric(points, case.setting.support_m),
        "mirror always": mirror.vertices[mirror.faces],
    }


def _in_free(case: ThingCase, points: FloatArray) -> int:
    """How many points a true beam passed by more than 2 % of the size: the veto allows 1.5 %, and noise."""
    passed = np.zeros(len(points), dtype=np.bool_)
    for view, ranges in zip(case.views, case.true_ranges, strict=True):
        pixel = view.scan.pixels(points)
        seen = np.isfinite(pixel).all(axis=1)
        at = np.rint(pixel[seen]).astype(int)
        away = np.linalg.norm(points[seen] - view.scan.origin, axis=1)
        passed[seen] |= ranges[at[:, 0], at[:, 1]] - away > 0.02
    return int(passed.sum())


def _recall(case: ThingCase, thing: TrueThing, back: Back) -> float:
    """Share of the outer surface that no view measured which lies within 2 % of asserted surface."""
    from scipy.spatial import cKDTree

    samples = thing.samples[::10]
    outer = samples[samples[:, 2] > 0.01]
    measured = cKDTree(np.concatenate([view.points for view in case.views])).query(outer)[0] < 0.015
    hidden = outer[~measured]
    if not len(hidden) or not len(back.asserted.points):
        return 0.0
    return float((cKDTree(back.asserted.points).query(hidden)[0] <= 0.02).mean())


def run_cases(half: str, seeds: range, n_views: int, *, peers: bool, kinds: int) -> list[Scored]:
    """Score all kinds of a half with some seeds."""
    names = kinds_of(half)[: kinds or None]
    tasks = [(kind, seed) for kind in names for seed in seeds]
    found = each(score, [kind for kind, _ in tasks], [seed for _, seed in tasks], n_views, False, peers)
    return [one for one in found if one is not None]


@suite("backs", smallest="--kinds 2 --seeds 1")
def backs(
    half: str = "held-out", seeds: int = 3, first: int = 0, kinds: int = 0, *, wrong: bool = False
) -> Iterator[str]:
    """Back sides of things: probabilities, precision of inferred surface, closed shapes, volumes, depths."""
    numbers = range(first, first + seeds)
    single = run_cases(half, numbers, 1, peers=True, kinds=kinds)
    yield f"{half}: {len(single)} single views of {len({one.kind for one in single})} kinds"
    yield ""
    yield from _table(single)
    yield ""
    yield from head("probability", "n", "mean", "true")
    yield from _bins(single)
    yield ""
    yield from head("IoU", *_PEERS)
    for name, some in (("all", single), ("solid", [one for one in single if one.is_solid])):
        yield row(name, *(f"{np.mean([one.iou[peer] for one in some]):.3f}" for peer in _PEERS))
    yield ""
    yield from head("views", "asserted", "within 1 %", "within 2 %", "recall 2 %", "IoU", "volume held")
    for n_views in (1, 2, 3):
        some = (
            single
            if n_views == 1
            else run_cases(half, range(first, first + 1), n_views, peers=False, kinds=kinds)
        )
        yield row(n_views, *_surface(some))
    yield ""
    cupboards = [
        one
        for one in each(
            score, [k for k in CUPBOARDS[half] for _ in range(14)], [*range(14)] * 3, 1, True, False
        )
        if one is not None
    ]
    yield f"depth of {len(cupboards)} cupboards before a wall: {_held(cupboards, 'depth')}"
    for name in _EXTENTS:
        yield f"{name} of {len(single)} single views: {_held(single, name)}"
    cpu = np.array([one.cpu_s for one in single])
    yield f"CPU {np.median(cpu):.2f} s a thing (median), {cpu.max():.2f} s at most"
    if wrong:
        for one in single:
            for two in one.hypotheses:
                if two.accepted and not two.is_true:
                    yield f"wrong: {one.kind} {two.kind} p {two.probability:.2f} maps {two.mapped:.2f}"


def _surface(some: Sequence[Scored]) -> list[str]:
    used = [one for one in some if one.n_asserted]
    cells = [f"{len(used)} of {len(some)}"]
    weight = np.array([one.n_asserted for one in used], dtype=float)
    for k in (0, 1):
        each_ = np.array([one.within[k] for one in used])
        cells.append(
            f"{each_.mean():.3f} ({(each_ * weight).sum() / weight.sum():.3f} by area)" if len(used) else "-"
        )
    held = [one.volumes[2] <= one.volumes[0] <= one.volumes[3] for one in some]
    mean = (
        np.mean([one.recall for one in some]),
        np.mean([one.iou["closed"] for one in some]),
        np.mean(held),
    )
    return [*cells, *(f"{value:.3f}" for value in mean)]


def _table(single: Sequence[Scored]) -> Iterator[str]:
    """What is accepted at 0.8, and how much of it is wrong."""
    accepted = [(one, two) for one in single for two in one.hypotheses if two.accepted]
    bare = [one for one in single if not one.is_symmetric]
    yield from head("at p >= 0.8", "n", "wrong", "share")
    for name in ("mirror", "axis", "turn"):
        some = [two for _, two in accepted if two.kind == name]
        bad = sum(not two.is_true for two in some)
        yield row(name, len(some), bad, f"{100 * bad / max(len(some), 1):.1f} %")
    bad = sum(not two.is_true for _, two in accepted)
    yield row("all", len(accepted), bad, f"{100 * bad / max(len(accepted), 1):.1f} %")
    taken = sum(any(two.accepted for two in one.hypotheses) for one in bare)
    yield row(
        "things without a mirror, even to 3 %", len(bare), taken, f"{100 * taken / max(len(bare), 1):.1f} %"
    )
    yield row(
        "asserted points in free space",
        sum(one.n_asserted for one in single),
        sum(one.in_free for one in single),
        "",
    )


def _bins(single: Sequence[Scored]) -> Iterator[str]:
    every = [two for one in single for two in one.hypotheses]
    for low, high in ((0, 0.1), (0.1, 0.3), (0.3, 0.5), (0.5, 0.7), (0.7, 0.8), (0.8, 0.9), (0.9, 1.01)):
        some = [two for two in every if low <= two.probability < high]
        if some:
            mean, true = np.mean([two.probability for two in some]), np.mean([two.is_true for two in some])
            yield row(f"{low} - {min(high, 1)}", len(some), f"{mean:.2f}", f"{true:.2f}")


@suite("backs-fit", smallest="--kinds 2 --seeds 1")
def backs_fit(seeds: int = 5, kinds: int = 0) -> Iterator[str]:
    """Weights of back sides' models, fitted on the tuning kinds."""
    found = run_cases("tuning", range(100, 100 + seeds), 1, peers=False, kinds=kinds)
    every = [(two, one) for one in found for two in one.hypotheses]
    for name in ("mirror", "axis", "turn"):
        some = [(two, one) for two, one in every if two.kind == name]
        if not some:
            continue
        terms = np.array([two.terms for two, _ in some])
        true = np.array([two.is_true for two, _ in some])
        weights = fit_logistic(terms, true, 10.0 if name == "mirror" else 1.0)
        likely = 1 / (1 + np.exp(-terms @ weights))
        yield f"{name}: {len(some)} of which {true.sum()} true, Brier {np.mean((likely - true) ** 2):.3f}"
        yield f"  ({', '.join(f'{value:.2f}' for value in weights)})"
        yield f"  at 0.8: {(likely >= 0.8).sum()}, wrong {(~true[likely >= 0.8]).sum()}"
    for name in VOLUMES:
        closed = [one for one in found if one.closed_by == name and one.volumes[1] > 0]
        if closed:
            ratio = np.array([one.volumes[0] / one.volumes[1] for one in closed])
            low, high = quantiles_across(ratio, [one.kind for one in closed])
            yield f"volume, {name}: {len(ratio)}, {low:.3f} to {high:.3f}"
            yield from _extent_slack(closed)


def _extent_slack(closed: Sequence[Scored]) -> Iterator[str]:
    """By how much the extents of things closed the same way are too small, where they are bounded."""
    for name in _EXTENTS[:2]:
        bounded = [one for one in closed if np.isfinite(one.extents[name][3])]
        if bounded:
            short = np.array([one.extents[name][0] - one.extents[name][1] for one in bounded])
            most = quantiles_across(short, [one.kind for one in bounded], share=0.9)[1]
            yield f"  {name}: {len(short)}, at most {most:.3f} more"


def quantiles_across(ratio: FloatArray, kinds: Sequence[str], share: float = 0.8) -> tuple[float, float]:
    """Return the narrowest of symmetric quantiles that hold a share of the kinds they were not taken from."""
    fold = np.unique(np.array(kinds), return_inverse=True)[1] % 8
    tail = 0.1
    for tail in np.arange(0.1, 0.0, -0.005):
        held = 0
        for k in range(8):
            other, own = ratio[fold != k], ratio[fold == k]
            if len(other):
                low, high = np.quantile(other, [tail, 1 - tail])
                held += int(((own >= low) & (own <= high)).sum())
        if held >= share * len(ratio):
            break
    low, high = np.quantile(ratio, [tail, 1 - tail])
    return float(low), float(high)


def fit_logistic(terms: FloatArray, true: BoolArray, ridge: float) -> FloatArray:
    """Return weights (k,) of the logistic model, with a ridge on all but the first of the scaled terms."""
    scale = np.maximum(terms.std(axis=0), 0.05)
    scale[0] = 1.0
    scaled = terms / scale

    def cost(weights: FloatArray) -> tuple[float, FloatArray]:
        at = scaled @ weights
        likely = 1 / (1 + np.exp(-at))
        value = float(np.logaddexp(0, np.where(true, -at, at)).sum() + ridge * (weights[1:] ** 2).sum())
        gradient = scaled.T @ (likely - true)
        gradient[1:] += 2 * ridge * weights[1:]
        return value, gradient

    best = minimize(cost, np.zeros(terms.shape[1]), jac=True, method="L-BFGS-B", options={"maxiter": 500})
    return np.asarray(best.x / scale)
