# SPDX-License-Identifier: MIT
"""Criteria of the literature: the next views that others would choose from the same map and candidates.

Baselines for studies. They know what the online planner knows: the labels of the voxel map, the candidates in
known free space, the sensor. Only the choice of the view differs. Each is a short version, for this map, of
what was published; entropy, rear sides, proximity and covering follow the authors' public code:

* frontier: B. Yamauchi, "A frontier-based approach for autonomous exploration", CIRA 1997;
* average entropy: S. Kriegel, C. Rink, T. Bodenmueller, M. Suppa, "Efficient next-best-scan planning for
  autonomous 3D surface reconstruction of unknown objects", J. Real-Time Image Processing 2015;
* rear side voxels, proximity count: S. Isler, R. Sabzevari, J. Delmerico, D. Scaramuzza, "An information gain
  formulation for active volumetric 3D reconstruction", ICRA 2016; compared in J. Delmerico, S. Isler,
  R. Sabzevari, D. Scaramuzza, "A comparison of volumetric information gain metrics for active 3D object
  reconstruction", Autonomous Robots 2018;
* surface edges: R. Border, J. D. Gammell, P. Newman, "Surface Edge Explorer (SEE): planning next best views
  directly from 3D observations", ICRA 2018; R. Border, J. D. Gammell, "The Surface Edge Explorer (SEE): a
  measurement-direct approach to next best view planning", IJRR 2024;
* one-shot set cover: S. Pan, H. Hu, H. Wei, "SCVP: learning one-shot view planning via set covering for
  unknown object reconstruction", RA-L 2022.

Common to all, and not of these papers: a view's rays form a grid, and each counts by the solid angle that it
stands for, as if pixels had equal ones; unknown voxels that several views have not settled end rays and count
no more; a view that shows no unknown voxel is not taken, nor is one repeated at once, nor a position with a
single direction visited again; of equal scores the view that shows more unknown voxels is taken. None of
these criteria knows the required angle of incidence.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt
from scipy.sparse import csr_array, vstack
from scipy.spatial import cKDTree

from nbv.cover.instance import CoverInstance
from nbv.cover.pipeline import CoverOptions, find_cover
from nbv.online.gain import BestView, ViewEvaluation
from nbv.online.limits import FLATTEST
from nbv.online.occupancy import EMPTY, OCCLUDED, OCCPLANE, SEEN, VoxelMap
from nbv.online.voxel_walk import AROUND, MEASURED, PASSED, KnownSpace, Rays, Walked
from nbv.scanning.sensor import Sensor
from nbv.visibility.limits import SAME_M
from nbv.visibility.viewpoints import Candidates
from scenes.checks import BoolArray, FloatArray
from scenes.pose import Pose
from scenes.run.memory import threads

OCCUPANCY = np.array([0.12, 0.5, 0.97])
"""Probability that an empty, an unknown, a seen voxel is occupied. The map holds labels: these are the prior
in the code of Isler et al., and the bounds of its probabilities, which many rays reach."""
NEAREST_VOXELS = 30
"""Occluded voxels farther from seen surface count nothing for proximity: the 0.3 m of 1 cm voxels of the
authors' code."""
_AROUND_VOXELS = 3.0  # radius around a surfel in which the others tell whether it is at an edge
_EDGE_SHIFT = 0.3  # of it: at a straight edge the middle of a half disc is 0.42 off; at a crease, 0.21
_OTHER_SIDE = -0.5  # cosine of two normals below which one is that of the other side of a sheet
_MOST_EDGES = 2000  # edge points that views are compared by; above, every k-th
_SLACK_VOXELS = 2.0  # before a point of seen surface; its own voxel ends the ray
_POLISH_STEPS = 10_000
_BYTES_A_RAY = 400
_ENTROPY = -OCCUPANCY * np.log(OCCUPANCY) - (1 - OCCUPANCY) * np.log(1 - OCCUPANCY)  # nats

Score = tuple[FloatArray, FloatArray | None]
"""What each ray adds (n,) to the score of a view, and to what that is divided by; None for 1."""


def count_frontier(walked: Walked) -> Score:
    """Score a view by the frontier voxels (unknown, next to known empty space) that it sees, each once.

    Yamauchi (1997). Same: what a frontier is. Different: in three dimensions, and the view that sees most of
    it is taken, where the robot went to the nearest piece.
    """
    worth = np.zeros(len(walked.first))
    worth[_one_ray_each(walked)] = 1.0
    return worth, None


def average_entropy(walked: Walked) -> Score:
    """Score a view by the mean entropy of all voxels on its rays that end in seen surface.

    Kriegel et al. (2015), as Isler et al. (2016) compare it: the sum of -p ln p - (1 - p) ln (1 - p) over the
    voxels of the rays, divided by their number; rays that end in no occupied voxel are left out. Different: p
    is `OCCUPANCY` by label, for the map holds no probabilities; voxels outside the volume are not counted.
    """
    ends = np.where(walked.end >= 0, walked.rays.solid_angle, 0.0)
    return ends * (walked.n_passed * _ENTROPY).sum(axis=1), ends * walked.n_passed.sum(axis=1)


def count_rear_sides(walked: Walked) -> Score:
    """Score a view by its rays that meet seen surface out of an unknown voxel: from its rear.

    Isler et al. (2016), "rear side voxel": 1 for an occupied voxel right behind an unknown one, 0 otherwise,
    summed over the rays up to the first occupied voxel. Same.
    """
    return walked.rays.solid_angle * walked.is_rear, None


def count_proximity(walked: Walked) -> Score:
    """Score a view by the occluded voxels on its rays, more for those close to seen surface.

    Isler et al. (2016), "proximity count": d_max - d for each unobserved voxel in a shadow, summed over the
    voxels of the rays up to the first occupied one. Different: d is the distance to the nearest seen voxel,
    not that along the ray of the scan which cast the shadow.
    """
    return walked.rays.solid_angle * walked.nearness, None


RAY_CRITERIA: Mapping[str, Callable[[Walked], Score]] = {
    "frontier": count_frontier,
    "entropy": average_entropy,
    "rear-side": count_rear_sides,
    "proximity": count_proximity,
}
CRITERIA = (*RAY_CRITERIA, "surface-edge", "set-cover")


def choose_views(
    criterion: str,
    voxels: VoxelMap,
    candidates: Candidates,
    here: Pose,
    *,
    sensor: Sensor,
    counts: BoolArray,
    least_m2: float,
    n_threads: int | None = None,
) -> tuple[BestView, ...]:
    """Return the view that a criterion takes next, nothing where none shows what is unknown.

    "set-cover" returns all the views that it takes, in their order.

    Parameters
    ----------
    criterion : str
        One of `CRITERIA`.
    candidates : Candidates
        Positions that are free, and directions.
    here : Pose
        Where the sensor stands.
    counts : (2, n_voxels) bool
        In which voxels the edge of seen surface (0) and unknown space (1) are still sought.
    least_m2 : float
        Views that show a smaller area of unknown voxels are not worth a scan, square metres.
    n_threads : int, optional
        Threads; the result does not depend on it.
    """
    if candidates.n_directions == 1:
        offsets = candidates.positions[:, None] - voxels.stood
        candidates = candidates.at((np.linalg.norm(offsets, axis=2) > SAME_M).all(axis=1))
    if not candidates.n_poses:
        return ()
    if criterion == "surface-edge":
        best = nearest_view_of_edges(
            voxels, candidates, here, sensor=sensor, counts=counts[0], n_threads=n_threads
        )
        return () if best is None else (best,)
    nearness = nearness_to_surface(voxels) if criterion == "proximity" else None
    views = ViewRays.of(KnownSpace.of(voxels, counts[1], nearness), candidates, sensor)
    with threads(_BYTES_A_RAY * len(AROUND.solid_angle), n_threads) as pool:
        each = range(candidates.n_positions)
        if criterion == "set-cover":
            rows = list(pool.map(views.shown_by, each))
            chosen = cover_at_once(vstack(rows, format="csr"), least_m2 / voxels.grid.voxel_m**2)
            return tuple(views.evaluate(number) for number in chosen)
        scored = list(pool.map(partial(views.score, RAY_CRITERIA[criterion]), each))
    scores, shown = (np.concatenate(parts) for parts in zip(*scored, strict=True))
    shown[_is_pose(candidates, here).ravel()] = 0
    worthwhile = np.flatnonzero((shown > 0) & (shown * voxels.grid.voxel_m**2 >= least_m2))
    if not len(worthwhile):
        return ()
    order = np.lexsort((-shown[worthwhile], -scores[worthwhile]))
    return (views.evaluate(int(worthwhile[order[0]])),)


def _is_pose(candidates: Candidates, here: Pose) -> BoolArray:
    """Tell which candidates, (n_positions, n_directions), are the pose `here`."""
    at = np.linalg.norm(candidates.positions - here.translation, axis=1) <= SAME_M
    along = candidates.directions @ here.rotation[:, 2] > 1 - SAME_M
    return np.asarray(along & at[:, None])


@dataclass(frozen=True, slots=True, eq=False)
class ViewRays:
    """Candidate views of a space, and which of a position's rays lie in the aperture of each of its views.

    `around` (n_directions, n_rays) tells that for rays all around where directions are shared.
    """

    space: KnownSpace
    candidates: Candidates
    sensor: Sensor
    around: csr_array | None

    @classmethod
    def of(cls, space: KnownSpace, candidates: Candidates, sensor: Sensor) -> ViewRays:
        """Return the views of a space."""
        shared = candidates.directions.ndim == 2
        around = _in_apertures(AROUND, candidates.rotations(), sensor) if shared else None
        return cls(space, candidates, sensor, around)

    def walk(self, position: int) -> tuple[Walked, csr_array]:
        """Return what the rays of a position pass, and which are in the aperture of each direction (d, n)."""
        place = self.candidates.positions[position]
        rays = Rays.into(self.space.grid, place)
        walked = self.space.walk(place, rays, self.sensor.max_range_m)
        if rays is AROUND and self.around is not None:
            return walked, self.around
        return walked, _in_apertures(rays, self.candidates.rotations_at(position), self.sensor)

    def score(self, criterion: Callable[[Walked], Score], position: int) -> tuple[FloatArray, FloatArray]:
        """Return the scores (d,) of a position's views, and how many unknown voxels (d,) each shows."""
        walked, inside = self.walk(position)
        worth, of = criterion(walked)
        scores = inside @ worth
        if of is not None:
            parts = inside @ of
            scores = np.divide(scores, parts, out=np.zeros(len(parts)), where=parts > 0)
        return scores, inside @ count_frontier(walked)[0]

    def shown_by(self, position: int) -> csr_array:
        """Return which unknown voxels each view of a position shows, (d, n_voxels)."""
        walked, inside = self.walk(position)
        chosen = _one_ray_each(walked)
        rows = inside[:, chosen]
        n_voxels = self.space.grid.n_voxels
        return csr_array(
            (rows.data, walked.first[chosen][rows.indices], rows.indptr), shape=(rows.shape[0], n_voxels)
        )

    def evaluate(self, number: int) -> BestView:
        """Return pose `number`, the unknown voxels that it shows, and their area: one face each."""
        position, direction = divmod(number, self.candidates.n_directions)
        walked, inside = self.walk(position)
        chosen = _one_ray_each(walked)
        chosen = chosen[
            np.isin(chosen, inside.indices[inside.indptr[direction] : inside.indptr[direction + 1]])
        ]
        side = self.space.grid.voxel_m
        offsets = walked.rays.directions[chosen] * (walked.away[chosen] * side)[:, None]
        return _view(self.candidates.pose(number), offsets, walked.first[chosen], side**2, is_unknown=True)


def _in_apertures(rays: Rays, rotations: FloatArray, sensor: Sensor) -> csr_array:
    """Return 1 where a ray lies in the aperture of a direction, (d, n)."""
    return csr_array(
        np.array([sensor.sees(rays.directions @ rotation) for rotation in rotations], np.float64)
    )


def _one_ray_each(walked: Walked) -> NDArray[np.int64]:
    """Numbers (m,) of rays that meet an unknown voxel first: one of them for each such voxel."""
    rays = np.flatnonzero(walked.is_unknown)
    return rays[np.unique(walked.first[rays], return_index=True)[1]]


def _view(
    pose: Pose, offsets: FloatArray, voxel: NDArray[np.int64], area_m2: float, *, is_unknown: bool
) -> BestView:
    """Return the view from which voxels (n,) are seen at `offsets` (n, 3), each worth an area."""
    worth, which = np.full(len(voxel), area_m2), np.full(len(voxel), is_unknown)
    sees = ViewEvaluation(
        offsets=offsets,
        worth_m2=worth,
        voxel=voxel,
        is_unknown=which,
        share=np.ones(len(voxel)),
    )
    return BestView(pose, float(worth.sum()), sees)


def nearness_to_surface(voxels: VoxelMap) -> NDArray[np.float32]:
    """Return d_max - d for each occluded voxel (nx, ny, nz), d being its distance to seen surface; 0 beyond.

    In sides of a voxel; d_max is `NEAREST_VOXELS`.
    """
    seen = (voxels.labels == SEEN).reshape(voxels.grid.shape)
    if not seen.any():
        return np.zeros(seen.shape, np.float32)
    near = np.maximum(NEAREST_VOXELS - distance_transform_edt(~seen), 0.0)
    hidden = np.isin(voxels.labels, (OCCLUDED, OCCPLANE)).reshape(seen.shape)
    return np.where(hidden, near, 0.0).astype(np.float32)


def cover_at_once(shown: csr_array, least: float) -> tuple[int, ...]:
    """Return few views that together show every unknown voxel that any view shows: largest gain first.

    Pan et al. (2022): predict once, cover all, go to all views without planning anew. Same: that, and the
    covering problem. Different: they train a network to predict the views; here the boundary of the unknown
    space after the first scan stands for the surface behind it. They order the views by a shortest path.

    Parameters
    ----------
    shown : (n_poses, n_voxels) csr
        Which view shows which unknown voxel.
    least : float
        Views that add fewer voxels are left out.
    """
    instance = CoverInstance(shown, np.ones(shown.shape[1]))
    chosen = find_cover(instance, CoverOptions(polish_steps=_POLISH_STEPS), rng=0).chosen
    known, kept = np.zeros(shown.shape[1], np.bool_), list[int]()
    for number in chosen:
        seen = instance.seen_by(number)
        if np.count_nonzero(~known[seen]) >= max(least, 1.0):
            kept.append(number)
            known[seen] = True
    return tuple(kept)


def edges_of_surface(voxels: VoxelMap, counts: BoolArray) -> NDArray[np.int64]:
    """Numbers (m,) of the surfels at the edge of seen surface, in voxels that count (n_voxels,).

    The surfels around one at an edge lie off to one side in its tangent plane; on the other side, or a voxel
    behind, unknown space begins.
    """
    surfels, side = voxels.surfels, voxels.grid.voxel_m
    n, radius = len(surfels.keys), _AROUND_VOXELS * side
    pairs = cKDTree(surfels.points).query_pairs(radius, output_type="ndarray").reshape(-1, 2)
    one, other = np.concatenate([pairs, pairs[:, ::-1]]).T
    same = np.einsum("ij,ij->i", surfels.normals[one], surfels.normals[other]) > _OTHER_SIDE
    one, other = one[same], other[same]
    offsets = surfels.points[other] - surfels.points[one]
    sums = np.stack([np.bincount(one, offsets[:, axis], n) for axis in range(3)], axis=1)
    shift = sums / (1 + np.bincount(one, minlength=n))[:, None]
    shift -= np.einsum("ij,ij->i", shift, surfels.normals)[:, None] * surfels.normals
    length = np.linalg.norm(shift, axis=1)
    edges = np.flatnonzero((length > _EDGE_SHIFT * radius) & counts[surfels.voxels])
    onward = -shift[edges] / length[edges, None]
    unknown, is_unknown = np.zeros(len(edges), np.bool_), ~np.isin(voxels.labels, (EMPTY, SEEN))
    for ahead, behind in product(range(1, int(_AROUND_VOXELS) + 1), range(2)):
        place = surfels.points[edges] + side * (ahead * onward - behind * surfels.normals[edges])
        cell = voxels.grid.index_of(place)
        unknown |= (cell >= 0) & is_unknown[cell]
    return edges[unknown]


def nearest_view_of_edges(
    voxels: VoxelMap,
    candidates: Candidates,
    here: Pose,
    *,
    sensor: Sensor,
    counts: BoolArray,
    n_threads: int | None = None,
) -> BestView | None:
    """Return the nearest of the views that look straight at a point on the edge of seen surface, or None.

    Border et al. (2018): seen surface is explored along its edge; each edge point proposes a view along the
    surface normal, and of all proposals the nearest is taken. Same: that, and that many small steps save way,
    not views. Different: an edge is where surfels end before unknown space, not where the density of points
    drops; the proposal is the candidate that sees the point most nearly along its normal; of equally near
    ones, that which sees most edge points is taken. As in later versions, seen surface hides points; unknown
    space does not.

    Parameters
    ----------
    counts : (n_voxels,) bool
        Edges in other voxels were tried in vain.
    """
    edges = edges_of_surface(voxels, counts)
    edges = edges[:: max(-(-len(edges) // _MOST_EDGES), 1)]
    if not len(edges):
        return None
    surfels, side = voxels.surfels, voxels.grid.voxel_m
    points = surfels.points[edges]
    seen_alone = np.where(voxels.labels == SEEN, MEASURED, PASSED).astype(np.int8)
    shape = voxels.grid.shape
    space = KnownSpace(voxels.grid, seen_alone.reshape(shape), np.zeros(shape, np.float32))
    look = partial(
        _straightness, points, surfels.normals[edges], space=space, candidates=candidates,
        taken=_is_pose(candidates, here), sensor=sensor,
    )  # fmt: skip
    with threads(_BYTES_A_RAY * len(edges), n_threads) as pool:
        cosine, direction = map(np.array, zip(*pool.map(look, range(candidates.n_positions)), strict=True))
    proposals = np.flatnonzero(cosine.max(axis=0) > 0)
    if not len(proposals):
        return None
    straightest = cosine[:, proposals].argmax(axis=0)
    numbers = np.unique(straightest * candidates.n_directions + direction[straightest, proposals])
    places = candidates.positions[numbers // candidates.n_directions]
    way = np.linalg.norm(places - here.translation, axis=1)
    found = list[BestView]()
    for number in numbers[way <= way.min() + SAME_M].tolist():
        pose, seen = candidates.pose(number), cosine[number // candidates.n_directions] > 0
        offsets = points - pose.translation
        seen &= sensor.sees(offsets @ pose.rotation)
        found.append(_view(pose, offsets[seen], surfels.voxels[edges[seen]], side**2, is_unknown=False))
    return max(found, key=lambda view: view.gain_m2)


def _straightness(
    points: FloatArray,
    normals: FloatArray,
    position: int,
    *,
    space: KnownSpace,
    candidates: Candidates,
    taken: BoolArray,
    sensor: Sensor,
) -> tuple[FloatArray, NDArray[np.int64]]:
    """Return the cosine (m,) at which a position sees points (m, 3), 0 where it does not, and the direction.

    Of the position's directions that are not `taken` (n_positions, n_directions), the one that looks most
    nearly at the point.
    """
    towards = points - candidates.positions[position]
    away = np.maximum(np.linalg.norm(towards, axis=1), SAME_M)
    rays = Rays(towards / away[:, None], np.zeros(len(points)))
    cosine = -np.einsum("ij,ij->i", rays.directions, normals)
    walked = space.walk(candidates.positions[position], rays, sensor.max_range_m)
    free = walked.away * space.grid.voxel_m >= away - _SLACK_VOXELS * space.grid.voxel_m
    rotations = candidates.rotations_at(position)
    aims = np.where(taken[position], -np.inf, rays.directions @ rotations[:, :, 2].T)
    direction = aims.argmax(axis=1)
    inside = sensor.sees(np.einsum("mi,mij->mj", rays.directions, rotations[direction]))
    inside &= (away >= sensor.min_range_m) & (away <= sensor.max_range_m) & np.isfinite(aims.max(axis=1))
    return np.where(free & inside & (cosine >= FLATTEST), cosine, 0.0), direction
