# SPDX-License-Identifier: MIT
"""Views that completion saves: planned plainly, planned plainly and completed afterwards, planned with it.

From the same starting poses: (a) the explorer, until the share of the reachable area is met; (b) the views of
(a), completed afterwards, until met, modelled and inferred surface together reach the share; (c) the planner
that completes the scans so far. `examples/plot_inference_study.py` makes the page of it.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.cases.frames import DATA
from benchmarks.cases.houses.house import random_house
from benchmarks.run import head, row, suite
from nbv.coverage.coverage import UNREACHABLE, Coverage
from nbv.coverage.measurement import CoverageTally
from nbv.coverage.surface_classes import ClassShares, KnownSurfaces, classify, shares_of
from nbv.online.limits import RENEWED
from nbv.plan.planning import plan_views
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor, Sensor, SphericalSensor
from nbv.scanning.sensor_profile import load_sensor
from scenes.checks import BoolArray
from scenes.io.scene_files import open_scene
from scenes.scan.range_image import RangeImage
from scenes.world.builtin import builtin_scene
from scenes.world.scene import Scene

TARGETS = (0.95, 0.99)
MOST_VIEWS = 45
SCENES = {
    "office": ("generic60", 120),
    "flat 37": ("panorama", 300),
    "flat 39": ("panorama", 240),
    "flat 35": ("panorama", 240),
}
"""Sensor of each scene, and its pixels in a row. The office and flat 37 served to tune, the others test."""


@dataclass(frozen=True)
class Run:
    """One start: (a) plain, (b) plain with completion afterwards, (c) completion-aware.

    `plain` is the share of the area met after each view; `after` and `aware` hold the classes whenever the
    scans were completed; `reachable` is the share of the area that any candidate can measure as required.
    """

    reachable: float
    plain: tuple[float, ...]
    after: tuple[ClassShares, ...]
    aware: tuple[ClassShares, ...]

    def plain_views(self, target: float) -> float:
        """Views that (a) takes to meet `target` of the reachable area; inf for never."""
        wanted = target * self.reachable - 1e-9
        return next((k for k, met in enumerate(self.plain, start=1) if met >= wanted), np.inf)


def reached(shares: Sequence[ClassShares], target: float) -> ClassShares | None:
    """Return what (b) or (c) was when met, modelled and inferred together first held the same share."""
    return next((one for one in shares if one.reached >= target - 1e-9), None)


def views_to(shares: Sequence[ClassShares], target: float) -> float:
    """Views after which met, modelled and inferred surface together reach a share; inf for never."""
    found = reached(shares, target)
    return np.inf if found is None else found.views


def right_share(found: ClassShares | None) -> float:
    """Share of the inferred area that is right; 1 of none, nan where the target was never reached."""
    if found is None:
        return np.nan
    return found.right_m2 / found.inferred_m2 if found.inferred_m2 > 0 else 1.0


def study(
    scene: Scene,
    sensor: Sensor,
    seed: int,
    *,
    most: int = MOST_VIEWS,
    every: bool = False,
    n_threads: int | None = None,
) -> Run:
    """Plan from one start, plainly and with completion, at most so many views.

    The views of the plain plan are completed after each scan, or, where not `every` of them, only where
    bisection looks for the number of views that reach a target.
    """
    given: dict[str, Any] = {"rng": seed, "views": most, "target": max(TARGETS), "n_threads": n_threads}
    plain, aware = plan_views(scene, sensor, **given), plan_views(scene, sensor, infer=True, **given)
    assert isinstance(plain.coverage, Coverage)  # a fresh plan holds its full coverage
    samples, caster = plain.coverage.samples, scene.ray_caster(n_threads)
    tally = CoverageTally.start(caster, samples, plain.requirement)
    possible = plain.coverage.state != UNREACHABLE
    scans, states = list[RangeImage](), list[tuple[BoolArray, BoolArray]]()
    for view in plain.views:
        tally.add(view)
        scans.append(scan_scene(scene, view, rng=0, caster=caster))
        states.append((tally.met.copy(), tally.n_views > 0))

    @cache
    def after(n: int) -> ClassShares:
        completed = KnownSurfaces.of(scans[:n], relates=False, n_threads=n_threads)
        classes = classify(samples, *states[n - 1], completed)
        return shares_of(classes, samples, possible, completed, scene.mesh, n)

    if every:
        found = list(_until_reached(after, len(scans)))
    else:
        numbers = {_bisected(after, target, len(scans)) for target in TARGETS}
        found = [after(n) for n in sorted(numbers)]
    met = tuple(view.met_fraction or 0.0 for view in plain.views)
    return Run(plain.coverage.reachable, met, tuple(found), aware.shares)


def _until_reached(after: Callable[[int], ClassShares], most: int) -> Iterator[ClassShares]:
    """Yield the shares after each number of views at which (c) completes too, until the last target."""
    last = 0
    for n in range(1, most + 1):
        if n >= RENEWED * last:
            last, shares = n, after(n)
            yield shares
            if shares.reached >= max(TARGETS) - 1e-9:
                return


def _bisected(after: Callable[[int], ClassShares], target: float, most: int) -> int:
    """Return a number of views that reaches the target while one less does not; `most` where none does."""
    low, high = 0, most
    while high - low > 1:
        middle = (low + high) // 2
        if after(middle).reached >= target - 1e-9:
            high = middle
        else:
            low = middle
    return high


def with_width(sensor: Sensor, width: int) -> Sensor:
    """Return a camera or a panoramic scanner with so many pixels in a row, as wide as before."""
    assert isinstance(sensor, PinholeSensor | SphericalSensor)
    return replace(sensor, width=width, height=max(round(sensor.height * width / sensor.width), 2))


def scene_of(name: str) -> Scene:
    """Return a built-in scene, a generated flat ("flat 25") or that of a file of the data's folder."""
    if name.startswith("flat "):
        return random_house(int(name.removeprefix("flat "))).scene
    return open_scene(DATA / name) if Path(name).suffix else builtin_scene(name)


@suite("aware-views", smallest="--scene office --starts 1 --width 48 --most 2")
def aware_views(
    scene: list[str] | None = None,
    starts: int = 1,
    first: int = 0,
    sensor: str | None = None,
    width: int | None = None,
    most: int = MOST_VIEWS,
) -> Iterator[str]:
    """Views until 95 and 99 % of the area is met, modelled or inferred: planned plainly, and with completion.

    --scene: built-in, "flat SEED", or a file of the data's folder; --sensor and --width (pixels in a row):
    of all scenes; --first: start.
    """
    yield from head(
        "scene", "start", "share", "(a) plain", "(b) completed afterwards", "(c) aware", "(c) / (b)",
        "of (c)'s inferred m2", "right",
    )  # fmt: skip
    ratios: dict[float, list[float]] = {target: [] for target in TARGETS}
    for name in scene or SCENES:
        profile, pixels = SCENES.get(name, SCENES["office"])
        small = with_width(load_sensor(sensor or profile), width or pixels)
        for start in range(first, first + starts):
            run = study(scene_of(name), small, start, most=most)
            for target in TARGETS:
                views = [run.plain_views(target), views_to(run.after, target), views_to(run.aware, target)]
                found, known = reached(run.aware, target), np.isfinite(views[1:]).any()
                ratio = views[2] / views[1] if known else np.nan  # 0 where only (c) reaches it
                ratios[target].append(ratio)
                yield row(
                    name, start, f"{100 * target:g} %", *(f"{n:g}" for n in views), f"{ratio:.2f}",
                    "" if found is None else f"{found.inferred_m2:.2f}", f"{100 * right_share(found):.1f} %",
                )  # fmt: skip
    for target, found_ratios in ratios.items():
        middle = np.median([ratio for ratio in found_ratios if not np.isnan(ratio)] or [np.nan])
        yield f"median of (c) / (b) to {100 * target:g} %: {middle:.2f}"
