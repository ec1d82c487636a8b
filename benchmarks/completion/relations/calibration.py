# SPDX-License-Identifier: MIT
"""Calibration: how often true relations of rooms are rejected, by the covariances that fits state."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from benchmarks.completion.relations.sensors import SENSORS, SensorErrors
from benchmarks.completion.relations.true_fits import true_fits, true_relations
from benchmarks.completion.scenes.cases import Case
from benchmarks.completion.scenes.rooms import random_case
from benchmarks.completion.scenes.stations import CAMERA
from completion.fitting.result import SurfaceFit
from completion.observe.observation import observe
from completion.relations.engine.estimate import NO_DOUBT, Doubt, Estimate
from completion.relations.engine.relation import Relation
from completion.relations.engine.wald import wald_test
from completion.uncertainty.pipeline import StatedFits, state_fits
from nbv.scanning.effects.effects import Effects
from nbv.scanning.view import View

LEVELS = (0.05, 0.001)


def calibration_table(seeds: Sequence[int], sensors: Sequence[SensorErrors] = SENSORS) -> Iterator[str]:
    """Yield the lines of a table: a sensor each, shares of true relations that are rejected."""
    yield "| sensor | pairs | independent | blocks | stated |"
    yield "|---|---|---|---|---|"
    for sensor in sensors:
        found: dict[str, list[float]] = {"independent": [], "blocks": [], "stated": []}
        for seed in seeds:
            for name, values in rejected(seed, sensor).items():
                found[name] += values
        cells = [_shares(values) for values in found.values()]
        yield f"| {sensor.name} | {len(found['stated'])} | " + " | ".join(cells) + " |"


def rejected(seed: int, sensor: SensorErrors) -> dict[str, list[float]]:
    """Return the p of each true parallel and right angle of a room, by covariances of three kinds."""
    case = _by_camera(random_case(seed)) if sensor.is_camera else random_case(seed)
    scans = [sensor.applied(scan, 10 * seed + k) for k, scan in enumerate(case.scans(Effects(), 0))]
    seen = [observe(scan, case.views[0].world_from_sensor) for scan in scans]
    fits = true_fits(case, seen)
    relations = true_relations([one.true for one in fits])
    alone = [one.fit for one in fits]
    independent = [replace(fit, covariance=fit.covariance_independent) for fit in alone]
    stated = state_fits([one.merged for one in fits], seen, 0.0)
    return {
        "independent": _values(relations, independent, NO_DOUBT),
        "blocks": _values(relations, alone, NO_DOUBT),
        "stated": _values(relations, stated.fits, doubt_of(stated)),
    }


def _by_camera(case: Case) -> Case:
    """The case, seen from the same places by cameras alone."""
    views = tuple(
        view if view.sensor.kind == "pinhole" else View(view.world_from_sensor, CAMERA) for view in case.views
    )
    return replace(case, views=views)


def doubt_of(stated: StatedFits) -> Doubt:
    """Return what is doubtful of some fits."""
    return Doubt(stated.freedom, stated.smooth.covariance_of(range(len(stated.fits))))


def _values(relations: Sequence[Relation], fits: Sequence[SurfaceFit], doubt: Doubt) -> list[float]:
    estimate = Estimate(fits, None, np.zeros(3), doubt)
    return [wald_test(one, estimate).p for one in relations]


def _shares(values: Sequence[float]) -> str:
    return " / ".join(f"{np.mean(np.array(values) < level):.3f}" for level in LEVELS)
