# SPDX-License-Identifier: MIT
"""Views that completion saves: planned plainly, planned plainly and completed afterwards, planned with it.

From the same starting poses: (a) the explorer, until the share of the reachable area is met; (b) the views of
(a), completed afterwards, until met, modelled and inferred surface together reach the share; (c) the planner
that completes the scans so far. `examples/plot_inference_study.py` makes the page of it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.cases.frames import DATA
from benchmarks.cases.houses.house import random_house
from benchmarks.run import head, row, suite
from nbv.coverage.coverage import UNREACHABLE
from nbv.coverage.measurement import CoverageTally
from nbv.coverage.surface_classes import ClassShares, KnownSurfaces, classify, shares_of
from nbv.online.limits import RENEWED
from nbv.plan.planning import plan_views
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import Sensor
from nbv.scanning.sensor_profile import load_sensor
from scenes.io.scene_files import open_scene
from scenes.scan.range_image import RangeImage
from scenes.world.builtin import builtin_scene
from scenes.world.scene import Scene

TARGETS = (0.95, 0.99)
MOST_VIEWS = 80
SCENES = ("office", "flat 25", "flat 33", "flat 37")  # flat 25 served to tune, the others to test


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


def study(scene: Scene, sensor: Sensor, seed: int, most: int = MOST_VIEWS, n_threads: int | None = None) -> Run:
    """Plan from one start, plainly and with completion."""
    plain = plan_views(scene, sensor, rng=seed, views=most, target=max(TARGETS), n_threads=n_threads)
    aware = plan_views(
        scene, sensor, rng=seed, views=most, target=max(TARGETS), infer=True, n_threads=n_threads
    )
    samples, caster = plain.coverage.samples, scene.ray_caster(n_threads)
    tally = CoverageTally.start(caster, samples, plain.requirement)
    scans, after = list[RangeImage](), list[ClassShares]()
    possible = plain.coverage.state != UNREACHABLE
    for view in plain.views:
        tally.add(view)
        scans.append(scan_scene(scene, view, rng=0, caster=caster))
        if after and len(scans) < RENEWED * after[-1].views:
            continue
        completed = KnownSurfaces.of(scans, relates=False, n_threads=n_threads)
        classes = classify(samples, tally.met, tally.n_views > 0, completed)
        after.append(shares_of(classes, samples, possible, completed, scene.mesh, len(scans)))
        if reached(after, max(TARGETS)):
            break
    met = tuple(view.met_fraction or 0.0 for view in plain.views)
    return Run(plain.coverage.reachable, met, tuple(after), aware.shares)


def scene_of(name: str) -> Scene:
    """Return a built-in scene, a generated flat ("flat 25") or that of a file of the data's folder."""
    if name.startswith("flat "):
        return random_house(int(name.removeprefix("flat "))).scene
    return open_scene(DATA / name) if Path(name).suffix else builtin_scene(name)


@suite("aware-views", smallest="--scene office --starts 1 --width 48 --most 2")
def aware_views(
    scene: list[str] | None = None,
    starts: int = 2,
    sensor: str = "generic60",
    width: int = 120,
    most: int = MOST_VIEWS,
) -> Iterator[str]:
    """Views to 95 and 99 % of the area that is met, modelled or inferred: planned plainly, and with completion.

    --scene: built-in, "flat SEED", or a file of the data's folder; --width: pixels of the sensor in a row.
    """
    full = load_sensor(sensor)
    small = replace(full, width=width, height=max(round(full.height * width / full.width), 2))
    yield from head(
        "scene", "start", "share", "(a) plain", "(b) completed afterwards", "(c) aware", "(c) / (b)",
        "of (c)'s inferred m2", "right",
    )  # fmt: skip
    ratios: dict[float, list[float]] = {target: [] for target in TARGETS}
    for name in scene or SCENES:
        for start in range(starts):
            run = study(scene_of(name), small, start, most)
            for target in TARGETS:
                views = [run.plain_views(target), views_to(run.after, target), views_to(run.aware, target)]
                found = reached(run.aware, target)
                ratio = views[2] / views[1] if np.isfinite(views[1]) else np.nan
                ratios[target].append(ratio)
                yield row(
                    name, start, f"{100 * target:g} %", *(f"{n:g}" for n in views), f"{ratio:.2f}",
                    "" if found is None else f"{found.inferred_m2:.2f}", f"{100 * right_share(found):.1f} %",
                )  # fmt: skip
    for target, found_ratios in ratios.items():
        yield f"median of (c) / (b) to {100 * target:g} %: {np.median(found_ratios):.2f}"
