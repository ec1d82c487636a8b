# SPDX-License-Identifier: MIT
"""Cases: the plans of a study, named by what they are made of, and how each is planned."""

from __future__ import annotations

import hashlib
import re
import time
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import Any

from nbv.cover.overlap import OverlapOptions
from nbv.cover.pipeline import CoverOptions
from nbv.coverage.coverage import Coverage
from nbv.plan.planning import plan_views
from nbv.run.manifest import sha256_of, versions
from nbv.scanning.sensor import Sensor, chosen_effects
from nbv.scanning.sensor_profile import load_sensor
from nbv.study.spec import PlannerEntry, RequirementEntry, Sampling, SceneEntry, SensorEntry, StudySpec
from nbv.visibility.candidates import Standing, find_standing, restrict_to_rooms, samples_that_count
from nbv.visibility.samples import SurfaceSamples, sample_surface
from scenes.checks import InputError, Value
from scenes.io.scene_files import open_scene
from scenes.run.atomic import json_text
from scenes.world.scene import Scene

_SLUG = re.compile(r"[^a-z0-9]+")
_LONGEST = 24  # characters of each part of a name


@dataclass(frozen=True, slots=True)
class Case(Value):
    """One plan of a study, made of its entries.

    `key` is the SHA-256 of all that its result depends on: the scene's bytes, sensor, requirement, planner,
    sampling, seed, and the versions of the numeric packages.
    """

    name: str
    key: str
    scene: SceneEntry
    sensor: SensorEntry
    requirement: RequirementEntry
    planner: PlannerEntry
    sampling: Sampling
    seed: int

    def labels(self) -> dict[str, Any]:
        """Return what the case is of, as columns of the results."""
        return {
            "scene": self.scene.label,
            "sensor": self.sensor.label,
            "requirement": self.requirement.label,
            "planner": self.planner.label,
            "seed": self.seed,
        }

    def settings(self) -> dict[str, float | int | None]:
        """Return what was asked for in numbers, as columns of the results."""
        asked = self.requirement
        return {
            "max_incidence_deg": asked.max_incidence_deg,
            "max_range_m": asked.max_range_m,
            "min_density_per_m2": asked.min_density_per_m2,
            "max_sd_m": asked.max_sd_m,
            "k": asked.k,
            "target": self.planner.target,
            "spacing_m": self.scene.spacing_m or self.sampling.spacing_m,
        }


def cases_of(spec: StudySpec, first_seed: int = 0) -> tuple[Case, ...]:
    """Return the cases in the order of the study file, the scene first; all scenes and sensors are opened.

    Raises
    ------
    InputError
        A scene or sensor that cannot be used, or errors that a requirement asks for and a sensor lacks.
    """
    scenes = [(entry, identity_of(entry)) for entry in spec.scenes]
    sensors = [(entry, load_sensor(entry.sensor)) for entry in spec.sensors]
    for (entry, sensor), asked in product(sensors, spec.requirements):
        gate = (sensor.min_range_m, sensor.max_range_m)
        effects = sensor.effects if entry.noise == "none" else chosen_effects(sensor, entry.noise)
        asked.requirement().limits_of(sensor.projection.pixel_angle, effects, gate)
    common = {"versions": versions(), "sampling": spec.sampling.model_dump()}
    cases = []
    for scene, sensor_, asked, planner, seed in product(
        scenes, sensors, spec.requirements, spec.planners, spec.seeds
    ):
        made_of = {
            **common,
            "scene": {**scene[0].model_dump(exclude={"name", "scene"}), "content": scene[1]},
            "sensor": {"profile": sensor_[1].to_json(), "noise": sensor_[0].noise},
            "requirement": asked.model_dump(exclude={"name"}),
            "planner": planner.model_dump(exclude={"name"}),
            "seed": first_seed + seed,
        }
        key = hashlib.sha256(json_text(made_of, indent=None).encode()).hexdigest()
        parts = [entry.label for entry in (scene[0], sensor_[0], asked, planner)]
        name = "-".join([*map(slug, parts), f"seed{first_seed + seed}", key[:8]])
        cases.append(
            Case(
                name=name,
                key=key,
                scene=scene[0],
                sensor=sensor_[0],
                requirement=asked,
                planner=planner,
                sampling=spec.sampling,
                seed=first_seed + seed,
            )
        )
    return tuple(cases)


def identity_of(entry: SceneEntry) -> str:
    """Return what stands for a scene's content, after seeing that it opens."""
    open_scene(entry.scene, up=entry.up, units=entry.units, mode=entry.mode)
    return entry.scene if entry.is_builtin else sha256_of(Path(entry.scene))


def slug(label: str) -> str:
    """Return a label as part of a file's name."""
    return _SLUG.sub("_", label.lower())[:_LONGEST].strip("_") or "x"


@dataclass(frozen=True, slots=True, eq=False)
class CaseSetting:
    """A scene and a sensor, where it may stand, and where coverage is measured."""

    scene: Scene
    sensor: Sensor
    standing: Standing
    samples: SurfaceSamples


@lru_cache(maxsize=1)  # neighbours in the list of cases are of the same scene and sensor
def load_setting(scene: SceneEntry, sensor: SensorEntry, sampling: Sampling) -> CaseSetting:
    """Return the scene and sensor of entries, opened, with its samples; the last ones are kept."""
    world = open_scene(scene.scene, up=scene.up, units=scene.units, mode=scene.mode)
    device = load_sensor(sensor.sensor)
    standing = find_standing(world, device, mode=scene.mode, subdivisions=sampling.subdivisions)
    spacing, caster = scene.spacing_m or sampling.spacing_m, world.ray_caster()
    if spacing is None:
        samples, _ = samples_that_count(world, standing, caster)
    else:
        samples, _ = restrict_to_rooms(sample_surface(world.mesh, spacing), standing, caster)
    return CaseSetting(world, device, standing, samples)


def run_case(case: Case, n_threads: int | None = None) -> dict[str, Any]:
    """Plan a case; return its record: the contents of a `plan.json`, with what it is of beside it.

    A case that cannot be planned has an "error" instead of a plan. "times" tells the seconds that it took by
    the clock, and those of the processor.
    """
    head = {"case": case.name, "key": case.key, "labels": case.labels()}
    begin = time.perf_counter(), time.process_time()
    try:
        plan = _plan_case(case, n_threads)
    except InputError as error:
        return {**head, "error": str(error)}
    times = {"seconds": time.perf_counter() - begin[0], "cpu_seconds": time.process_time() - begin[1]}
    if not isinstance(plan.coverage, Coverage):
        raise TypeError("a fresh plan holds its full coverage")
    tour = None if plan.stations is None else plan.stations.tour
    return {
        **head,
        "n_samples": len(plan.coverage.samples),
        "tour_m": None if tour is None else tour.length_m,
        "legs_without_way": None if tour is None else tour.n_without_way,
        **plan.to_json(),
        "times": times,
    }


def _plan_case(case: Case, n_threads: int | None) -> Any:
    setting, planner = load_setting(case.scene, case.sensor, case.sampling), case.planner
    steps = planner.polish_steps
    return plan_views(
        setting.scene,
        setting.sensor,
        method=planner.method,
        requirement=case.requirement.requirement(),
        target=planner.target,
        views=planner.views,
        mode=case.scene.mode,
        standing=setting.standing,
        samples=setting.samples,
        noise=case.sensor.noise,
        budgets=None if steps is None else CoverOptions(polish_steps=steps),
        overlap=None if planner.overlap is None else OverlapOptions(min_overlap=planner.overlap),
        infer=planner.infer,
        rng=case.seed,
        n_threads=n_threads,
    )
