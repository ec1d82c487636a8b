# SPDX-License-Identifier: MIT
"""Junctions on one page: all points as one, or patches, pairs of them, and a fit for each.

A patch is where the cloud is one plane or cylinder, grown from the smoothest places.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from completion.features.engine.template import FeatureStatus, Given, Measurements, TemplateFit, best_first
from completion.features.engine.template_fit import NOTHING
from completion.features.junctions import limits
from completion.features.junctions.alternatives import one_arc
from completion.features.junctions.elbows import fit_elbow
from completion.features.junctions.models import Descent, Unit, at_unit, descend_to_rest, thickness
from completion.features.junctions.tangent import fit_junction
from scenes.checks import BoolArray, FloatArray, InputError, IntArray

_MOST_CLOUD_POINTS = 16_000
_N_NEIGHBOURS = 16
_BALLS = (120, 48)  # points that a patch begins with, first and where that was too large
_N_SEEDS = 90
_N_GROWTHS = 6
_N_FITTED, _N_ROUNDS = 800, 3
_N_DIRECTIONS = 4  # that a patch begins in


@dataclass(frozen=True, slots=True, eq=False)
class OrientedCloud:
    """Points thinned, with normals and neighbours.

    Attributes
    ----------
    points, normals : (n, 3) float
        At unit RMS; normals without a side.
    neighbours : (n, k) int
        The nearest of each.
    spacing : float
        Typical distance of the nearest.
    noise : float
        Typical roughness.
    which : (n,) int
        Number of each among all points.
    """

    points: FloatArray
    normals: FloatArray
    neighbours: IntArray
    roughness: FloatArray
    spacing: float
    noise: float
    which: IntArray


class CloudPatch(NamedTuple):
    """Points (m,) of a cloud on one plane or cylinder, by number, and that surface."""

    members: IntArray
    fit: Descent
    is_flat: bool

    @property
    def radius(self) -> float:
        """Of the cylinder; inf of a plane."""
        return np.inf if self.is_flat else float(1 / max(abs(self.fit.model.shape[0]), 1e-12))


def cloud_of(unit: Unit) -> OrientedCloud:
    """Return at most some thousand points of what was measured, with normals and neighbours."""
    points = unit.points
    which = np.arange(len(points))[:: max(1, -(-len(points) // _MOST_CLOUD_POINTS))]
    sample = points[which]
    k = min(_N_NEIGHBOURS + 1, len(sample))
    tree = cKDTree(sample)
    apart, near = tree.query(sample, k=k)
    around = sample[near] - sample[near].mean(axis=1, keepdims=True)
    values, vectors = np.linalg.eigh(np.einsum("nki,nkj->nij", around, around) / k)
    rough = np.sqrt(np.maximum(values[:, 0], 0.0))
    spacing = float(np.median(apart[:, 1]))
    noise = max(unit.measured.noise, float(np.quantile(rough, 0.2)), 0.01 * spacing)
    return OrientedCloud(
        sample, vectors[:, :, 0], near[:, 1:], rough, spacing=spacing, noise=noise, which=which
    )


def find_patches(cloud: OrientedCloud) -> list[CloudPatch]:
    """Return the planes and cylinders of a cloud, the smoothest places first."""
    free = np.ones(len(cloud.points), dtype=np.bool_)
    untried = free.copy()
    order = np.argsort(cloud.roughness, kind="stable")
    patches: list[CloudPatch] = []
    for _ in range(_N_SEEDS):
        open_ = order[(untried & free)[order]]
        if len(open_) == 0 or free.sum() < limits.SIDE_POINTS:
            break
        seed = int(open_[0])
        patch = _grown(cloud, seed, free)
        if patch is None:
            untried[seed] = False
            untried[cloud.neighbours[seed]] = False
            continue
        patches.append(patch)
        free[patch.members] = False
        untried[patch.members] = False
    return patches


def _grown(cloud: OrientedCloud, seed: int, free: BoolArray) -> CloudPatch | None:
    """A patch about a seed, of free points."""
    for size in _BALLS:
        ball = _ball(cloud, seed, free, size)
        if len(ball) < limits.SIDE_POINTS:
            return None
        patch = _from_ball(cloud, ball, free)
        if patch is not None:
            return patch
    return None


def _from_ball(cloud: OrientedCloud, ball: IntArray, free: BoolArray) -> CloudPatch | None:
    """A patch from the points (m,) of a ball, if they are one surface."""
    fit = _fit_surface(cloud, ball)
    if fit.mixture.sigma > 2.5 * cloud.noise + 0.05 * cloud.spacing:
        return None
    members = ball
    for _ in range(_N_GROWTHS):
        section = fit.model.section(cloud.points)
        normal = section.slope @ fit.model.turn
        agrees = np.abs(np.einsum("ij,ij->i", normal, cloud.normals)) > limits.PATCH_TURN
        band = limits.PATCH_SD * max(fit.mixture.sigma, cloud.noise)
        on = free & agrees & (np.abs(section.distance) < band)
        grown = _connected_part(cloud, on, ball)
        if len(grown) < limits.SIDE_POINTS:
            return None
        if len(grown) == len(members) and (grown == members).all():
            break
        members = grown
        fit = _refit(fit, cloud.points[members])
    size = float(np.ptp(fit.model.local(cloud.points[members])[:, 1]))
    sagitta = abs(fit.model.shape[0]) * size**2 / 8
    return CloudPatch(members, fit, is_flat=bool(sagitta < max(limits.FLAT_SHARE * size, 2 * cloud.noise)))


def _fit_surface(cloud: OrientedCloud, members: IntArray) -> Descent:
    """The plane or cylinder of some points (m,), brought to unit RMS for it and back."""
    unit = at_unit(Measurements(cloud.points[members], 0.0, cloud.spacing))
    fit = one_arc(unit.points, thickness(unit.points), _N_DIRECTIONS)
    model = replace(fit.model, origin=unit.outside(fit.model.origin), shape=fit.model.shape * unit.factor)
    mixture = replace(
        fit.mixture, sigma=fit.mixture.sigma / unit.factor, reach=fit.mixture.reach / unit.factor
    )
    return fit._replace(model=model, mixture=mixture)


def _refit(fit: Descent, points: FloatArray) -> Descent:
    """The fit on at most some of the points (n, 3)."""
    return descend_to_rest(fit, points[:: max(1, len(points) // _N_FITTED)], _N_ROUNDS)


def _ball(cloud: OrientedCloud, seed: int, free: BoolArray, size: int) -> IntArray:
    """About so many free points (m,) that are connected with a seed."""
    inside = np.zeros(len(free), dtype=np.bool_)
    inside[seed] = True
    edge = np.array([seed])
    while len(edge) and inside.sum() < size:
        edge = np.unique(cloud.neighbours[edge])
        edge = edge[free[edge] & ~inside[edge]]
        inside[edge] = True
    return np.flatnonzero(inside)


def _connected_part(cloud: OrientedCloud, on: BoolArray, ball: IntArray) -> IntArray:
    """The points (m,) among some that are connected with most of a ball."""
    number = np.flatnonzero(on)
    if len(number) == 0:
        return number
    where = np.full(len(on), -1)
    where[number] = np.arange(len(number))
    to = where[cloud.neighbours[number]]
    row, column = np.nonzero(to >= 0)
    graph = coo_array((np.ones(len(row)), (row, to[row, column])), shape=(len(number), len(number)))
    _, label = connected_components(graph, directed=False)
    inside = where[ball]
    inside = inside[inside >= 0]
    if len(inside) == 0:
        return number[:0]
    return np.asarray(number[label == np.bincount(label[inside]).argmax()])


class JunctionCandidate(NamedTuple):
    """Where a feature may be: its kind, and points (n, 3) about it, by truth (n,) of the cloud."""

    kind: str
    members: IntArray
    worth: float  # points of the smaller patch: the order in which they are tried


def touching_patches(cloud: OrientedCloud, patches: list[CloudPatch]) -> list[JunctionCandidate]:
    """Return pairs of patches that lie side by side with one normal at their border."""
    label = np.full(len(cloud.points), -1)
    for k, patch in enumerate(patches):
        label[patch.members] = k
    pairs = []
    for (i, j), border in _borders(cloud, label).items():
        first, second = patches[i], patches[j]
        if len(border) < limits.TOUCHING_PAIRS or (first.is_flat and second.is_flat):
            continue
        if not _are_tangent(first, second, cloud.points[border]):
            continue
        members = _about(cloud, first, second, border)
        if len(members) >= limits.JOINT_POINTS:
            pairs.append(
                JunctionCandidate("junction", members, float(min(len(first.members), len(second.members))))
            )
    return sorted(pairs, key=lambda candidate: -candidate.worth)


def _borders(cloud: OrientedCloud, label: IntArray) -> dict[tuple[int, int], IntArray]:
    """Points (b,) of pairs that have a neighbour of another patch; narrow gaps of free points are closed."""
    closed = label.copy()
    for _ in range(2):
        free = np.flatnonzero(closed < 0)
        around = closed[cloud.neighbours[free]]
        for side_cells in around.T:
            take = (closed[free] < 0) & (side_cells >= 0)
            closed[free[take]] = side_cells[take]
    row, column = np.nonzero(closed[cloud.neighbours] != closed[:, None])
    other = closed[cloud.neighbours[row, column]]
    members = closed[row]
    good = (members >= 0) & (other >= 0)
    pairs: dict[tuple[int, int], list[int]] = {}
    for a, b, point in zip(members[good], other[good], row[good], strict=True):
        pairs.setdefault((int(min(a, b)), int(max(a, b))), []).append(int(point))
    return {pair: np.unique(points) for pair, points in sorted(pairs.items())}


def _are_tangent(first: CloudPatch, second: CloudPatch, border: FloatArray) -> bool:
    """Whether both surfaces have one direction along, and one normal at points (b, 3) of the border."""
    axes = [patch.fit.model.turn[2] for patch in (first, second)]
    normals = [patch.fit.model.section(border).slope @ patch.fit.model.turn for patch in (first, second)]
    agree = np.abs(np.einsum("ij,ij->i", *normals))
    if first.is_flat or second.is_flat:
        flat, round_ = (0, 1) if first.is_flat else (1, 0)
        is_along = abs(float(np.median(normals[flat] @ axes[round_]))) < limits.ACROSS
    else:
        is_along = abs(float(axes[0] @ axes[1])) > limits.PARALLEL
    return bool(is_along and np.median(agree) > limits.TANGENT)


def _about(cloud: OrientedCloud, first: CloudPatch, second: CloudPatch, border: IntArray) -> IntArray:
    """Points (m,) of both patches, and free ones, as far from the border as the narrower patch is wide."""
    tree = cKDTree(cloud.points[border])
    widths = [float(tree.query(cloud.points[patch.members])[0].max()) for patch in (first, second)]
    reach = 1.2 * min(widths) + 2 * cloud.spacing
    both = np.union1d(first.members, second.members)
    return np.asarray(both[tree.query(cloud.points[both])[0] <= reach])


def crossing_tubes(cloud: OrientedCloud, patches: list[CloudPatch]) -> list[JunctionCandidate]:
    """Return pairs of tubes of like radii whose axes cross not far from both."""
    tubes = [
        patch for patch in patches if not patch.is_flat and len(patch.members) >= limits.JOINT_POINTS // 2
    ]
    pairs = []
    for i, first in enumerate(tubes):
        for second in tubes[:i]:
            if abs(first.radius - second.radius) > limits.SAME_TUBE * max(first.radius, second.radius):
                continue
            members = _pipe(cloud, first, second)
            if len(members) >= limits.JOINT_POINTS:
                worth = float(min(len(first.members), len(second.members)))
                pairs.append(JunctionCandidate("elbow", members, worth))
    return sorted(pairs, key=lambda candidate: -candidate.worth)


def _pipe(cloud: OrientedCloud, first: CloudPatch, second: CloudPatch) -> IntArray:
    """Points (m,) about the axes of two tubes, from where these cross; none where they do not."""
    none = np.zeros(0, dtype=np.int64)
    radius = (first.radius + second.radius) / 2
    axes = [_axis(patch) for patch in (first, second)]
    (p, a), (q, b) = axes
    sine = float(np.linalg.norm(np.cross(a, b)))
    if sine < limits.LEAST_TURN or abs(float((q - p) @ np.cross(a, b))) / sine > limits.MISS_RADII * radius:
        return none
    along = float(a @ b)
    s, t = np.linalg.solve([[1.0, -along], [along, -1.0]], [(q - p) @ a, (q - p) @ b])
    corner = (p + s * a + q + t * b) / 2
    on = np.zeros(len(cloud.points), dtype=np.bool_)
    for patch, axis in ((first, a), (second, b)):
        reach = (cloud.points[patch.members] - corner) @ axis
        way = np.sign(np.median(reach)) * axis
        if np.quantile(np.abs(reach), 0.05) > limits.CORNER_RADII * radius or np.median(reach) == 0:
            return none
        local = cloud.points - corner
        height = np.clip(
            local @ way, 0.0, max(limits.ARM_RADII * radius, float(np.quantile(np.abs(reach), 0.5)))
        )
        on |= np.linalg.norm(local - height[:, None] * way, axis=1) < limits.BEND_RADII * radius
    return np.flatnonzero(on)


def _axis(patch: CloudPatch) -> tuple[FloatArray, FloatArray]:
    """A point (3,) of a tube's axis, and its direction (3,)."""
    model = patch.fit.model
    return model.origin - model.turn[0] / model.shape[0], model.turn[2]


KINDS = ("junction", "elbow")
_FITS = {"junction": fit_junction, "elbow": fit_elbow}
_CANDIDATES = {"junction": touching_patches, "elbow": crossing_tubes}
_MOST_POINTS = 6_000  # that one fit looks at


def find_junctions(
    measured: Measurements,
    kinds: Sequence[str],
    given: Given = NOTHING,
    *,
    rng: np.random.Generator,
    budget: int = 200_000,
) -> list[TemplateFit]:
    """Find where surfaces run into each other: tangent junctions (fillets among them) and elbows of pipes.

    Parameters
    ----------
    measured : Measurements
        Points (n, 3) of a junction, or of a whole part or pipe.
    kinds : sequence of str
        Of "junction", "elbow".
    given : mapping
        What is known, held exactly: "radius_1", "radius_2" (inf for a plane); "bend_radius", "tube_radius",
        "angle" (radians).
    rng : Generator
        Which points a fit looks at where there are more than it needs.
    budget : int
        Evaluations at most; the candidates that are left then are not tried, and no fit is complete.

    Returns
    -------
    list of TemplateFit
        The best first; where nothing is found, what is told of all points as one.

    Raises
    ------
    InputError
        Another kind; a given value that is not above 0.
    """
    _check(kinds, given)
    whole = [_fit(kind, measured, np.arange(len(measured.points)), given, rng=rng) for kind in kinds]
    # what all points leave open, some of them cannot decide: a patch hides what speaks against it
    template_fit = [fit for fit in whole if fit.status is not FeatureStatus.NONE]
    at_once = [fit for fit in template_fit if (fit.assignment > 0).mean() > limits.HALF]
    if at_once:
        return best_first(at_once)

    # 1. Patches: where points are one plane or cylinder.
    unit = at_unit(measured)
    cloud = cloud_of(unit)
    patches = find_patches(cloud)

    # 2. Candidates: pairs that touch along a line, or whose axes cross; each is fitted by its points.
    tried = [candidate for kind in kinds for candidate in _CANDIDATES[kind](cloud, patches)]
    fits, spent, is_complete = [], sum(fit.evaluations for fit in whole), True
    for candidate in tried:
        if spent >= budget:
            is_complete = False
            break
        fit = _fit(candidate.kind, measured, _members(unit, cloud, candidate), given, rng=rng)
        spent += fit.evaluations
        if fit.status is not FeatureStatus.NONE:
            fits.append(fit)

    # 3. One of each: of fits that are the same, the one with more evidence.
    kept = _distinct(best_first(fits)) if fits else whole
    return [replace(fit, is_complete=is_complete) for fit in best_first(kept)]


def _check(kinds: Sequence[str], given: Given) -> None:
    unknown = [kind for kind in kinds if kind not in KINDS]
    if unknown:
        raise InputError(f"there is no junction {unknown[0]}; there are {', '.join(KINDS)}")
    wrong = [name for name, value in given.items() if not value > 0]
    if wrong:
        raise InputError(f"{wrong[0]} is given as {given[wrong[0]]}; give a number above 0")


def _members(unit: Unit, cloud: OrientedCloud, candidate: JunctionCandidate) -> IntArray:
    """The points (m,) of all about a candidate, by number: those beside its points of the cloud."""
    if len(cloud.points) == len(unit.points):
        return cloud.which[candidate.members]
    apart, _ = cKDTree(cloud.points[candidate.members]).query(
        unit.points, distance_upper_bound=1.5 * cloud.spacing
    )
    return np.flatnonzero(np.isfinite(apart))


def _fit(
    kind: str, measured: Measurements, members: IntArray, given: Given, *, rng: np.random.Generator
) -> TemplateFit:
    """The fit to some points (m,), told of all."""
    chosen = members
    if len(members) > _MOST_POINTS:
        chosen = np.sort(rng.choice(members, _MOST_POINTS, replace=False))
    spacing = measured.spacing * np.sqrt(max(1.0, len(members) / max(len(chosen), 1)))
    part = replace(measured, points=measured.points[chosen], spacing=spacing, beam_of_point=None, faces=None)
    fit = _FITS[kind](part, given)
    assignment = np.zeros(len(measured.points), dtype=np.int64)
    if len(chosen) and fit.status is not FeatureStatus.NONE:
        _, nearest = cKDTree(measured.points[chosen]).query(measured.points[members])
        assignment[members] = fit.assignment[nearest]
    return replace(fit, assignment=assignment)


def _distinct(fits: Sequence[TemplateFit]) -> list[TemplateFit]:
    """Those whose joint is not that of one before."""
    kept: list[TemplateFit] = []
    for fit in fits:
        if not any(_are_same(fit, other) for other in kept):
            kept.append(fit)
    return kept


def _are_same(first: TemplateFit, second: TemplateFit) -> bool:
    """Whether two fits of a kind have their joints in one place."""
    if first.kind != second.kind:
        return False
    ends = [np.asarray(fit.geometry["joint"]) for fit in (first, second)]
    radii = [np.asarray(fit.geometry["radii"]) for fit in (first, second)]
    size = min(float(r[np.isfinite(r)].min()) for r in radii)
    if first.kind == "elbow":
        middles = [fit.x[3:6] for fit in (first, second)]
        return bool(np.linalg.norm(middles[0] - middles[1]) < 2 * limits.SAME_JOINT * size)
    axis = (ends[0][1] - ends[0][0]) / max(float(np.linalg.norm(ends[0][1] - ends[0][0])), 1e-300)
    gap = ends[1].mean(axis=0) - ends[0].mean(axis=0)
    across = float(np.linalg.norm(gap - (gap @ axis) * axis))
    length = float(np.linalg.norm(ends[0][1] - ends[0][0]) + np.linalg.norm(ends[1][1] - ends[1][0])) / 2
    return bool(across < limits.SAME_JOINT * size and abs(float(gap @ axis)) < length)
