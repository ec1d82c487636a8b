# SPDX-License-Identifier: MIT
"""The demo: plan a room with two occluders, complete a few of its scans, and compare with the truth."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from completion.observe.tiles import solve_plane
from completion.options import CompletionOptions
from completion.pipeline import complete
from completion.texturing.pipeline import TexturingOptions
from nbv.commands.options.shared import NoOptions, Shared
from nbv.commands.plan import coverage_of
from nbv.commands.process import start_run
from nbv.plan.plan import CSV_NAME, TRAJECTORY_NAME, write_plan_files
from nbv.plan.planning import plan_views
from nbv.report.demo_report import (
    INFERRED,
    MEASURED,
    UNKNOWN,
    Comparison,
    compare,
    demo_page,
    unreached_share,
)
from nbv.run.wording import count, percent, percent_within, square_metres
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import View
from nbv.scanning.sensor_profile import load_sensor
from nbv.visibility.requirement import SightLimits
from nbv.visibility.samples import SurfaceSamples
from nbv.visibility.visibility import visible_from_view
from scenes.rays.raycast import RayCaster
from scenes.run.atomic import write_json
from scenes.world.builtin import builtin_scene

SCENE, SENSOR = "two_occluders", "generic60"
MAX_INCIDENCE_DEG, TARGET, MOST_VIEWS = 60.0, 0.99, 40
N_SCANS = 4  # that are completed
TEXTURING = TexturingOptions(max_samples=12_000)  # less to search than by default: the demo is to be quick


def run_demo(shared: Shared, _asked: NoOptions | None = None) -> None:
    """Plan views, complete the scans of a few of them, compare with the truth, and write everything."""
    with start_run("demo", shared, default="out/demo", is_folder=True) as run:
        run.read([f"builtin:{SCENE}"])
        scene, sensor, threads = builtin_scene(SCENE), load_sensor(SENSOR), shared.threads
        caster = scene.ray_caster(threads)
        run.will_call(solve_plane, 120)
        plan = plan_views(
            scene,
            sensor,
            max_incidence_deg=MAX_INCIDENCE_DEG,
            target=TARGET,
            views=MOST_VIEWS,
            rng=shared.seed,
            n_threads=threads,
            progress=run.progress,
        )
        run.watch.enter("scan")
        coverage = coverage_of(plan)
        chosen = best_views(plan.views, coverage.samples, caster, N_SCANS)
        scans = [
            scan_scene(scene, plan.views[k], rng=shared.seed, caster=caster, name=f"view {k + 1}")
            for k in chosen
        ]
        options = CompletionOptions(texturing=TEXTURING)
        completion = complete(scans, options, rng=shared.seed, n_threads=threads, progress=run.progress)
        run.watch.enter("save")
        write_json(run.path("plan.json"), plan.to_json())
        write_plan_files(plan.views, plan.visiting_order, run.path(CSV_NAME), run.path(TRAJECTORY_NAME))
        write_json(run.path("coverage.json"), coverage.to_json())
        completion.save(run.stage.folder)
        run.watch.enter("compare")
        comparison = compare(completion, scans, scene.mesh, coverage.samples)
        run.watch.enter("report")
        asked: dict[str, Any] = {
            "scene": SCENE,
            "sensor": SENSOR,
            "max_incidence_deg": MAX_INCIDENCE_DEG,
            "target": TARGET,
            "most_views": MOST_VIEWS,
            "scans_completed": [k + 1 for k in chosen],
            "max_samples": TEXTURING.max_samples,
        }
        run.report(demo_page(scene, plan, chosen, completion, comparison, n_threads=threads), asked)
        summary = {"views": len(plan.views), "met": coverage.met, **summary_of(comparison, chosen)}
        shares = {state: comparison.share(state) for state in (MEASURED, INFERRED, UNKNOWN)}
        errors, unreached = coverage.standard_errors(), unreached_share(coverage)
        hidden = f"; no view reaches {unreached} %" if unreached else ""
        lines = [
            f"the scanner alone: {count(len(plan.views), 'view measures', 'views measure')} "
            f"{percent_within(coverage.met, errors['met'])} % at {MAX_INCIDENCE_DEG:g} deg or less{hidden}",
            f"{len(chosen)} of these scans: measured {percent(shares[MEASURED])} %, "
            f"inferred {percent(shares[INFERRED])} %, unknown {percent(shares[UNKNOWN])} %",
            f"inferred {square_metres(completion.hypothesised_m2)} m2, "
            f"{percent(comparison.within_close)} % of it within 2 cm of the true surface",
            f"open {run.out / 'report.html'}",
        ]
        run.finish(asked, summary, lines)


def best_views(views: Sequence[View], samples: SurfaceSamples, caster: RayCaster, n: int) -> list[int]:
    """Return the numbers, from 0 and in order, of `n` views that see much: each adds the most."""
    seen = [visible_from_view(caster, view, samples, SightLimits())[0] for view in views]
    left = samples.areas.copy()
    chosen: list[int] = []
    for _ in range(min(n, len(views))):
        gains = [float(left[index].sum()) for index in seen]
        chosen.append(max((k for k in range(len(views)) if k not in chosen), key=lambda k: gains[k]))
        left[seen[chosen[-1]]] = 0.0
    return sorted(chosen)


def summary_of(comparison: Comparison, chosen: list[int]) -> dict[str, Any]:
    """Return what the scans and the completion give of the true surface."""
    return {
        "scans": [k + 1 for k in chosen],
        "measured": comparison.share(MEASURED),
        "inferred": comparison.share(INFERRED),
        "unknown": comparison.share(UNKNOWN),
        "inferred_within_2cm": comparison.within_close,
        "inferred_median_distance_m": comparison.median_m,
    }
