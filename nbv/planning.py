# SPDX-License-Identifier: MIT
"""Planning: views of a known scene in simulation, by the online planner or by model-known cover."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from nbv.bound import LowerBound, marginal_bound
from nbv.cover import greedy_cover
from nbv.measurement import CoverageTally
from nbv.plan import Plan
from nbv.planner import PlannerOptions, explore
from nbv.reachability import Reachability, find_reachable, scene_candidates
from nbv.requirement import Requirement
from nbv.samples import SurfaceSamples, sample_surface
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor, Sensor
from nbv.scanning.sensor_profile import load_sensor
from nbv.view import View
from nbv.viewpoints import Candidates, room_lattice
from nbv.visibility import Progress, orient, visible_from_positions
from scenes.checks import FloatArray, InputError
from scenes.pose import Pose
from scenes.range_image import RangeImage
from scenes.raycast import RayCaster
from scenes.scene import Scene

Method = Literal["nbv", "cover"]
_PATCH_TOLERANCE_M = 0.01


def plan_views(
    scene: Scene,
    sensor: Sensor | None = None,
    *,
    method: Method = "nbv",
    max_incidence_deg: float = 60.0,
    max_range_m: float | None = None,
    target: float = 0.99,
    views: int | None = None,
    mode: str | None = None,
    candidates: Candidates | None = None,
    samples: SurfaceSamples | None = None,
    noise: str = "none",
    options: PlannerOptions | None = None,
    rng: np.random.Generator | int | None = None,
    n_threads: int | None = None,
    progress: Progress | None = None,
) -> Plan:
    """Plan views of a scene.

    "nbv" explores: the planner sees simulated scans alone. Coverage is measured on the true scene after
    every scan, and the plan ends when the target is met there, or when the planner itself finds that no
    view pays. "cover" knows the scene and chooses from the candidates' visibility of the samples. Their
    view counts answer different questions.

    Parameters
    ----------
    scene : Scene
        The true scene.
    sensor : Sensor, optional
        "generic60" when not given.
    method : "nbv" or "cover"
        Which planner.
    max_incidence_deg, max_range_m : float
        What counts as measured: incidence in degrees, range in metres.
    target : float
        Fraction of the reachable area to measure as required.
    views : int, optional
        Plan no more than so many.
    mode : "room" or "object", optional
        The scene's own when not given.
    candidates : Candidates, optional
        The scene's own when not given. A `half_angle_deg` in them replaces the sensor's aperture by a cone,
        and patches replace the samples on which coverage is measured.
    samples : SurfaceSamples, optional
        Where coverage is measured.
    noise : str
        Noise model of the simulated scans.
    options : PlannerOptions, optional
        For "nbv".
    rng : Generator, int or None
        Chooses the start of "nbv" (any free candidate) and drives the noise; "cover" uses none.
    n_threads : int, optional
        Threads; the plan does not depend on it.
    progress : callable, optional
        Called with (stage, done, total).

    Raises
    ------
    InputError
        Another method or mode, a target outside 0..1, nowhere to stand, patches that do not lie on the scene.
    """
    if method not in ("nbv", "cover"):
        raise InputError(f"method must be nbv or cover, got {method!r}")
    if not 0 < target <= 1:
        raise InputError(f"target must be a fraction of the reachable area, 0 < target <= 1, got {target}")
    if views is not None and views < 1:
        raise InputError(f"views must be at least 1, got {views}")
    if mode not in (None, "room", "object"):
        raise InputError(f"mode must be room or object, got {mode!r}")
    sensor = _with_aperture(sensor or load_sensor("generic60"), candidates)
    proposals = candidates
    if candidates is None:
        candidates = scene_candidates(scene, sensor, mode=mode, subdivisions=2 if method == "nbv" else 1)
        if (mode or scene.mode) == "room":
            proposals = Candidates(room_lattice(scene.mesh.bounds()), candidates.directions)
    caster = scene.ray_caster(n_threads)
    task = Task(
        scene=scene,
        sensor=sensor,
        requirement=Requirement(max_incidence_deg=max_incidence_deg, max_range_m=max_range_m),
        target=target,
        candidates=candidates,
        proposals=proposals or candidates,
        samples=samples or patch_samples(scene, caster, candidates) or sample_surface(scene.mesh),
        caster=caster,
        from_outside=(mode or scene.mode) == "object",
        n_threads=n_threads,
        progress=progress,
    )
    if method == "cover":
        return task.cover(views)
    return task.explore(views, noise, options or PlannerOptions(), rng)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Task:
    """A prepared planning task: what to see, from where, and when it is enough.

    Of a room without given candidates, `candidates` are the positions that are free in truth, which is what
    "reachable" refers to; the online planner gets `proposals`, all of the lattice, and finds out.
    """

    scene: Scene
    sensor: Sensor
    requirement: Requirement
    target: float
    candidates: Candidates
    proposals: Candidates
    samples: SurfaceSamples
    caster: RayCaster
    from_outside: bool
    n_threads: int | None
    progress: Progress | None

    def explore(
        self, views: int | None, noise: str, options: PlannerOptions, rng: np.random.Generator | int | None
    ) -> Plan:
        """Plan online: the planner gets a scanner, and a study that stops it."""
        seed = int(rng) if isinstance(rng, int | np.integer) else None
        rng = np.random.default_rng(rng)
        start = self.candidates.pose(int(rng.integers(self.candidates.n_poses)))
        study = _Study.begin(self)

        def scan(pose: Pose) -> RangeImage:
            study.add(pose)
            name = f"view {len(study.views)}"
            return scan_scene(
                self.scene, study.views[-1], noise=noise, rng=rng.spawn(1)[0], caster=self.caster, name=name
            )

        found = explore(
            scan,
            self.scene.mesh.bounds(),
            start,
            self.proposals,
            self.sensor,
            self.requirement,
            replace(options, max_views=min(views or options.max_views, options.max_views)),
            from_outside=self.from_outside,
            finished=study.why_finished,
            n_threads=self.n_threads,
            progress=self.progress,
        )
        return study.plan("nbv", seed, None, found.stopped_because)

    def cover(self, views: int | None) -> Plan:
        """Plan offline: greedy cover of the visibility matrix."""
        limits = self.requirement.limits(self.sensor)
        seen = visible_from_positions(
            self.caster,
            self.candidates.positions,
            self.samples,
            limits,
            n_threads=self.n_threads,
            progress=self.progress,
        )
        rotations = self.candidates.rotations()
        matrix = orient(seen, self.candidates.positions, rotations, self.samples.points, self.sensor)
        areas = self.samples.areas
        cover = greedy_cover(matrix, areas, self.target, n_most=views, progress=self.progress)
        bound = marginal_bound(matrix, areas, self.target, cover.chosen)
        study = _Study.begin(self)
        for number in cover.chosen:
            study.add(self.candidates.pose(number))
        reason = study.why_finished() or f"the limit of {views} views is reached"
        return study.plan("cover", None, bound, reason)


@dataclass(slots=True, eq=False)
class _Study:
    """Views so far, and what they cover of the true scene."""

    task: Task
    tally: CoverageTally
    reachability: Reachability
    views: list[View]

    @classmethod
    def begin(cls, task: Task) -> _Study:
        reachability = find_reachable(
            task.caster,
            task.samples,
            task.candidates,
            task.sensor,
            task.requirement,
            n_threads=task.n_threads,
            progress=task.progress,
        )
        return cls(task, CoverageTally.start(task.caster, task.samples, task.requirement), reachability, [])

    def add(self, pose: Pose) -> None:
        """Add the view from `pose`."""
        gain = self.tally.add(View(pose, self.task.sensor))
        met = self.tally.met_m2() / self.task.samples.total_m2
        self.views.append(View(pose, self.task.sensor, gain, met))

    def why_finished(self) -> str | None:
        """Return why it is enough, or None."""
        met = self.tally.met
        areas = self.task.samples.areas
        reachable_m2 = float(areas[self.reachability.including(met).reachable].sum())
        if float(areas[met].sum()) >= (self.task.target - 1e-9) * reachable_m2:
            return f"target met on the true scene: {self.task.target:g} of the reachable area"
        return None

    def plan(self, method: Method, seed: int | None, bound: LowerBound | None, reason: str) -> Plan:
        """Return the plan."""
        task = self.task
        return Plan(
            method=method,
            sensor=task.sensor,
            requirement=task.requirement,
            target=task.target,
            seed=seed,
            n_candidates=task.candidates.n_poses,
            views=tuple(self.views),
            coverage=self.tally.coverage(task.scene, self.reachability),
            lower_bound=bound,
            stopped_because=reason,
            candidates=task.candidates,
        )


def patch_samples(scene: Scene, caster: RayCaster, candidates: Candidates) -> SurfaceSamples | None:
    """Return the patches of a planning instance as samples of equal area, None when it has none.

    A patch on the rim of a body counts as seen when the line of sight reaches within 1 cm of it.

    Raises
    ------
    InputError
        Patches that lie more than 1 cm from the scene's surface.
    """
    points, normals = candidates.patch_points, candidates.patch_normals
    if points is None or normals is None:
        return None
    if points.shape != normals.shape or not len(points):
        raise InputError(
            f"{len(points)} patch_points with {len(normals)} patch_normals; give as many of both"
        )
    hits = caster.first_hit(points + normals * _PATCH_TOLERANCE_M, -normals)
    off = ~(hits.ranges <= 2 * _PATCH_TOLERANCE_M)
    if off.any():
        first: FloatArray = points[int(np.argmax(off))]
        raise InputError(
            f"{int(off.sum())} of {len(points)} patches do not lie on {scene.name} within 1 cm "
            f"(first at {first.round(3).tolist()}); are they of another scene?"
        )
    areas = np.full(len(points), float(scene.mesh.face_areas().sum()) / len(points))
    surface = scene.mesh.face_surface[hits.face]
    return SurfaceSamples(points, normals, areas, hits.face, surface, _PATCH_TOLERANCE_M)


def _with_aperture(sensor: Sensor, candidates: Candidates | None) -> Sensor:
    """Return the sensor, with the conical aperture that the candidates ask for."""
    if candidates is None or candidates.half_angle_deg is None:
        return sensor
    name = f"{sensor.name}, cone of half angle {candidates.half_angle_deg:g} deg"
    pixels = 320
    return PinholeSensor(
        fov_deg=2 * candidates.half_angle_deg,
        width=pixels,
        height=pixels,
        min_range_m=sensor.min_range_m,
        max_range_m=sensor.max_range_m,
        name=name,
        aperture="circular",
        effects=sensor.effects,
    )
