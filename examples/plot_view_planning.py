# SPDX-License-Identifier: MIT
"""The study of docs/results/planning.md: how many views a room with occluders takes when it is known.

Run it with `python examples/plot_view_planning.py [--docs FOLDER] [--steps N] [--finest M] [--quick]`; it
prints the tables of the page and makes its pictures. Few steps and coarse samples are quick; `--quick` takes
both, candidates far apart, and leaves out the benchmark's instance and the panorama.
"""

import argparse
import os
import time
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
from scipy.sparse import csc_array, csr_array

mpl.use("Agg")
from matplotlib import pyplot as plt

from nbv import (
    Candidates,
    CoverOptions,
    PinholeSensor,
    Requirement,
    Sensor,
    load_candidates,
    load_sensor,
    measure_coverage,
    plan_views,
    sample_surface,
)
from nbv.cover.dual import find_certificate, reduce_instance
from nbv.cover.instance import CoverInstance
from nbv.cover.overlap import OverlapOptions
from nbv.cover.swap_search import choose_greedily, drop_redundant, polish
from nbv.visibility.clearance import Clearance
from nbv.visibility.viewpoints import room_lattice, sensor_directions
from nbv.visibility.visibility import orient, visible_from_positions
from scenes import Scene, builtin_scene
from scenes.world.builtin import Finish, SceneBuilder

BENCH = Path(os.environ.get("UNSEEN_BENCH", Path(__file__).parents[2] / "shared" / "bench"))
CONE = PinholeSensor(fov_deg=60, width=320, height=320, name="cone of 60 deg", aperture="circular")
BLUE, RED, GREY = "#1f5fa8", "#c8332b", "#9a9a9a"
ANGLES = (75, 60, 45)
_FEWEST, _HARDEST = 2500, 1000  # samples with which the growing of an instance begins
_ROUNDS = 10


def candidates_of(scene: Scene, sensor: PinholeSensor, spacing_m: float = 0.5) -> Candidates:
    """Return free positions on a lattice with the sensor's directions."""
    lattice = room_lattice(scene.mesh.bounds(), spacing_m=spacing_m)
    free = Clearance.of(scene.mesh, 0.3).holds(lattice)
    return Candidates(lattice[free], sensor_directions(sensor, 1))


def room_with(n_boxes: int) -> Scene:
    """Return a room of 6 x 5 x 2.7 m with boxes on the floor, the same first ones for every number."""
    build, rng = SceneBuilder(f"{n_boxes} boxes", "room"), np.random.default_rng(4)
    plain = Finish((0.7, 0.7, 0.7))
    build.add_box("room", (0, 0, 0), (6, 5, 2.7), plain, inward=True)
    cells = rng.permutation([(x, y) for x in (0.6, 1.95, 3.3, 4.65) for y in (0.7, 2.05, 3.4)])
    for k in range(n_boxes):
        size = rng.uniform([0.4, 0.4, 0.5], [0.75, 0.9, 1.9])
        low = np.array([*cells[k], 0.0])
        build.add_box(f"box {k + 1}", low, low + size, plain)
    return build.finish()


def angles(room: Scene, steps: int, finest_m: float) -> None:
    """Print views, bounds and times on the benchmark's instance, and what finer samples say of the plans."""
    candidates = load_candidates(BENCH / "room_candidates.npz")
    fine = sample_surface(room.mesh, finest_m)
    print(
        "\n| within | views | at least | met of 3 cm samples | unmet, m2 | tour | with 20 % overlap | time |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for angle in ANGLES:
        options = {
            "method": "cover",
            "candidates": candidates,
            "target": 1.0,
            "max_incidence_deg": angle,
            "rng": 0,
        }
        started = time.perf_counter()
        plan = plan_views(room, budgets=CoverOptions(polish_steps=steps), **options)
        seconds = time.perf_counter() - started
        joined = plan_views(
            room, budgets=CoverOptions(polish_steps=steps), overlap=OverlapOptions(min_overlap=0.2), **options
        )
        again = measure_coverage(
            room, plan.views, Requirement(max_incidence_deg=angle), samples=fine, candidates=candidates
        )
        unmet = (again.reachable - again.met) * again.total_m2
        print(
            f"| {angle}\u00b0 | {len(plan.views)} | {plan.lower_bound.views} "
            f"| {100 * again.met_of_reachable:.2f} % | {unmet:.2f} | {plan.stations.tour.length_m:.0f} m "
            f"| {len(joined.views)}, {joined.stations.n_groups} group | {seconds:.0f} s |"
        )


def grown_plan(
    scene: Scene, candidates: Candidates, sensor: Sensor, spacing_m: float, angle: float, steps: int
) -> tuple[int, int]:
    """Return views and bound of a plan that meets every coverable sample, also where these are many.

    Some of the samples are planned for at first, the hardest among them; those that a plan leaves unmet join
    them, and what is left after a few rounds gets views of its own. A bound for some samples is one for all.
    """
    samples = sample_surface(scene.mesh, spacing_m)
    limits = Requirement(max_incidence_deg=angle).limits(sensor)
    seen = visible_from_positions(scene.ray_caster(), candidates.positions, samples, limits)
    by_sample = seen.tocsc()
    n_seers = np.diff(by_sample.indptr)
    coverable = np.flatnonzero(n_seers)
    hardest = coverable[np.argsort(n_seers[coverable], kind="stable")][:_HARDEST]
    active = np.union1d(hardest, coverable[:: max(len(coverable) // _FEWEST, 1)])
    for _ in range(_ROUNDS):
        instance = instance_of(by_sample, active, candidates, samples.points, sensor)
        reduction = reduce_instance(instance)
        reduced = reduction.instance
        found = polish(reduced, drop_redundant(reduced, choose_greedily(reduced)), steps, rng=0).chosen
        chosen = [int(c) for c in reduction.candidates[list(found)]]
        unmet = np.setdiff1d(coverable, met_by(chosen, seen, candidates, samples.points, sensor))
        if not len(unmet):
            break
        active = np.union1d(active, unmet[:: max(len(unmet) // 400, 1)])
    bound = find_certificate(reduction, instance.weights, len(found)).bound(instance)
    if len(unmet):
        chosen += choose_greedily(instance_of(by_sample, unmet, candidates, samples.points, sensor))
    return len(chosen), bound


def instance_of(
    by_sample: csc_array, active: np.ndarray, candidates: Candidates, points: np.ndarray, sensor: Sensor
) -> CoverInstance:
    """Return the instance of some of the samples."""
    own = csr_array(by_sample[:, active])
    matrix = orient(own, candidates.positions, candidates.rotations(), points[active], sensor)
    return CoverInstance(matrix, np.ones(len(active)))


def met_by(
    chosen: list[int], seen: csr_array, candidates: Candidates, points: np.ndarray, sensor: Sensor
) -> np.ndarray:
    """Return the samples that the chosen poses meet."""
    met = []
    for number in chosen:
        i = number // candidates.n_directions
        pose = candidates.pose(number)
        own = seen.indices[seen.indptr[i] : seen.indptr[i + 1]]
        met.append(own[sensor.sees((points[own] - pose.translation) @ pose.rotation)])
    return np.unique(np.concatenate(met))


def drawn(
    folder: Path, name: str, title: str, axis: str, rows: list[tuple[float, int, int]], **scale: str
) -> None:
    """Print a table of (what varies, views, bound), and draw it."""
    print(f"\n| {axis} | views | at least |\n|---|---|---|")
    for row in rows:
        print(f"| {row[0]:g} | {row[1]} | {row[2]} |", flush=True)
    what, views, bound = np.array(rows, float).T
    figure, axes = plt.subplots(figsize=(7.2, 3.6), layout="constrained")
    axes.fill_between(what, bound, views, color=BLUE, alpha=0.15, label="where the optimum lies")
    axes.plot(what, views, "o-", color=BLUE, label="views of the plan")
    axes.plot(what, bound, "v--", color=RED, label="certified lower bound")
    axes.set(xlabel=axis, ylabel="views", title=title, ylim=(0, 1.1 * views.max()), **scale)
    axes.set_xticks(what, [f"{value:g}" for value in what])
    axes.minorticks_off()
    axes.grid(alpha=0.3)
    axes.legend(frameon=False)
    figure.savefig(folder / f"view_planning_{name}.png", dpi=110)
    plt.close(figure)


def main(arguments: list[str] | None = None) -> None:
    """Print the tables and make the pictures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--docs", type=Path, default=Path(__file__).parents[1] / "docs")
    parser.add_argument("--steps", type=int, default=20_000, help="swaps for each plan")
    parser.add_argument("--finest", type=float, default=0.03, metavar="M", help="between the finest samples")
    parser.add_argument("--quick", action="store_true")
    given = parser.parse_args(arguments)
    if given.quick:
        given.steps, given.finest = 100, 0.2
    folder = given.docs / "pictures"
    folder.mkdir(parents=True, exist_ok=True)
    room = builtin_scene("two_occluders")
    if BENCH.is_dir() and not given.quick:
        angles(room, given.steps, given.finest)
    apart = {"spacing_m": 1.0} if given.quick else {}
    here = candidates_of(room, CONE, **apart)
    sizes = (0.4, 0.2) if given.quick else [size for size in (0.2, 0.1, 0.05, 0.03) if size >= given.finest]
    rows = [(100 * size, *grown_plan(room, here, CONE, size, 60, given.steps)) for size in sizes]
    drawn(folder, "patches", "Finer samples, more views (60\u00b0)", "cm between samples", rows, xscale="log")
    rows = []
    for spacing in (1.4, 1.0) if given.quick else (1.0, 0.7, 0.5, 0.4):
        near = candidates_of(room, CONE, spacing)
        rows.append((spacing, *grown_plan(room, near, CONE, 0.2, 60, given.steps)))
    drawn(folder, "spacing", "More candidates save next to nothing (60\u00b0)", "m between candidates", rows)
    rows = []
    for n_boxes in range(0, 3 if given.quick else 9, 2):
        scene = room_with(n_boxes)
        near = candidates_of(scene, CONE, **apart)
        rows.append((n_boxes, *grown_plan(scene, near, CONE, max(0.1, given.finest), 60, given.steps)))
    drawn(
        folder,
        "occluders",
        "Occluders cost views (60\u00b0, samples 10 cm apart)",
        "boxes on the floor",
        rows,
    )
    if given.quick:
        return
    turning = replace(load_sensor("panorama"), name="panorama")
    print("\n| panorama within | views | at least |\n|---|---|---|")
    for angle in ANGLES:
        found = grown_plan(room, candidates_of(room, turning), turning, 0.05, angle, given.steps)
        print(f"| {angle}\u00b0 | {found[0]} | {found[1]} |", flush=True)


if __name__ == "__main__":
    main()
