# SPDX-License-Identifier: MIT
"""Network: the poses of a group of scans by all that they share, and the covariance of these.

Adjustment: poses of a group and the planes that its scans share, estimated together.
A plane is one surface of all scans that saw it, so that what two rooms say of the wall between them does not
go through a chain of poses. Of its pixels only sums count: their misfit under any small motion is quadratic.
After G. Ferrer, "Eigen-Factors: plane estimation for multi-frame and time-continuous point cloud alignment",
IROS 2019: planes are put where they fit best, and what that leaves settles the poses.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial.transform import Rotation

from completion.observe.sensor_modes import N_MODES, displacements
from completion.registration import limits
from completion.registration.hypotheses import Hypothesis, best_of, distinct, scores_of
from completion.registration.motions import STILL, compose, in_units, inverse, perturb
from completion.registration.refinement import (
    Link,
    MotionEquations,
    PlacedScan,
    links_of,
    normal_equations,
    solve_ridge,
)
from completion.registration.station_view import StationView
from completion.registration.verdict import Judgement, Verdict, is_approved, judge
from scenes.checks import BoolArray, FloatArray, IntArray, Value

Pair = tuple[int, int]
_Scans = tuple[int, ...]
Hypotheses = Mapping[Pair, Sequence[Hypothesis]]
"""By the numbers of two scans, the smaller first: motions of the second into the frame of the first."""


@dataclass(frozen=True, slots=True, eq=False)
class ScanGroup(Value):
    """Scans that are placed to each other: by the number of each its pose (3, 4) in the group's frame."""

    poses: Mapping[int, FloatArray]

    @property
    def scans(self) -> tuple[int, ...]:
        """The numbers of its scans, in order. In one run no two groups have the same."""
        return tuple(sorted(self.poses))

    def place(self, views: Sequence[StationView]) -> list[PlacedScan]:
        """Return its scans where they stand."""
        return [PlacedScan(views[number], pose) for number, pose in self.poses.items()]

    def join(self, other: ScanGroup, motion: FloatArray) -> ScanGroup:
        """Return both together; `motion` (3, 4) leads out of the other's frame."""
        poses = {**self.poses, **{number: compose(motion, pose) for number, pose in other.poses.items()}}
        return ScanGroup(dict(sorted(poses.items())))


@dataclass(frozen=True, slots=True, eq=False)
class _Joint:
    """What is known of two groups' pose to each other."""

    hypotheses: Sequence[Hypothesis]
    judgement: Judgement

    @property
    def lead(self) -> float:
        """By how much the best one leads; below zero where nothing is claimed."""
        if self.judgement.verdict is not Verdict.REGISTERED:
            return -1.0
        second = self.hypotheses[1].score if len(self.hypotheses) > 1 else 0.0
        return self.hypotheses[0].score - max(second, 0.0)


def group_scans(
    views: Sequence[StationView],
    pairs: Hypotheses,
    level: float,
    settle: Callable[[ScanGroup], ScanGroup],
    groups: Iterable[ScanGroup] = (),
) -> list[ScanGroup]:
    """Return the scans in groups, each with the poses that were claimed.

    All scans begin by themselves, but for `groups` that are given. Of all pairs of groups those join whose
    best motion leads most, among those that may be claimed at `level`: motions come from the hypotheses of
    all pairs of scans across, and all scans across judge them. After each, `settle` brings a group's scans
    together by all that they share.
    """
    standing = list(groups)
    known = {number for group in standing for number in group.poses}
    standing += [ScanGroup({number: STILL}) for number in range(len(views)) if number not in known]
    joints: dict[tuple[_Scans, _Scans], _Joint] = {}
    while len(standing) > 1:
        for first_group, two in combinations(standing, 2):
            if (first_group.scans, two.scans) not in joints:
                joints[first_group.scans, two.scans] = _joint(first_group, two, views, pairs, level)
        ranked = sorted(
            ((joints[group.scans, two.scans].lead, group, two) for group, two in combinations(standing, 2)),
            key=lambda each: (-each[0], each[1].scans, each[2].scans),
        )
        lead, first_group, two = ranked[0]
        if lead < 0:
            break
        joined = settle(first_group.join(two, joints[first_group.scans, two.scans].hypotheses[0].motion))
        standing = sorted(
            [*(group for group in standing if group is not first_group and group is not two), joined],
            key=lambda group: group.scans,
        )
    return standing


def _joint(
    group: ScanGroup, two: ScanGroup, views: Sequence[StationView], pairs: Hypotheses, level: float
) -> _Joint:
    """Judge the motions of one group to another that pairs of their scans propose."""
    stay, move = group.place(views), two.place(views)
    motions = [
        compose(compose(pose_a, motion), inverse(pose_b))
        for a, pose_a in group.poses.items()
        for b, pose_b in two.poses.items()
        for motion in _motions(pairs, a, b)
    ]
    if not motions:
        return _Joint((), judge((), level))
    if len(group.poses) == len(two.poses) == 1:
        (a,), (b,) = group.poses, two.poses
        best: Sequence[Hypothesis] = pairs[a, b]
    else:
        several = np.array(motions)
        scores = scores_of(stay, move, several, limits.MIDDLE_M, limits.VIOLATION)
        best = best_of(stay, move, distinct(several, scores, move, limits.N_JOINT))
        images = [
            compose(compose(pose_a, motion), inverse(pose_b))
            for a, pose_a in group.poses.items()
            for b, pose_b in two.poses.items()
            for motion in _motions(_alike(pairs), a, b)
        ]
        best = _mark_images(best, images, move)
    return _Joint(best, judge(best, level))


def _alike(pairs: Hypotheses) -> Hypotheses:
    """Of each pair the poses that are images of each other."""
    return {
        pair: [several[0], *(hypothesis for hypothesis in several if hypothesis.is_image)]
        for pair, several in pairs.items()
        if any(hypothesis.is_image for hypothesis in several)
    }


def _mark_images(
    hypothesis: Sequence[Hypothesis], images: Sequence[FloatArray], move: Sequence[PlacedScan]
) -> list[Hypothesis]:
    """The hypotheses of two groups; those that are images of the first one, for some pair across, say so."""
    if not images:
        return list(hypothesis)

    def is_alike(motion: FloatArray) -> bool:
        return any(len(distinct(np.array([motion, other]), np.zeros(2), move, 2)) == 1 for other in images)

    flag = is_alike(hypothesis[0].motion)
    return [
        replace(
            hypothesis, is_image=flag and k > 0 and is_approved(hypothesis) and is_alike(hypothesis.motion)
        )
        for k, hypothesis in enumerate(hypothesis)
    ]


def _motions(pairs: Hypotheses, a: int, b: int) -> list[FloatArray]:
    """The motions (3, 4) of scan b into the frame of scan a that are proposed."""
    if a < b:
        return [hypothesis.motion for hypothesis in pairs.get((a, b), ())]
    return [inverse(hypothesis.motion) for hypothesis in pairs.get((b, a), ())]


Surface = list[tuple[int, int]]
"""By the places of scans in their group, and the numbers of their planes: the planes that are one surface."""


def adjust_poses(
    poses: Sequence[FloatArray], views: Sequence[StationView], links: Sequence[Link]
) -> list[FloatArray]:
    """Return poses (3, 4) of n scans that their planes and themselves make most probable; the first stays.

    Facets that met and lie in no plane that both scans share count by pairs, as they do without planes.
    """
    labels = [_labels(link, poses, views) for link in links]
    surfaces = _surfaces(links, labels)
    surface_of = {member: number for number, several in enumerate(surfaces) for member in several}
    besides = [
        _without(link, ~_are_shared(link, label, surface_of))
        for link, label in zip(links, labels, strict=True)
    ]
    fixed, pull = normal_equations(besides, len(poses))
    now, change = list(poses), np.zeros(6 * len(poses))
    for _ in range(limits.N_ROUNDS_PLANES):
        matrix, vector = fixed.copy(), pull + fixed @ change
        for several in surfaces:
            _add(matrix, vector, several, now, views)
        step = -solve_ridge(matrix[6:, 6:], vector[6:])
        change[6:] += step
        for k, values in enumerate(step.reshape(-1, 6), start=1):
            now[k] = perturb(now[k], values, now[k][:, 3])
        if np.abs(step).max(initial=0.0) < limits.STILL_PLANES:
            break
    return now


def _labels(link: Link, poses: Sequence[FloatArray], views: Sequence[StationView]) -> IntArray:
    """The plane of either scan (2, m) that each place where they met lies in; -1 for none."""
    labels = []
    for k in (link.first, link.second):
        planes, pose = views[k].planes, poses[k]
        places = (link.equations.places - pose[:, 3]) @ pose[:, :3]
        normals = link.equations.growth[:, 3:] @ pose[:, :3]
        off = np.abs(places @ planes.normals.T - planes.heights)
        off[np.abs(normals @ planes.normals.T) < limits.PARALLEL] = np.inf
        if not off.shape[1]:
            labels.append(np.full(len(places), -1))
            continue
        best = off.argmin(axis=1)
        labels.append(np.where(off[np.arange(len(off)), best] < limits.SAME_PLANE_M, best, -1))
    return np.array(labels)


def _surfaces(links: Sequence[Link], labels: Sequence[IntArray]) -> list[Surface]:
    """The planes that are one surface, since facets of them met, of two scans at least each."""
    met: dict[tuple[tuple[int, int], tuple[int, int]], int] = defaultdict(int)
    for link, (first, two) in zip(links, labels, strict=True):
        pairs, counts = np.unique(
            np.stack([first, two])[:, (first >= 0) & (two >= 0)], axis=1, return_counts=True
        )
        for (p, q), count in zip(pairs.T.tolist(), counts.tolist(), strict=True):
            if count >= limits.LEAST_FOR_MOTION:
                met[(link.first, p), (link.second, q)] += count
    nodes = sorted({node for pair in met for node in pair})
    number = {node: k for k, node in enumerate(nodes)}
    ends = np.array([[number[numbers], number[two]] for numbers, two in met]).reshape(-1, 2)
    graph = coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(len(nodes), len(nodes)))
    count, component = connected_components(graph, directed=False) if nodes else (0, np.zeros(0))
    return [[node for node, label in zip(nodes, component, strict=True) if label == k] for k in range(count)]


def _are_shared(link: Link, indices: IntArray, surface_of: dict[tuple[int, int], int]) -> BoolArray:
    """Whether each place (m,) where two scans met lies in planes that are one surface."""
    first, two = (
        np.array([surface_of.get((k, p), -1) for p in labels_of_scan.tolist()], dtype=np.int64)
        for k, labels_of_scan in zip((link.first, link.second), indices, strict=True)
    )
    return np.asarray((first >= 0) & (first == two))


def _without(link: Link, kept: BoolArray) -> Link:
    """A link with some of its equations alone."""
    equations = type(link.equations)(*(values[kept] for values in link.equations))
    return link._replace(equations=equations, growth=link.growth[kept])


def _add(
    matrix: FloatArray,
    vector: FloatArray,
    several: Surface,
    poses: Sequence[FloatArray],
    views: Sequence[StationView],
) -> None:
    """Add what planes that are one surface tell of turns and shifts, the surface being where it fits best.

    A pixel x of a scan at pose (R, t) is off by n . (R x + t) + d. A turn w about the scan's place and
    a shift s change that by w . (R x x n) + s . n, another surface by its own (n, d) . (R x + t, 1).
    """
    scatters = {}
    for k, plane in several:
        lift = np.eye(4)
        lift[:3] = poses[k]
        share = min(1.0, limits.INDEPENDENT / max(views[k].planes.n_pixels, 1))
        scatters[k, plane] = share * lift @ views[k].planes.scatter[plane] @ lift.T
    total = np.sum(list(scatters.values()), axis=0)
    middle = total[:3, 3] / total[3, 3]
    axes = np.linalg.eigh(total[:3, :3] - total[3, 3] * np.outer(middle, middle))[1]
    normal = axes[:, 0]
    surface = np.append(normal, -normal @ middle)
    free = np.eye(4)[:, 1:]  # what another surface adds to (n, d)
    free[:3, :2] = axes[:, 1:]
    sides = np.zeros((len(matrix), 3))
    for (k, _), scatter in scatters.items():
        growth = np.zeros((4, 6))
        growth[:3, :3] = np.cross(np.eye(3), normal)
        growth[3, :3] = np.cross(normal, poses[k][:, 3])
        growth[3, 3:] = normal
        columns = slice(6 * k, 6 * k + 6)
        matrix[columns, columns] += growth.T @ scatter @ growth
        vector[columns] += growth.T @ scatter @ surface
        sides[columns] += growth.T @ scatter @ free
    matrix -= sides @ np.linalg.solve(free.T @ total @ free, sides.T)


@dataclass(frozen=True, slots=True, eq=False)
class NetworkEdge(Value):
    """Two scans of a group that share surface.

    Attributes
    ----------
    scans : (int, int)
        Their numbers.
    n_met : int
        Facets that met.
    rms_m : float
        Root mean square by which these lie apart, robust, metres.
    """

    scans: tuple[int, int]
    n_met: int
    rms_m: float


@dataclass(frozen=True, slots=True, eq=False)
class Network(Value):
    """A group as all that its scans share settles it.

    Attributes
    ----------
    group : ScanGroup
        The poses, relative to the first scan.
    covariance : (6 n, 6 n) float
        Of turns (radians) and shifts (metres) of the scans in their order, each about the scan's own place,
        axes of the group; zeros for the first. It holds the noise, and what errors of the sensor do that
        all scans have in common.
    edges : tuple of NetworkEdge
        The pairs that share surface.
    """

    group: ScanGroup
    covariance: FloatArray
    edges: tuple[NetworkEdge, ...]

    def in_metres(self, unit_m: float) -> Network:
        """Return the same in metres whose lengths were in units of `unit_m`."""
        scale = np.tile([1.0] * 3 + [unit_m] * 3, len(self.group.poses))
        poses = {number: in_units(pose, 1.0 / unit_m) for number, pose in self.group.poses.items()}
        edges = tuple(replace(edge, rms_m=unit_m * edge.rms_m) for edge in self.edges)
        return Network(ScanGroup(poses), self.covariance * np.outer(scale, scale), edges)


def settle_group(group: ScanGroup, views: Sequence[StationView], *, by_planes: bool = False) -> Network:
    """Bring the scans of a group together by point-to-plane least squares over all pairs at once.

    The first scan stays. Offsets are weighted by their variance and robustly; facets of a pair tell as much
    as twenty independent ones at most. What bends a whole image, or scales it, is alike in all scans: its
    modes (`completion.observe.sensor_modes`) are followed through the least squares. With `by_planes`, planes
    that scans share are estimated together with the poses, which halves the errors of scans of flat walls;
    that is kept where both answers agree within what facets leave open.
    """
    numbers = sorted(group.poses)
    back = inverse(group.poses[numbers[0]])
    poses = [compose(back, group.poses[number]) for number in numbers]
    n = len(numbers)
    matrix: FloatArray = np.zeros((6 * n, 6 * n))
    links: list[Link] = []
    for number in range(limits.N_ROUNDS):
        gate = limits.NETWORK_GATES_M[min(number, len(limits.NETWORK_GATES_M) - 1)]
        links = links_of(numbers, poses, views, gate)
        matrix, vector = normal_equations(links, n)
        change = -solve_ridge(matrix[6:, 6:], vector[6:]).reshape(-1, 6)
        for k, step in enumerate(change, start=1):
            poses[k] = perturb(poses[k], step, poses[k][:, 3])
        if number >= len(limits.NETWORK_GATES_M) and np.abs(change).max(initial=0.0) < limits.SMALL_STEP:
            break
    if by_planes and n > 1:
        poses = _if_alike(adjust_poses(poses, [views[k] for k in numbers], links), poses, matrix)
    covariance = np.zeros((6 * n, 6 * n))
    if n > 1:
        known = np.linalg.pinv(matrix[6:, 6:], rcond=1e-12, hermitian=True)
        by_sensors = known @ _pull_of_sensors(links, n)[6:]
        covariance[6:, 6:] = known + by_sensors @ by_sensors.T
    edges = tuple(
        NetworkEdge(
            (numbers[link.first], numbers[link.second]), len(link.equations.offset), _rms(link.equations)
        )
        for link in links
    )
    return Network(ScanGroup(dict(zip(numbers, poses, strict=True))), covariance, edges)


def _if_alike(
    efficient: Sequence[FloatArray], safe: Sequence[FloatArray], matrix: FloatArray
) -> list[FloatArray]:
    """Poses that suppose more than others, where both differ by no more than chance makes them.

    `matrix` (6 n, 6 n) is the inverse covariance of the safe ones. Where what the others suppose holds, that
    planes are flat and one surface, their difference has less variance than the safe ones themselves: J. A.
    Hausman, "Specification tests in econometrics", Econometrica 1978.
    """
    change = np.concatenate(
        [
            [*Rotation.from_matrix(first[:, :3] @ two[:, :3].T).as_rotvec(), *(first[:, 3] - two[:, 3])]
            for first, two in zip(efficient, safe, strict=True)
        ]
    )
    return list(efficient if change @ matrix @ change <= len(change) - 6 else safe)


def _pull_of_sensors(links: Sequence[Link], n: int) -> FloatArray:
    """What each mode of the sensors' errors adds to the right side (6 n, k), the same mode in all scans."""
    pull = np.zeros((6 * n, N_MODES))
    for link in links:
        normals, places = link.equations.growth[:, 3:], link.equations.places
        apart = np.zeros((N_MODES, len(places)))
        for placed, sign in ((link.b, 1.0), (link.a, -1.0)):
            turn = placed.pose[:, :3]
            places_here = (places - placed.pose[:, 3]) @ turn
            moves = displacements(placed.view.seen, places_here) @ turn.T
            apart += sign * np.einsum("mij,ij->mi", moves, normals)
        pull[link.columns] += link.growth.T @ (link.equations.weight * apart).T
    return pull


def _rms(equations: MotionEquations) -> float:
    return 1.4826 * float(np.median(np.abs(equations.offset)))
