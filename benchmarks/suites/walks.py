# SPDX-License-Identifier: MIT
"""A spinning lidar carried through a house, by stretches of several lengths, beside panoramas of stations."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from benchmarks.cases.frames import WALKS, walk
from benchmarks.cases.rooms import hypothesis_of
from benchmarks.cases.spinning import SpinningLidar, TimedPoints, carry
from benchmarks.metrics.free_space import violation_of_beams
from benchmarks.metrics.inferred import sample
from benchmarks.metrics.other_scans import is_there
from benchmarks.run import head, row, suite
from benchmarks.store import each, measured
from benchmarks.suites.ledger import CELL_M
from completion import CompletionOptions, complete
from scenes.checks import FloatArray
from scenes.io.point_files import PointCloud
from scenes.io.track import Trajectory
from scenes.io.walk import Walk, walk_of
from scenes.pose import Pose
from scenes.rays.raycast import RayCaster
from scenes.scan.projection import SphericalProjection
from scenes.scan.range_image import RangeImage

SPEED_M_S, LIDAR = 1.2, SpinningLidar()
_TRACK_HZ = 100.0
_NEAR_M, _APART_M, _VOXEL_M = 0.06, 0.1, 0.05
_STATION = SphericalProjection.regular(1800, 800, 360.0, (-60.0, 90.0))
CROSSED_CELL_M, N_PLANES = 0.05, 8
_ALL_ROUND = SphericalProjection.regular(720, 360, 360.0, (-89.0, 89.0))


class Outcome(NamedTuple):
    """What came of one set of scans of the house."""

    name: str
    stretch_m: float  # NaN for stations
    n_scans: int
    n_points: int  # in the scans
    measured_m2: float
    right_m2: float
    wrong_m2: float
    known: float  # share of reference points that were measured or inferred
    found: float  # share of those not measured that were inferred
    crossed_m2: float  # inferred area that beams of the scans, from their own origins, went through
    crossed_by_all_m2: float  # the same of all beams of the walk
    cpu_s: float
    peak_mb: float


def path_through(seconds: float) -> FloatArray:
    """Places (n, 3) along the walk through the lower storey of the duplex, metres."""
    one, n = WALKS[0], int(20 * SPEED_M_S * seconds)
    places = np.array([pose.translation for pose in walk(one.caster, np.array(one.start), n)])
    moved = np.linalg.norm(np.diff(places, axis=0), axis=1) > 0
    return np.asarray(places[np.append(True, moved)])


def walked(seconds: float, seed: int = 0) -> tuple[TimedPoints, Trajectory]:
    """The points of the walk, and its trajectory."""
    path = path_through(seconds)
    caster = WALKS[0].caster

    def cast(origins: FloatArray, rays: FloatArray) -> FloatArray:
        return caster.first_hit(origins, rays).ranges

    held = carry(LIDAR, cast, path, speed_m_s=SPEED_M_S, seconds=seconds, rng=np.random.default_rng(seed))
    times = np.arange(0.0, seconds + 1 / _TRACK_HZ, 1 / _TRACK_HZ)
    length = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1)))
    places = np.stack([np.interp(times * SPEED_M_S, length, axis) for axis in path.T], axis=-1)
    return held, Trajectory(times, places)


def _stations(path: FloatArray, seconds: float, n: int, seed: int) -> list[RangeImage]:
    """Panoramas from n places along the walk, with the noise of the lidar."""
    rng, scans = np.random.default_rng(seed), []
    n_walked = int(
        np.searchsorted(np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1)), SPEED_M_S * seconds)
    )
    for k in np.linspace(0, n_walked, n + 1)[:-1].astype(int):
        scan = _panorama(WALKS[0].caster, path[k], _STATION)
        noisy = scan.ranges + LIDAR.sigma_m * rng.normal(size=scan.shape)
        scans.append(RangeImage(noisy, scan.projection, scan.world_from_sensor, sigma_m=LIDAR.sigma_m))
    return scans


def _panorama(caster: RayCaster, place: FloatArray, projection: SphericalProjection) -> RangeImage:
    pose = Pose.looking_at(place, place + [1.0, 0.0, 0.0])
    rays = pose.rotate(projection.directions().reshape(-1, 3))
    ranges = caster.first_hit(np.repeat(place[None], len(rays), axis=0), rays).ranges
    return RangeImage(ranges.reshape(projection.shape), projection, pose)


def _reference(path: FloatArray) -> FloatArray:
    """Points (n, 3), one in each voxel of 5 cm, of what is seen from along the walk, all round."""
    scans = [_panorama(WALKS[0].caster, place, _ALL_ROUND) for place in path[::10]]
    points = np.concatenate([scan.points()[scan.valid] for scan in scans])
    _, first = np.unique(np.floor(points / _VOXEL_M).astype(np.int64), axis=0, return_index=True)
    return points[first]


def _outcome(
    name: str, scans: Sequence[RangeImage], path: FloatArray, beams: TimedPoints, held: Walk | None
) -> Outcome:
    """Complete scans and compare with the house."""
    options = CompletionOptions(texture=False)
    completed, cost = measured(lambda: complete(scans, options, rng=0))
    found = sample(hypothesis_of(completed, scans), CELL_M)
    there = is_there(found.points, found.normals, WALKS[0].caster)
    seen, reference = np.concatenate([scan.points()[scan.valid] for scan in scans]), _reference(path)
    apart = cKDTree(seen).query(reference)[0]
    near = cKDTree(found.points).query(reference)[0] <= _NEAR_M
    own = (beams.origins, beams.points)
    if held is not None:
        index = np.concatenate([np.arange(*cut) for cut in held.cuts.tolist()])
        own = (held.track.at(held.times[index]), held.points[index])
    else:
        stood = [np.broadcast_to(scan.origin, (int(scan.valid.sum()), 3)) for scan in scans]
        own = (np.concatenate(stood), seen)
    crossed, by_all = (
        violation_of_beams(completed, *rays, LIDAR.sigma_m, options).area_m2
        for rays in (own, (beams.origins, beams.points))
    )
    return Outcome(
        name=name,
        stretch_m=float("nan") if held is None else 2 * held.reach_m,
        n_scans=len(scans),
        n_points=len(seen),
        measured_m2=float(sum(patch.observed_m2 for patch in completed.patches)),
        right_m2=float(found.areas[there].sum()),
        wrong_m2=float(found.areas[~there].sum()),
        known=float(((apart <= _NEAR_M) | near).mean()),
        found=float(near[apart > _APART_M].mean()),
        crossed_m2=crossed,
        crossed_by_all_m2=by_all,
        cpu_s=cost.cpu_s,
        peak_mb=(cost.peak_bytes or 0) / 1e6,
    )


class Moved(NamedTuple):
    """Cells of planes that beams of a walk cross by the mean origins of stretches and by their own."""

    name: str
    stretch_m: float
    n_scans: int
    lost: float  # share of the vetoed cells that are not by mean origins
    false: float  # cells vetoed by mean origins alone, by the vetoed ones
    far: float  # of these, those with no beam in the cells around
    moved_m: float  # by how much crossings move, 95 % quantile


def moved_vetoes(times: float, seconds: float) -> Moved:
    """Cross planes along the axes with the beams of a walk; two beams in 3 x 3 cells, one within, veto it."""
    held, _ = _cut(times, walked(seconds))
    own = [held.track.at(held.times[start:end]) for start, end in held.cuts.tolist()]
    mean = np.concatenate([np.broadcast_to(places.mean(axis=0), places.shape) for places in own])
    points = np.concatenate([held.points[start:end] for start, end in held.cuts.tolist()])
    exact, n, moved = np.concatenate(own), np.zeros(4), [np.zeros(0)]
    low, high = points.min(axis=0), points.max(axis=0)
    for axis in range(3):
        others = [k for k in range(3) if k != axis]
        bins = [np.arange(low[k], high[k] + CROSSED_CELL_M, CROSSED_CELL_M) for k in others]
        for at in np.linspace(low[axis], high[axis], N_PLANES + 2)[1:-1]:
            with np.errstate(divide="ignore", invalid="ignore"):
                share = [(at - one[:, axis]) / (points[:, axis] - one[:, axis]) for one in (exact, mean)]
            is_across = np.logical_and.reduce([(part > 0) & (part < 0.95) for part in share])
            places = [
                (one[is_across] + part[is_across, None] * (points - one)[is_across])[:, others]
                for one, part in zip((exact, mean), share, strict=True)
            ]
            moved.append(np.linalg.norm(places[1] - places[0], axis=1)[::10])
            count = [np.histogram2d(place[:, 0], place[:, 1], bins=bins)[0] for place in places]
            around = [ndimage.uniform_filter(one, 3, mode="constant") * 9 for one in count]
            true, by_mean = ((one > 0) & (near > 1.5) for one, near in zip(count, around, strict=True))
            alone = by_mean & ~true
            n += [true.sum(), (true & ~by_mean).sum(), alone.sum(), (alone & (around[0] < 0.5)).sum()]
    quantile = float(np.quantile(np.concatenate(moved), 0.95))
    lost, false, far = (n[1:] / n[0]).tolist()
    return Moved(
        name=f"x {times:g}", stretch_m=2 * held.reach_m, n_scans=len(held.cuts), lost=lost, false=false,
        far=far, moved_m=quantile,
    )  # fmt: skip


def _cut(times: float, held: tuple[TimedPoints, Trajectory]) -> tuple[Walk, tuple[str, ...]]:
    """Return a walk with stretches so many times as long as chosen."""
    cloud = PointCloud(held[0].points, times=held[0].times, name="walk")
    walk_cut, sentences = walk_of(cloud, held[1])
    return (walk_cut, sentences) if times == 1 else walk_of(cloud, held[1], times * walk_cut.reach_m)


def by_stretches(times: float, seconds: float) -> Outcome:
    """Complete the walk by stretches so many times as long as is chosen."""
    beams, track = walked(seconds)
    held, _ = _cut(times, (beams, track))
    scans = [held.scan(k) for k in range(len(held.cuts))]
    return _outcome(f"walk, stretches x {times:g}", scans, path_through(seconds), beams, held)


def by_stations(n: int, seconds: float) -> Outcome:
    """Complete panoramas of n stations along the same way."""
    path, beams = path_through(seconds), walked(seconds)[0]
    return _outcome(f"{n} stations", _stations(path, seconds, n, 0), path, beams, None)


@suite("walks", smallest="--seconds 2 --times 1 --stations 1")
def walks(
    seconds: float = 60.0, times: list[float] | None = None, stations: list[int] | None = None
) -> Iterator[str]:
    """A spinning lidar carried through a house, by stretches of several lengths, beside stations.

    16 beams from -15 to 15 degrees, 10 turns a second, range noise 2 cm, 1.2 m/s, the lower storey of the
    duplex. Right and wrong by the model of the house; known and found of what is seen from along the way, all
    round: measured or inferred, and inferred of what is not within 10 cm of a measured point. Crossed:
    inferred area that beams went through, each from its own origin: those of the scans, and all of the walk.
    """
    yield from head(
        "scans", "stretch m", "n", "points", "measured m2", "right m2", "wrong m2", "precision", "known",
        "found", "crossed m2", "by all beams", "CPU s", "MB",
    )  # fmt: skip
    outcomes = [
        *each(by_stretches, times or [0.5, 1.0, 2.0, 4.0], seconds),
        *each(by_stations, stations or [4], seconds),
    ]
    for one in outcomes:
        inferred = one.right_m2 + one.wrong_m2
        yield row(
            one.name, f"{one.stretch_m:.3f}", one.n_scans, one.n_points, f"{one.measured_m2:.1f}",
            f"{one.right_m2:.1f}", f"{one.wrong_m2:.2f}", f"{one.right_m2 / max(inferred, 1e-9):.3f}",
            f"{one.known:.3f}", f"{one.found:.3f}", f"{one.crossed_m2:.4f}", f"{one.crossed_by_all_m2:.4f}",
            f"{one.cpu_s:.0f}", f"{one.peak_mb:.0f}",
        )  # fmt: skip
    yield ""
    yield from head(
        "stretches", "length m", "scans", "vetoes lost", "false", "false, none near", "moved 95 % mm"
    )
    for moved in each(moved_vetoes, times or [0.5, 1.0, 2.0, 4.0], seconds):
        shares = (f"{100 * share:.2f} %" for share in (moved.lost, moved.false, moved.far))
        yield row(moved.name, f"{moved.stretch_m:.3f}", moved.n_scans, *shares, f"{1000 * moved.moved_m:.1f}")
