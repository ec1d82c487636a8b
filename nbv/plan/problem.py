# SPDX-License-Identifier: MIT
"""Planning problem: what to see of a known scene, from where, until when; and how far views have got.

Remote visibility: blocks of positions are cast by workers that map scene and samples from one folder. What
all blocks share is written once, under the hash of its bytes, and mapped into the memory of each worker;
Embree's tree is built once in each process. A position's row depends on nothing but itself, so the matrix
is the one that `nbv.visibility.visibility.visible_from_positions` returns, whoever casts.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import astuple, dataclass, field, replace
from functools import lru_cache, partial
from pathlib import Path
from shutil import rmtree
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from nbv.cover.instance import LowerBound
from nbv.cover.overlap import OverlapOptions
from nbv.coverage.coverage import Coverage
from nbv.coverage.measurement import CoverageTally
from nbv.coverage.surface_classes import UNKNOWN, ClassShares, KnownSurfaces, classify, shares_of
from nbv.coverage.unreachable import room_shares
from nbv.plan.plan import Plan, Resumption
from nbv.plan.site_time import USUAL_PACE, SitePace, site_time
from nbv.plan.tour import Stations, Tour, plan_tour
from nbv.run.workers import Workers, workers_of
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import Sensor, View
from nbv.visibility.limits import SAME_M
from nbv.visibility.requirement import Requirement, SightLimits
from nbv.visibility.samples import SurfaceSamples
from nbv.visibility.site import Site
from nbv.visibility.viewpoints import Candidates
from nbv.visibility.visibility import Progress, Reachability, stack_rows, visible_from_positions
from nbv.visibility.zones import EVERYWHERE, Zones
from scenes.checks import FloatArray, InputError, Value
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.pose import Pose
from scenes.rays.raycast import RayCaster
from scenes.run.atomic import atomic_path
from scenes.run.journal import NO_JOURNAL, Journal
from scenes.scan.range_image import RangeImage
from scenes.world.scene import Scene

_BLOCK = 8  # positions a piece of work
_KEPT = 2  # trees and sets of samples that a worker's process keeps
_SHARED = ".shared"
_SAMPLE_ARRAYS = ("points", "normals", "areas", "face", "surface", "pair")


@dataclass(frozen=True, slots=True)
class SharedArrays:
    """Arrays in a folder that all workers see, as `.npy` files named by the hash of their bytes.

    The folder is absolute; `names` say what each array is called, and the SHA-256 of its bytes.
    """

    folder: str
    names: tuple[tuple[str, str], ...]

    @classmethod
    def write(cls, folder: Path, arrays: Mapping[str, NDArray[np.generic]]) -> SharedArrays:
        """Write arrays of any shape that are not there yet."""
        folder.mkdir(parents=True, exist_ok=True)
        names = []
        for name, array in arrays.items():
            plain = np.ascontiguousarray(array)
            digest = hashlib.sha256(f"{plain.dtype.str}{plain.shape}".encode() + plain.tobytes()).hexdigest()
            file = folder / f"{digest}.npy"
            if not file.is_file():
                with atomic_path(file) as temporary:
                    np.save(temporary, plain, allow_pickle=False)
            names.append((name, digest))
        return cls(str(folder.resolve()), tuple(names))

    def map_arrays(self) -> dict[str, NDArray[np.generic]]:
        """Return the arrays in the shape they had, mapped into memory.

        Raises
        ------
        InputError
            A worker does not see the folder.
        """
        arrays: dict[str, NDArray[np.generic]] = {}
        for name, digest in self.names:
            file = Path(self.folder) / f"{digest}.npy"
            try:
                arrays[name] = np.asarray(np.load(file, mmap_mode="r", allow_pickle=False))
            except (OSError, ValueError) as error:
                raise InputError(
                    f"{file}: a worker cannot read this; all must see the output folder under the same path, "
                    "on a disk that they share"
                ) from error
        return arrays


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """Positions (b, 3) from which to look, and what to look at."""

    mesh: SharedArrays
    samples: SharedArrays
    tolerance_m: float
    limits: SightLimits
    positions: FloatArray


def look(block: Block, n_threads: int | None) -> list[tuple[NDArray[np.int64], FloatArray]]:
    """Return for each position of a block the samples (m,) that it sees, and their cosines (m,)."""
    samples = _samples(block.samples, block.tolerance_m)
    seen = visible_from_positions(
        _caster(block.mesh), block.positions, samples, block.limits, n_threads=n_threads
    )
    return [
        (seen.indices[start:end], seen.data[start:end])
        for start, end in zip(seen.indptr[:-1], seen.indptr[1:], strict=True)
    ]


@lru_cache(maxsize=_KEPT)
def _caster(mesh: SharedArrays) -> RayCaster:
    """Return the tree of a shared mesh; each process builds it once. Threads look, each alone."""
    arrays = mesh.map_arrays()
    return RayCaster(arrays["vertices"], arrays["faces"], n_threads=1)


@lru_cache(maxsize=_KEPT)
def _samples(samples: SharedArrays, tolerance_m: float) -> SurfaceSamples:
    arrays: dict[str, Any] = samples.map_arrays()
    return SurfaceSamples(**arrays, tolerance_m=tolerance_m)


@dataclass(frozen=True, slots=True)
class RemoteVisibility(Value):
    """Workers that cast, and the folder that all of them see under the same path."""

    workers: Workers
    folder: Path

    def from_positions(
        self,
        mesh: LabelledMesh,
        positions: FloatArray,
        samples: SurfaceSamples,
        limits: SightLimits,
        progress: Progress | None = None,
    ) -> csr_array:
        """Return the cosines (n_positions, n_samples) as `visible_from_positions` does.

        Raises
        ------
        InputError
            A worker does not see the folder, or work was lost for good.
        """
        scene = SharedArrays.write(self.folder, {"vertices": mesh.vertices, "faces": mesh.faces})
        seen = SharedArrays.write(self.folder, {name: getattr(samples, name) for name in _SAMPLE_ARRAYS})
        blocks = [
            Block(
                mesh=scene,
                samples=seen,
                tolerance_m=samples.tolerance_m,
                limits=limits,
                positions=positions[start : start + _BLOCK],
            )
            for start in range(0, len(positions), _BLOCK)
        ]
        rows: list[list[tuple[NDArray[np.int64], FloatArray]]] = [[] for _ in blocks]
        keys = [_key(block) for block in blocks]
        for done, (number, pairs) in enumerate(self.workers.each(look, blocks, keys), start=1):
            rows[number] = pairs
            if progress is not None:
                progress("visibility", min(done * _BLOCK, len(positions)), len(positions))
        return stack_rows([row for block in rows for row in block], len(samples))


@contextmanager
def remote_visibility(
    scheduler: str | None, n_threads: int | None, folder: Path
) -> Iterator[RemoteVisibility | None]:
    """Yield the workers of a scheduler, None without one; what they share lies in `folder` meanwhile."""
    shared = folder / _SHARED
    if scheduler is None:
        rmtree(shared, ignore_errors=True)  # of a run with a scheduler that was killed
        yield None
        return
    try:
        with workers_of(scheduler, n_threads) as workers:
            yield RemoteVisibility(workers, shared)
    finally:
        rmtree(shared, ignore_errors=True)


def _key(block: Block) -> str:
    """Return what tells equal blocks: the hashes of what they look at, the limits, and the positions."""
    text = repr((block.mesh, block.samples, block.tolerance_m, astuple(block.limits)))
    return hashlib.sha256(text.encode() + block.positions.tobytes()).hexdigest()


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PlanningProblem:
    """A prepared planning problem: what to see, from where, when it is enough, and how scans are to overlap.

    Of a room without given candidates, `candidates` are the positions that are free in truth, which is what
    "reachable" refers to, in the rooms of the `site`; the online planner gets `proposals`, all of the
    lattice, and finds out. `scans` were taken before: what they have measured is measured. `remote` workers
    cast for the offline planner.
    The `journal` remembers the results of the steps of this very problem, `pace` says what time there is.
    """

    scene: Scene
    sensor: Sensor
    requirement: Requirement
    target: float
    candidates: Candidates
    proposals: Candidates
    site: Site | None
    samples: SurfaceSamples
    apart_m2: Mapping[str, float]
    caster: RayCaster
    from_outside: bool
    seed: int | None
    overlap: OverlapOptions | None
    infer: bool
    n_threads: int | None
    progress: Progress | None
    scans: tuple[RangeImage, ...] = ()
    zones: Zones = EVERYWHERE
    remote: RemoteVisibility | None = None
    journal: Journal = NO_JOURNAL
    pace: SitePace = USUAL_PACE

    def start_poses(self) -> NDArray[np.int64]:
        """Return the numbers (s,) of the poses at the start; none where no start is asked for.

        Raises
        ------
        InputError
            A start that is to be kept out of.
        """
        if self.site is None or not len(self.site.start):
            return np.zeros(0, np.int64)
        away = np.abs(self.candidates.positions[:, None] - self.site.start).max(axis=2).min(axis=1)
        there = np.flatnonzero(away <= SAME_M)
        if not len(there):
            place = ",".join(f"{value:g}" for value in self.site.start[0, :2])
            raise InputError(
                f"--start {place} lies in a box of --keep-out; give another place, or no such box"
            )
        n = self.candidates.n_directions
        return np.asarray((there[:, None] * n + np.arange(n)).ravel())

    def spots(self) -> NDArray[np.int64] | None:
        """Return numbers (p,), alike for candidate positions over one spot, of which a plan takes one.

        None where it may take several.
        """
        if self.site is None or self.site.several_heights:
            return None
        keys = self.site.spots(self.candidates.positions)
        return np.asarray(np.unique(keys, axis=0, return_inverse=True)[1].ravel())

    def tour(self, poses: Sequence[Pose], *, in_order: bool = False, first: int | None = None) -> Tour:
        """Return a tour of the poses, short or as they come: on foot, or through the air around objects.

        It begins at the pose `first` where that is given.
        """
        return plan_tour(
            self.scene.mesh,
            np.array([pose.translation for pose in poses]).reshape(-1, 3),
            on_foot=not self.from_outside,
            in_order=in_order,
            first=first,
            keep_out=self.zones.keep_out,
            caster=self.caster,
        )


@dataclass(slots=True, eq=False)
class PlanningRun:
    """Views so far and their coverage of the true scene; with completion, the class of each sample."""

    problem: PlanningProblem
    tally: CoverageTally
    reachability: Reachability
    views: list[View]
    resumed_from: Resumption | None
    classes: NDArray[np.int8] | None = None
    shares: list[ClassShares] = field(default_factory=list)

    @classmethod
    def begin(cls, problem: PlanningProblem) -> PlanningRun:
        """Return the run before the first view; scans that were taken before count already.

        Raises
        ------
        InputError
            A scan that measures nothing of the scene.
        """
        tally = CoverageTally.start(problem.caster, problem.samples, problem.requirement)
        for scan in problem.scans:
            if not tally.add_scan(scan, is_given=True):
                n_returns = int(scan.valid.sum())
                raise InputError(
                    f"{scan.name} ({n_returns} returns) measures none of {len(problem.samples)} places of "
                    f"{problem.scene.name}: its poses and ranges must be in the scene's coordinates, "
                    "in metres"
                )
        resumed = None
        if problem.scans:
            poses = tuple(scan.world_from_sensor for scan in problem.scans)
            resumed = Resumption(poses, tally.met_m2() / problem.samples.total_m2)
        find = partial(
            tally.reachable, problem.candidates, problem.sensor, problem.n_threads, problem.progress
        )
        reachability = problem.journal.step("reachable", find)
        return cls(problem, tally, reachability, [], resumed)

    def add(self, pose: Pose, sensor: Sensor | None = None) -> None:
        """Add the view from `pose`, of the problem's sensor or one like it."""
        view = View(pose, sensor or self.problem.sensor)
        gain = self.tally.add(view)
        met = self.tally.met_m2() / self.problem.samples.total_m2
        self.views.append(replace(view, gain_m2=gain, met_fraction=met))

    def scan(self, pose: Pose, noise: str, rng: np.random.Generator) -> RangeImage:
        """Add the view from `pose` and return its simulated scan."""
        self.add(pose)
        problem, view, stream = self.problem, self.views[-1], rng.spawn(1)[0]
        name = f"view {len(self.views)}"
        return scan_scene(problem.scene, view, noise=noise, rng=stream, caster=problem.caster, name=name)

    def complete(self, scans: Sequence[RangeImage]) -> KnownSurfaces:
        """Let completion of `scans`, those of all views so far, stand in for further views."""
        problem, tally = self.problem, self.tally
        completed = KnownSurfaces.of(
            scans, problem.requirement.max_sd_m, relates=False, n_threads=problem.n_threads
        )
        self.classes = classify(problem.samples, tally.met, tally.n_views > 0, completed)
        shares = shares_of(
            self.classes,
            problem.samples,
            reachable=self.reachability.include(tally.met).reachable,
            completed=completed,
            truth=problem.scene.mesh,
            views=len(self.views),
        )
        self.shares.append(shares)
        return completed

    def why_finished(self) -> str | None:
        """Return why the plan is complete, None while it is not."""
        met = self.tally.met
        areas = self.problem.samples.areas
        reachable = self.reachability.include(met).reachable
        reachable_m2 = float(areas[reachable].sum())
        if reachable_m2 == 0:
            return "no candidate can measure anything as required"
        done = met if self.classes is None else met | (reachable & (self.classes != UNKNOWN))
        if float(areas[done].sum()) >= (self.problem.target - 1e-9) * reachable_m2:
            how = "met" if self.classes is None else "met, modelled or inferred"
            return f"target {how} on the true scene: {self.problem.target:g} of the reachable area"
        return None

    def stations(self, *, in_order: bool = False) -> Stations:
        """Return the tour of the views so far; overlap is not looked at."""
        return Stations(self.problem.tour([view.world_from_sensor for view in self.views], in_order=in_order))

    def _rooms(self, site: Site, coverage: Coverage) -> tuple[dict[str, Any], ...]:
        """Return what `plan.json` says of each room: its stations, and the shares of its surface."""
        shares = {share.room: share.to_json() for share in room_shares(coverage, site, self.problem.caster)}
        return tuple({**entry, **shares.get(entry["room"], {})} for entry in site.entries(self.views))

    def plan(
        self,
        method: str,
        reason: str,
        bound: LowerBound | None = None,
        stations: Stations | None = None,
        *,
        most_in_time: float | None = None,
    ) -> Plan:
        """Return the plan."""
        problem = self.problem
        coverage = replace(
            self.tally.coverage(problem.scene, self.reachability),
            classes=self.classes,
            apart_m2=problem.apart_m2,
        )
        return Plan(
            method=method,
            sensor=problem.sensor,
            requirement=problem.requirement,
            target=problem.target,
            seed=problem.seed,
            n_candidates=problem.candidates.n_poses,
            views=tuple(self.views),
            coverage=coverage,
            lower_bound=bound,
            stopped_because=reason,
            stations=stations,
            candidates=problem.candidates,
            shares=tuple(self.shares),
            resumed_from=self.resumed_from,
            zones=problem.zones,
            site=problem.site,
            rooms=() if problem.site is None else self._rooms(problem.site, coverage),
            platforms=() if problem.site is None else problem.site.platform_entries(),
            time=site_time(self.views, stations.tour, problem.sensor, problem.pace) if stations else None,
            lost_if_blocked=self.tally.lost_without(),
            most_in_time=most_in_time,
        )
