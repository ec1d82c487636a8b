# SPDX-License-Identifier: MIT
"""Shares at default sampling beside a million uniform points, and whether their error bars hold.

Run it with `python -m benchmarks.shares [--points N] [SCENE...]`: stations spread over each scene (farthest
points among its candidates) measure it at 60 deg of incidence, once on the default samples and once on N
points, uniform over the surface and drawn anew. Printed are the shares that some station meets, and that some
station sees at all, their differences in points of per cent, and these in error bars; without SCENE of the
built-in scenes and those of the data folder (`UNSEEN_DATA`, default ../shared/data).
"""

import argparse
import os
import time
from pathlib import Path

import numpy as np

from nbv.coverage.measurement import CoverageTally
from nbv.coverage.share_error import share_error
from nbv.plan.baselines import farthest_poses
from nbv.scanning.sensors.sensor_profile import load_sensor
from nbv.scanning.view import View
from nbv.visibility.requirement import Requirement
from nbv.visibility.samples import SurfaceSamples
from nbv.visibility.standing.candidates import Standing, counted, find_standing, samples_that_count
from scenes.io.scene_files import open_scene
from scenes.mesh.blocks import morton_order
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.mesh.orientation import Axis
from scenes.world.scene import Scene

DATA = Path(os.environ.get("UNSEEN_DATA", "../shared/data"))
SCENES = (
    "builtin:two_occluders",
    "builtin:office",
    "builtin:drum_and_post",
    "builtin:chair_before_wall",
    "builtin:two_cylinders",
    "builtin:pipe_rack",
    "buildings/duplex.glb",
    "scenes/aws_small_house.glb",
    "scenes/habitat_simple_room.glb",
    "scenes/furniture/blendswap-cc-0/oakChair/oakChair.obj",
    "scenes/objects/stanford-bunny.obj",
    "scenes/objects/CesiumMilkTruck.glb",
)
IN_MILLIMETRES = ("oakChair.obj", "stanford-bunny.obj")
Y_UP = ("duplex.glb", "oakChair.obj", "CesiumMilkTruck.glb")
_STATIONS = 4


def uniform_points(mesh: LabelledMesh, n: int, rng: np.random.Generator) -> SurfaceSamples:
    """Return `n` points, uniform over the surface, each for an equal share of its area."""
    areas = mesh.face_areas()
    face = rng.choice(len(areas), size=n, p=areas / areas.sum())
    u, v = np.sqrt(rng.random(n)), rng.random(n)
    weights = np.column_stack([1 - u, u * (1 - v), u * v])
    weights += 1e-3 * (1 / 3 - weights)  # rays aimed at edges leak
    points = np.einsum("nc,nck->nk", weights, mesh.corners[face])
    order = morton_order(points)
    face, points = face[order], points[order]
    equal = np.full(n, areas.sum() / n)
    return SurfaceSamples(points, mesh.face_normals()[face], equal, face, mesh.face_surface[face])


def stations_of(scene: Scene, standing: Standing) -> list[View]:
    """Return views that are spread over the candidates of a scene."""
    sensor = load_sensor("panorama" if scene.mode == "room" else "generic60")
    poses = farthest_poses(standing.candidates, 0, min(_STATIONS, standing.candidates.n_poses))
    return [View(standing.candidates.pose(number), sensor) for number in poses]


def shares_on(
    scene: Scene, standing: Standing, views: list[View], samples: SurfaceSamples
) -> dict[str, tuple[float, float]]:
    """Return the shares on some samples, and their error bars."""
    caster = scene.ray_caster()
    samples, _ = counted(samples, standing, caster)
    tally = CoverageTally.start(caster, samples, Requirement())
    tally.add_all(views)
    kinds = {"met": tally.met, "seen": tally.n_views > 0}
    total = samples.total_m2
    return {
        name: (float(samples.areas[where].sum()) / total, share_error(samples, where))
        for name, where in kinds.items()
    }


def main(arguments: list[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", nargs="*", metavar="SCENE")
    parser.add_argument("--points", type=int, default=1_000_000)
    asked = parser.parse_args(arguments)
    names = asked.scenes or [name if name.startswith("builtin:") else str(DATA / name) for name in SCENES]
    print("| scene | samples | share | default | error bar | uniform | difference | in bars | s |")
    print("|---|---|---|---|---|---|---|---|---|")
    off, in_bars = [], []
    for number, name in enumerate(names):
        begin = time.perf_counter()
        up: Axis = "y" if name.endswith(Y_UP) else "z"
        scene = open_scene(name, up=up, units="mm" if name.endswith(IN_MILLIMETRES) else "m")
        sensor = load_sensor("panorama" if scene.mode == "room" else "generic60")
        standing = find_standing(scene, sensor)
        views = stations_of(scene, standing)
        samples, _ = samples_that_count(scene, standing, scene.ray_caster())
        ours = shares_on(scene, standing, views, samples)
        many = uniform_points(scene.mesh, asked.points, np.random.default_rng(number))
        truth = shares_on(scene, standing, views, many)
        for kind, (share, error) in ours.items():
            difference = share - truth[kind][0]
            off.append(abs(difference))
            in_bars.append(difference / error)
            print(
                f"| {Path(name).stem} | {len(samples)} | {kind} | {100 * share:.2f} | {100 * error:.2f} | "
                f"{100 * truth[kind][0]:.2f} | {100 * difference:+.2f} | {in_bars[-1]:+.1f} | "
                f"{time.perf_counter() - begin:.0f} |",
                flush=True,
            )
    rms = float(np.sqrt(np.mean(np.square(in_bars))))
    print(
        f"largest difference {100 * max(off):.2f} points; in error bars at most {np.abs(in_bars).max():.1f}, "
        f"root mean square {rms:.2f}, over {len(off)} shares"
    )


if __name__ == "__main__":
    main()
