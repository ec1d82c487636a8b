# SPDX-License-Identifier: MIT
"""Planning of views: wide instances of the offline planner, and shares measured on samples of a surface."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.cases.frames import DATA
from benchmarks.run import head, row, suite
from benchmarks.store import each, peak_bytes
from nbv.cover.instance import CoverInstance
from nbv.cover.pipeline import CoverOptions, find_cover
from nbv.coverage.coverage import share_error
from nbv.coverage.measurement import CoverageTally
from nbv.plan.baselines import farthest_poses
from nbv.scanning.sensor import View
from nbv.scanning.sensor_profile import load_sensor
from nbv.visibility.candidates import Standing, find_standing, restrict_to_rooms, samples_that_count
from nbv.visibility.requirement import Requirement
from nbv.visibility.samples import SurfaceSamples, sample_surface
from nbv.visibility.site import find_site
from nbv.visibility.site_options import SiteOptions
from nbv.visibility.visibility import orient, visible_from_positions
from scenes.io.scene_files import open_scene
from scenes.mesh.blocks import morton_order
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.mesh.orientation import Axis
from scenes.world.builtin import builtin_scene
from scenes.world.scene import Scene

_SPACING_M = 0.475  # between places: about 16,000 poses


def wide_instance(n_samples: int, target: float) -> CoverInstance:
    """Return which pose meets 60 deg of incidence on which of about so many samples."""
    scene, sensor = builtin_scene("two_occluders"), load_sensor("generic60")
    candidates = find_site(scene, SiteOptions(spacing_m=_SPACING_M)).candidates(sensor)
    samples = sample_surface(scene.mesh, float(np.sqrt(scene.mesh.face_areas().sum() / n_samples)))
    seen = visible_from_positions(
        scene.ray_caster(), candidates.positions, samples, Requirement().limits(sensor)
    )
    seen.data = np.ones(seen.nnz, np.int8)
    matrix = orient(seen, candidates.positions, candidates.rotations(), samples.points, sensor)
    return CoverInstance(matrix, samples.areas, target)


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
    return SurfaceSamples(
        points, mesh.face_normals()[face], equal, face.astype(np.int32), mesh.face_surface[face]
    )


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
    samples, _ = restrict_to_rooms(samples, standing, caster)
    tally = CoverageTally.start(caster, samples, Requirement())
    tally.add_all(views)
    kinds = {"met": tally.met, "seen": tally.n_views > 0}
    total = samples.total_m2
    return {
        name: (float(samples.areas[where].sum()) / total, share_error(samples, where))
        for name, where in kinds.items()
    }


@suite("wide", smallest="--samples 1000 --target 0.5")
def wide(samples: int = 34_000, target: float = 0.99) -> Iterator[str]:
    """The room with two occluders, about 16,000 poses of a camera of 60 deg: views, bound, CPU seconds."""
    begin = time.process_time()
    instance = wide_instance(samples, target)
    m, n = instance.matrix.shape
    yield f"{m} poses, {n} samples, {instance.matrix.nnz:,} entries: {time.process_time() - begin:.1f} s"
    cover = find_cover(instance, CoverOptions(), rng=0)
    yield f"{len(cover.chosen)} views, at least {cover.bound.views}, {cover.steps} swaps"
    yield f"{time.process_time() - begin:.0f} CPU s in all, {(peak_bytes() or 0) / 1e6:.0f} MB at most"


@suite("shares", smallest="--scene builtin:two_occluders --points 10000")
def shares(scene: list[str] | None = None, points: int = 1_000_000) -> Iterator[str]:
    """Shares met and seen from four stations at default sampling beside uniform points, and error bars."""
    names = scene or [name if name.startswith("builtin:") else str(DATA / name) for name in SCENES]
    yield from head("scene", "samples", "share", "default", "error bar", "uniform", "difference", "in bars")
    off, in_bars = [], []
    for number, name in enumerate(names):
        for n, kinds in each(_shares_of, name, number, points):
            for kind, (share, error, truth) in kinds.items():
                off.append(abs(share - truth))
                in_bars.append((share - truth) / error)
                cells = [f"{100 * value:.2f}" for value in (share, error, truth)]
                yield row(
                    Path(name).stem, n, kind, *cells, f"{100 * (share - truth):+.2f}", f"{in_bars[-1]:+.1f}"
                )
    rms = float(np.sqrt(np.mean(np.square(in_bars))))
    yield (
        f"largest difference {100 * max(off):.2f} points; in error bars at most {np.abs(in_bars).max():.1f}, "
        f"root mean square {rms:.2f}, over {len(off)} shares"
    )


def _shares_of(name: str, number: int, points: int) -> tuple[int, dict[str, tuple[float, float, float]]]:
    """Number of samples; each kind of share on them, its error bar, and the share on uniform points."""
    up: Axis = "y" if name.endswith(Y_UP) else "z"
    scene = open_scene(name, up=up, units="mm" if name.endswith(IN_MILLIMETRES) else "m")
    standing = find_standing(scene, load_sensor("panorama" if scene.mode == "room" else "generic60"))
    views = stations_of(scene, standing)
    samples, _ = samples_that_count(scene, standing, scene.ray_caster())
    ours = shares_on(scene, standing, views, samples)
    many = uniform_points(scene.mesh, points, np.random.default_rng(number))
    truth = shares_on(scene, standing, views, many)
    return len(samples), {kind: (share, error, truth[kind][0]) for kind, (share, error) in ours.items()}
