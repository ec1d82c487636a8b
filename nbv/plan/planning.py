# SPDX-License-Identifier: MIT
"""Planning: views of a known scene in simulation, by the online planner or by model-known cover.

Plans by simulated scans: the online planner gets a scanner of the true scene, and stops at its limits. The
other planner knows the scene, and so what each candidate would see; completion of the scans so far stands in
for views.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, cast, get_args

import numpy as np

from nbv.cover.overlap import OverlapOptions
from nbv.cover.pipeline import CoverOptions
from nbv.coverage.surface_classes import UNKNOWN
from nbv.online.limits import KNOWN_WORTH, RENEWED, STEEP
from nbv.online.planner import PlannerOptions, explore
from nbv.plan.offline_plan import (
    BASELINES,
    overlap_graph,
    plan_offline,
    plan_simply,
    plan_stations,
    seen_by_candidates,
)
from nbv.plan.plan import Plan
from nbv.plan.problem import PlanningProblem, PlanningRun, RemoteVisibility
from nbv.plan.site_time import USUAL_PACE, SitePace
from nbv.run.plan_options import ONLINE_METHODS, Method
from nbv.scanning.sensor import Sensor, chosen_effects, with_effects
from nbv.scanning.sensor_profile import load_sensor
from nbv.visibility.candidates import (
    Standing,
    find_standing,
    patch_samples,
    restrict_to_rooms,
    samples_that_count,
    with_aperture,
    within,
)
from nbv.visibility.limits import INCIDENCE_DEG
from nbv.visibility.requirement import Requirement
from nbv.visibility.samples import SurfaceSamples
from nbv.visibility.site_options import SiteOptions
from nbv.visibility.viewpoints import Candidates, allowed_candidates
from nbv.visibility.visibility import Progress
from nbv.visibility.zones import EVERYWHERE, Zones
from scenes.checks import FloatArray, InputError, check_kind, check_rng
from scenes.io.scene_files import open_scene
from scenes.pose import Pose
from scenes.rays.raycast import RayCaster
from scenes.run.journal import NO_JOURNAL, Journal
from scenes.scan.range_image import RangeImage
from scenes.world.scene import Mode, Scene


def plan_online(
    problem: PlanningProblem,
    views: int | None,
    noise: str,
    options: PlannerOptions,
    rng: np.random.Generator | int | None,
) -> Plan:
    """Plan views, at most `views`, of a scene that the planner learns of by its scans alone.

    The true scene serves to scan, and to measure coverage. `rng` chooses the start (any candidate, or one of
    those at the place that was asked for; of a plan that is resumed none) and drives the noise.
    """
    rng = np.random.default_rng(rng)
    start, first = None, problem.start_poses()
    if len(first):
        start = problem.candidates.pose(int(first[rng.integers(len(first))]))
    elif not problem.scans:
        start = problem.candidates.pose(int(rng.integers(problem.candidates.n_poses)))
    run = PlanningRun.begin(problem)
    method = "nbv" if options.criterion == "gain" else f"online:{options.criterion}"
    further = _further_starts(problem, start, rng)
    scans = list(problem.scans)

    def scan(pose: Pose) -> RangeImage:
        scans.append(run.scan(pose, noise, rng))
        return scans[-1]

    exploration = explore(
        scan,
        problem.scene.mesh.bounds(),
        start=start,
        candidates=problem.proposals,
        sensor=problem.sensor,
        requirement=problem.requirement,
        options=replace(
            options, max_views=min(views or options.max_views, options.max_views), zones=problem.zones
        ),
        given=problem.scans,
        from_outside=problem.from_outside,
        spot_of=None if problem.spots() is None or problem.site is None else problem.site.spots,
        further_starts=further,
        infer=run.complete if problem.infer else None,
        finished=run.why_finished,
        journal=problem.journal,
        n_threads=problem.n_threads,
        progress=problem.progress,
    )
    if problem.infer and run.shares[-1].views < len(run.views):
        run.complete(scans)
    return run.plan(method, exploration.stopped_because, stations=run.stations(in_order=True))


def _further_starts(problem: PlanningProblem, start: Pose | None, rng: np.random.Generator) -> list[Pose]:
    """Return a random candidate on each storey of each part of a building that one cannot walk to.

    The part of the start, and those that have scans already, are left out. A surveyor who was asked for these
    rooms knows where their stairs and doors are; the planner is told no more than this one place in each.
    """
    if problem.site is None:
        return []
    stood = [pose.translation for pose in [start] if pose] + [scan.origin for scan in problem.scans]
    parts = problem.site.parts(problem.candidates.positions)
    begun = {tuple(part) for part in problem.site.parts(np.array(stood).reshape(-1, 3)).tolist()}
    poses = []
    for part in np.unique(parts, axis=0).tolist():
        if tuple(part) not in begun and min(part) >= 0:
            there = np.flatnonzero((parts == part).all(axis=1))
            number = int(there[rng.integers(len(there))]) * problem.candidates.n_directions
            poses.append(problem.candidates.pose(number + int(rng.integers(problem.candidates.n_directions))))
    return poses


def plan_with_completion(
    problem: PlanningProblem, views: int | None, noise: str, rng: np.random.Generator | int | None
) -> Plan:
    """Plan views until what they meet, and completion models or infers from them, reaches the target.

    There are no more than `views`, 200 when not given; `rng` drives the noise of the simulated scans.
    """
    rng = np.random.default_rng(rng)
    run, scans, chosen = PlanningRun.begin(problem), list(problem.scans), list[int]()
    steeply = replace(problem.requirement.visibility(problem.sensor), min_cosine=STEEP)
    seen = seen_by_candidates(problem, "steeply", steeply) > 0
    met = seen_by_candidates(problem, "as-required", problem.requirement.limits(problem.sensor)) > 0
    n_most, n_known = views or PlannerOptions().max_views, len(scans)
    if scans:
        run.complete(scans)
    first, spots, d = problem.start_poses(), problem.spots(), problem.candidates.n_directions
    may = np.ones(problem.candidates.n_poses, np.bool_)
    while (reason := run.why_finished()) is None and len(chosen) < n_most:
        if problem.progress:
            problem.progress("views", len(chosen), n_most)
        gain = seen @ _unknown_m2(run) + KNOWN_WORTH * (met @ _unmet_m2(run))
        if len(first) and not chosen:
            chosen.append(int(first[np.argmax(gain[first])]))
        elif not gain[may].max(initial=0.0) > 0:
            reason = "no candidate sees what is left"
            break
        else:
            chosen.append(int(np.argmax(np.where(may, gain, -1.0))))
        if spots is not None:
            at = chosen[-1] // d
            may &= ~np.repeat((spots == spots[at]) & (np.arange(len(spots)) != at), d)
        scans.append(run.scan(problem.candidates.pose(chosen[-1]), noise, rng))
        if len(scans) >= RENEWED * n_known:
            run.complete(scans)
            n_known = len(scans)
    if chosen and run.shares[-1].views < len(chosen):
        run.complete(scans)
    graph = overlap_graph(problem, OverlapOptions())
    stations = plan_stations(problem, graph, chosen, begins_at_first=len(first) > 0)
    reason = reason or f"the limit of {n_most} views is reached"
    return run.plan("cover", reason, stations=stations)


def _unknown_m2(run: PlanningRun) -> FloatArray:
    """Area of each sample that is not known yet, 0 for others."""
    unknown = ~run.tally.met if run.classes is None else run.classes == UNKNOWN
    return np.asarray(run.problem.samples.areas * unknown)


def _unmet_m2(run: PlanningRun) -> FloatArray:
    """Area of each sample that is not met yet, 0 for others."""
    return np.asarray(run.problem.samples.areas * ~run.tally.met)


if TYPE_CHECKING:
    from trimesh import Trimesh


def plan_views(
    scene: Scene | str | os.PathLike[str] | Trimesh,
    sensor: Sensor | None = None,
    *,
    method: Method = "nbv",
    max_incidence_deg: float | None = None,
    max_range_m: float | None = None,
    requirement: Requirement | None = None,
    target: float = 0.99,
    views: int | None = None,
    mode: str | None = None,
    site: SiteOptions = SiteOptions(),
    candidates: Candidates | None = None,
    standing: Standing | None = None,
    samples: SurfaceSamples | None = None,
    noise: str = "none",
    options: PlannerOptions | None = None,
    budgets: CoverOptions | None = None,
    overlap: OverlapOptions | None = None,
    infer: bool = False,
    pace: SitePace = USUAL_PACE,
    scans: Sequence[RangeImage] = (),
    zones: Zones = EVERYWHERE,
    remote: RemoteVisibility | None = None,
    journal: Journal = NO_JOURNAL,
    rng: np.random.Generator | int | None = None,
    n_threads: int | None = None,
    progress: Progress | None = None,
) -> Plan:
    """Plan views of a scene.

    "nbv" explores: the planner sees simulated scans alone; so does "online:NAME", by a criterion of the
    literature. Coverage is measured on the true scene after every scan, and the plan ends when the target is
    met there, or when the planner itself finds that no view pays. "cover" knows the scene and chooses from
    the candidates' visibility of the samples. Their view counts answer different questions.

    Parameters
    ----------
    scene : Scene, path or trimesh.Trimesh
        The true scene, or the mesh file or mesh that it is made of (`open_scene`, `Scene.from_mesh`).
    sensor : Sensor, optional
        "generic60" when not given.
    method : "nbv", "cover", "online:NAME", "greedy", "visibility", "farthest", "random", "rule:grid5m" or \
"rule:rooms-and-doorways"
        Which planner; all but the first two are baselines (`nbv.online.literature`, `nbv.plan.offline_plan`).
        NAME: frontier, entropy, rear-side, proximity, surface-edge or set-cover.
    max_incidence_deg, max_range_m : float
        What counts as measured: incidence in degrees, 60 when nothing is said; range in metres.
    requirement : Requirement, optional
        What counts as measured, in full, in place of the two above. The explorer of "nbv" looks for its
        incidence; coverage is measured by all of it.
    target : float
        Fraction of the reachable area to measure as required.
    views : int, optional
        Plan no more than so many.
    mode : "room" or "object", optional
        The scene's own when not given.
    site : SiteOptions
        Which rooms to stand in, and where in them; of an object, whether to look from below. Of no use with
        `candidates`.
    candidates : Candidates, optional
        The scene's own when not given. A `half_angle_deg` in them replaces the sensor's aperture by a cone,
        and patches replace the samples on which coverage is measured.
    standing : Standing, optional
        Where the sensor may stand (`nbv.visibility.candidates.find_standing`), for many plans of one
        scene; instead of `site` and `candidates`.
    samples : SurfaceSamples, optional
        Where coverage is measured; `nbv.visibility.samples.sample_surface` when not given.
    noise : str
        Noise model of the simulated scans, and what a largest standard deviation reckons with; of a sensor
        with errors of its own "none" leaves the latter.
    options : PlannerOptions, optional
        For "nbv"; "online:NAME" replaces their criterion.
    budgets : CoverOptions, optional
        For "cover".
    overlap : OverlapOptions, optional
        For "cover": how scans must overlap so that all can be registered with one another.
    infer : bool
        Whether surface that completion models or infers from the scans so far counts towards the target
        (`nbv.coverage.surface_classes`), outranked by unknown surface. Such a plan has no lower bound.
    pace : SitePace
        How long stations and ways take; with a budget in it, "cover" finds the plan that measures most within
        it, in place of the smallest that meets the target.
    scans : sequence of RangeImage
        Scans that were taken before, in the scene's coordinates: what they have measured as required counts,
        and "nbv" knows what they saw. They are not views of the plan.
    zones : Zones
        Only surface in the region counts, and no station lies in, and no tour leads through, what is to be
        kept out of. Those of the `options` when not given.
    remote : RemoteVisibility, optional
        For planners that know the scene: workers that cast for them. The plan does not depend on them.
    journal : Journal
        Remembers what the steps of a run of the same came to that was killed.
    rng : Generator, int or None
        Chooses the start of "nbv" (any free candidate) and drives the noise; drives the search of "cover".
    n_threads : int, optional
        Threads; the plan does not depend on it.
    progress : callable, optional
        Called with (stage, done, total).

    Raises
    ------
    InputError
        Another method or mode, a target outside 0..1, a requirement beside single values, zones given
        twice, nowhere to stand, patches that do not lie on the scene,
        scans that measure nothing of it, a region without surface, no candidate that need not keep out.
    """
    # Check the arguments
    _check_request(method, target, views, mode=mode, infer=infer, overlap=overlap, remote=remote)
    if pace.budget_min is not None and (method != "cover" or infer or overlap is not None):
        raise InputError("a budget is for plans of a known scene, without infer and overlap: method cover")
    if pace.budget_min is not None and views is not None:
        raise InputError("give a budget or a number of views, not both")
    check_rng(rng)
    scene = _as_scene(scene, mode)
    mode = mode or scene.mode
    _check_places(candidates, samples, site, mode)
    options = options or PlannerOptions()
    if method.startswith("online:"):
        options = replace(options, criterion=method.removeprefix("online:"))
    zones = _resolve_zones(zones, options.zones)
    # Where the sensor may stand
    sensor = with_aperture(sensor or load_sensor("generic60"), candidates)
    if candidates is not None:
        standing = Standing(candidates, candidates, None)
    elif standing is None:
        standing = find_standing(scene, sensor, site, mode=mode, subdivisions=1 + (method in ONLINE_METHODS))
    # What counts as measured, and the samples that coverage is measured on
    requirement = _resolve_requirement(requirement, max_incidence_deg, max_range_m)
    if requirement.max_sd_m is not None and noise != "none":
        sensor = with_effects(sensor, chosen_effects(sensor, noise))
    requirement.limits(sensor)  # raises before anything is cast
    caster = scene.ray_caster(n_threads)
    samples, apart = _samples_of(samples, scene, standing, caster, zones)
    # Plan
    problem = PlanningProblem(
        scene=scene,
        sensor=sensor,
        requirement=requirement,
        target=target,
        candidates=allowed_candidates(standing.candidates, zones),
        proposals=allowed_candidates(standing.proposals, zones),
        site=standing.site,
        samples=samples,
        apart_m2=apart,
        caster=caster,
        seed=int(rng) if isinstance(rng, int | np.integer) else None,
        from_outside=mode == "object",
        overlap=overlap,
        infer=infer,
        n_threads=n_threads,
        progress=progress,
        scans=tuple(scans),
        zones=zones,
        remote=remote,
        journal=journal,
        pace=pace,
    )
    if method == "cover" and infer:
        return plan_with_completion(problem, views, noise, rng)
    if method == "cover":
        return plan_offline(problem, views, budgets or CoverOptions(), rng)
    if method in BASELINES:
        return plan_simply(problem, method, views, rng)
    return plan_online(problem, views, noise, options, rng)


def _check_request(
    method: str,
    target: float,
    views: int | None,
    *,
    mode: str | None,
    infer: bool,
    overlap: OverlapOptions | None,
    remote: RemoteVisibility | None,
) -> None:
    """Refuse values out of range, and options that the method does not take."""
    if method not in get_args(Method):
        raise InputError(f"method must be one of {', '.join(get_args(Method))}, got {method!r}")
    if not 0 < target <= 1:
        cure = f"; write {target / 100:g} for {target:g} %" if 1 < target <= 100 else ""
        raise InputError(
            f"target must be a fraction of the reachable area, 0 < target <= 1, got {target:g}{cure}"
        )
    if views is not None and views < 1:
        raise InputError(f"views must be at least 1, got {views}")
    if infer and method not in ("nbv", "cover"):
        raise InputError(f"completion can stand in for views of method nbv or cover, not of {method}")
    if overlap is not None and method != "cover":
        raise InputError(f"overlap is asked of plans of a known scene: method cover, not {method}")
    if remote is not None and method in ONLINE_METHODS:
        raise InputError(f"workers cast for planners that know the scene: they do not serve method {method}")
    if infer and overlap is not None:
        raise InputError("a plan in which completion stands in for views cannot also ask for overlap")
    if mode not in (None, "room", "object"):
        raise InputError(f"mode must be room or object, got {mode!r}")


def _check_places(
    candidates: Candidates | None, samples: SurfaceSamples | None, site: SiteOptions, mode: str
) -> None:
    """Refuse candidates and samples of another kind, and a start where there is no floor to choose it on."""
    if candidates is not None:
        cure = "Candidates(positions, directions) holds where the sensor may be and look"
        check_kind("candidates", candidates, Candidates, cure)
    if samples is not None:
        check_kind("samples", samples, SurfaceSamples, "sample_surface(scene.mesh, spacing_m) makes them")
    if site.start is not None and (candidates is not None or mode == "object"):
        raise InputError(
            "a start is a place on the floor of a room, which objects and given candidates have not; "
            "leave --start out"
        )


def _samples_of(
    samples: SurfaceSamples | None, scene: Scene, standing: Standing, caster: RayCaster, zones: Zones
) -> tuple[SurfaceSamples, Mapping[str, float]]:
    """Return the samples that coverage is measured on, and the areas in m2 of what is set apart."""
    samples = samples or patch_samples(scene, caster, standing.candidates)
    if samples is None:
        return samples_that_count(scene, standing, caster, zones)
    return restrict_to_rooms(within(samples, zones, scene), standing, caster)


def _as_scene(scene: object, mode: str | None) -> Scene:
    """Return the scene that a path or a mesh holds; a scene as it is."""
    if isinstance(scene, Scene):
        return scene
    asked = cast("Mode | None", mode)
    if isinstance(scene, str | os.PathLike):
        return open_scene(scene, mode=asked)
    return Scene.from_mesh(scene, mode=asked)


def _resolve_requirement(
    requirement: Requirement | None, max_incidence_deg: float | None, max_range_m: float | None
) -> Requirement:
    """Return what counts as measured, refusing a requirement beside single values."""
    if requirement is None:
        incidence = INCIDENCE_DEG if max_incidence_deg is None else max_incidence_deg
        return Requirement(max_incidence_deg=incidence, max_range_m=max_range_m)
    for name, value in (("max_incidence_deg", max_incidence_deg), ("max_range_m", max_range_m)):
        if value is not None:
            raise InputError(
                f"give requirement or {name}, not both: the requirement says {name} = "
                f"{getattr(requirement, name)}, beside it stands {value:g}"
            )
    return requirement


def _resolve_zones(zones: Zones, of_options: Zones) -> Zones:
    """Return the zones, which may stand in the planner's options instead."""
    if of_options.is_everywhere or of_options is zones:
        return zones
    if not zones.is_everywhere:
        raise InputError("zones are given twice, as zones and in options.zones; give one of the two")
    return of_options
