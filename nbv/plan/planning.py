# SPDX-License-Identifier: MIT
"""Planning: views of a known scene in simulation, by the online planner or by model-known cover."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal, cast, get_args

import numpy as np

from nbv.cover.overlap import OverlapOptions
from nbv.cover.pipeline import CoverOptions
from nbv.online.planner import PlannerOptions
from nbv.plan.baseline_plan import BASELINES, plan_simply
from nbv.plan.offline_plan import plan_offline
from nbv.plan.plan import Plan
from nbv.plan.problem import PlanningProblem
from nbv.plan.remote_visibility import RemoteVisibility
from nbv.plan.simulated_plan import plan_online, plan_with_completion
from nbv.scanning.sensor import Sensor, chosen_effects, with_effects
from nbv.scanning.sensor_profile import load_sensor
from nbv.visibility.instances import patch_samples, with_aperture
from nbv.visibility.requirement import Requirement
from nbv.visibility.samples import SurfaceSamples
from nbv.visibility.site_options import SiteOptions
from nbv.visibility.standing.candidates import Standing, counted, find_standing, samples_that_count, within
from nbv.visibility.viewpoints import Candidates, allowed
from nbv.visibility.visibility import Progress
from nbv.visibility.zones import EVERYWHERE, Zones
from scenes.checks import InputError, check_kind, check_rng
from scenes.io.scene_files import open_scene
from scenes.run.journal import NO_JOURNAL, Journal
from scenes.scan.range_image import RangeImage
from scenes.world.scene import Mode, Scene

Method = Literal[
    "nbv", "cover", "greedy", "visibility", "farthest", "random", "rule:grid5m", "rule:rooms-and-doorways"
]
if TYPE_CHECKING:
    from trimesh import Trimesh

_INCIDENCE_DEG = 60.0  # that counts as measured where nothing else is said


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
    scans: Sequence[RangeImage] = (),
    zones: Zones = EVERYWHERE,
    remote: RemoteVisibility | None = None,
    journal: Journal = NO_JOURNAL,
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
    scene : Scene, path or trimesh.Trimesh
        The true scene, or the mesh file or mesh that it is made of (`open_scene`, `Scene.from_mesh`).
    sensor : Sensor, optional
        "generic60" when not given.
    method : "nbv", "cover", "greedy", "visibility", "farthest", "random", "rule:grid5m" or \
"rule:rooms-and-doorways"
        Which planner; all but the first two are baselines (`nbv.plan.baseline_plan`).
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
        Where the sensor may stand (`nbv.visibility.standing.candidates.find_standing`), for many plans of one
        scene; instead of `site` and `candidates`.
    samples : SurfaceSamples, optional
        Where coverage is measured; `nbv.visibility.samples.sample_surface` when not given.
    noise : str
        Noise model of the simulated scans, and what a largest standard deviation reckons with; of a sensor
        with errors of its own "none" leaves the latter.
    options : PlannerOptions, optional
        For "nbv".
    budgets : CoverOptions, optional
        For "cover".
    overlap : OverlapOptions, optional
        For "cover": how scans must overlap so that all can be registered with one another.
    infer : bool
        Whether surface that completion models or infers from the scans so far counts towards the target
        (`nbv.coverage.surface_classes`), outranked by unknown surface. Such a plan has no lower bound.
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
    if method not in get_args(Method):
        raise InputError(f"method must be one of {', '.join(get_args(Method))}, got {method!r}")
    if not 0 < target <= 1:
        cure = f"; write {target / 100:g} for {target:g} %" if 1 < target <= 100 else ""
        raise InputError(
            f"target must be a fraction of the reachable area, 0 < target <= 1, got {target:g}{cure}"
        )
    if views is not None and views < 1:
        raise InputError(f"views must be at least 1, got {views}")
    if infer and method in BASELINES:
        raise InputError(f"completion can stand in for views of method nbv or cover, not of {method}")
    if overlap is not None and method != "cover":
        raise InputError(f"overlap is asked of plans of a known scene: method cover, not {method}")
    if remote is not None and method == "nbv":
        raise InputError("workers cast for planners that know the scene: they do not serve method nbv")
    if infer and overlap is not None:
        raise InputError("a plan in which completion stands in for views cannot also ask for overlap")
    if mode not in (None, "room", "object"):
        raise InputError(f"mode must be room or object, got {mode!r}")
    scene = _as_scene(scene, mode)
    if candidates is not None:
        cure = "Candidates(positions, directions) holds where the sensor may be and look"
        check_kind("candidates", candidates, Candidates, cure)
    if samples is not None:
        check_kind("samples", samples, SurfaceSamples, "sample_surface(scene.mesh, spacing_m) makes them")
    check_rng(rng)
    if site.start is not None and (candidates is not None or (mode or scene.mode) == "object"):
        raise InputError(
            "a start is a place on the floor of a room, which objects and given candidates have not; "
            "leave --start out"
        )
    options = options or PlannerOptions()
    zones = _one_zones(zones, options.zones)
    sensor = with_aperture(sensor or load_sensor("generic60"), candidates)
    if candidates is not None:
        standing = Standing(candidates, candidates, None)
    elif standing is None:
        standing = find_standing(scene, sensor, site, mode=mode, subdivisions=2 if method == "nbv" else 1)
    requirement = _one_requirement(requirement, max_incidence_deg, max_range_m)
    if requirement.max_sd_m is not None and noise != "none":
        sensor = with_effects(sensor, chosen_effects(sensor, noise))
    requirement.limits(sensor)  # raises before anything is cast
    caster = scene.ray_caster(n_threads)
    samples = samples or patch_samples(scene, caster, standing.candidates)
    if samples is None:
        samples, apart = samples_that_count(scene, standing, caster, zones)
    else:
        samples, apart = counted(within(samples, zones, scene), standing, caster)
    problem = PlanningProblem(
        scene=scene,
        sensor=sensor,
        requirement=requirement,
        target=target,
        candidates=allowed(standing.candidates, zones),
        proposals=allowed(standing.proposals, zones),
        site=standing.site,
        samples=samples,
        apart_m2=apart,
        caster=caster,
        seed=int(rng) if isinstance(rng, int | np.integer) else None,
        from_outside=(mode or scene.mode) == "object",
        overlap=overlap,
        infer=infer,
        n_threads=n_threads,
        progress=progress,
        scans=tuple(scans),
        zones=zones,
        remote=remote,
        journal=journal,
    )
    if method == "cover" and infer:
        return plan_with_completion(problem, views, noise, rng)
    if method == "cover":
        return plan_offline(problem, views, budgets or CoverOptions(), rng)
    if method in BASELINES:
        return plan_simply(problem, method, views, rng)
    return plan_online(problem, views, noise, options, rng)


def _as_scene(scene: object, mode: str | None) -> Scene:
    """Return the scene that a path or a mesh holds; a scene as it is."""
    if isinstance(scene, Scene):
        return scene
    asked = cast("Mode | None", mode)
    if isinstance(scene, str | os.PathLike):
        return open_scene(scene, mode=asked)
    return Scene.from_mesh(scene, mode=asked)


def _one_requirement(
    requirement: Requirement | None, max_incidence_deg: float | None, max_range_m: float | None
) -> Requirement:
    """Return what counts as measured, refusing a requirement beside single values."""
    if requirement is None:
        incidence = _INCIDENCE_DEG if max_incidence_deg is None else max_incidence_deg
        return Requirement(max_incidence_deg=incidence, max_range_m=max_range_m)
    for name, value in (("max_incidence_deg", max_incidence_deg), ("max_range_m", max_range_m)):
        if value is not None:
            raise InputError(
                f"give requirement or {name}, not both: the requirement says {name} = "
                f"{getattr(requirement, name)}, beside it stands {value:g}"
            )
    return requirement


def _one_zones(zones: Zones, of_options: Zones) -> Zones:
    """Return the zones, which may stand in the planner's options instead."""
    if of_options.is_everywhere or of_options is zones:
        return zones
    if not zones.is_everywhere:
        raise InputError("zones are given twice, as zones and in options.zones; give one of the two")
    return of_options
