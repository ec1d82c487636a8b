# SPDX-License-Identifier: MIT
"""Views around objects: the online planner beside farthest-point choices and greedy ones that know the model.

Twelve objects, scaled to a bounding-box diagonal of 0.20 m, with candidates on a sphere of 1.2 m that look at
their middle. Scored is the share of the area, of what any candidate sees within 60 deg of its normal, that a
view has seen so; means over starts, in per cent, for 4, 6 and 8 views. Half of the objects tuned the planner
("tuning"), the others did not ("held out").
"""

from collections.abc import Iterator

import numpy as np

from benchmarks.cases.frames import DATA
from benchmarks.run import head, row, suite
from benchmarks.suites.bunny import DIAGONAL_M, RADIUS_M, WELL, choose_greedily
from nbv.online.literature import CRITERIA
from nbv.online.planner import PlannerOptions, explore
from nbv.plan.baselines import farthest_poses
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor
from nbv.visibility.requirement import SightLimits
from nbv.visibility.samples import sample_surface
from nbv.visibility.viewpoints import Candidates, viewing_sphere
from nbv.visibility.visibility import lines_of_sight
from scenes.checks import BoolArray, FloatArray
from scenes.io.scene_files import load_scene
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.pose import Pose
from scenes.scan.range_image import RangeImage
from scenes.world.scene import Scene

OBJECTS = {
    "tuning": (
        "objects/beetle.obj", "objects/cycloidal.ply", "objects/octagonal_pocket.stl", "objects/teapot.obj",
        "objects/CesiumMilkTruck.glb", "cgal/anchor_dense.off",
    ),
    "held-out": (
        "objects/fandisk.obj", "objects/featuretype.STL", "objects/rocker-arm.obj", "objects/spot.obj",
        "objects/stanford-bunny.obj", "cgal/mech-holes-shark.off",
    ),
}  # fmt: skip
SENSOR = PinholeSensor(fov_deg=16, width=256, height=256)  # pixels as fine as the bunny suite's
AT = (4, 6, 8)


class AroundObject:
    """An object, the candidates around it, and which samples each sees well (n_poses, n)."""

    def __init__(self, file: str, n_candidates: int, n_samples: int) -> None:
        mesh = load_scene(DATA / "scenes" / file, up="y", units="m").mesh
        low, high = mesh.bounds()
        vertices = (mesh.vertices - (low + high) / 2) * (DIAGONAL_M / np.linalg.norm(high - low))
        self.scene = Scene(LabelledMesh(vertices, mesh.faces), (None,), ("object",), "object", "object")
        self.caster = self.scene.ray_caster()
        sphere = viewing_sphere(self.scene.mesh.bounds(), SENSOR, n_candidates)
        self.candidates = Candidates(-RADIUS_M * sphere.directions[:, 0], sphere.directions)
        samples = sample_surface(self.scene.mesh, float(np.sqrt(mesh_area(self.scene) / n_samples)))
        limits, everything = SightLimits(min_cosine=WELL), np.arange(len(samples))
        self.well: BoolArray = np.zeros((self.candidates.n_poses, len(samples)), np.bool_)
        for number, position in enumerate(self.candidates.positions):
            self.well[number, lines_of_sight(self.caster, position, samples, limits, everything)[0]] = True
        self.areas = np.where(self.well.any(axis=0), samples.areas, 0.0)

    def shares(self, chosen: list[int]) -> list[float]:
        """Share of the area seen well after 4, 6 and 8 of the chosen views."""
        seen = [self.well[chosen[:k]].any(axis=0) for k in AT]
        return [float(self.areas[met].sum() / self.areas.sum()) for met in seen]

    def explore(self, start: int, options: PlannerOptions) -> list[int]:
        """Return the numbers of the views that the online planner takes."""
        number_of = {self.candidates.pose(k).translation.tobytes(): k for k in range(self.candidates.n_poses)}
        taken: list[int] = []

        def scan(pose: Pose) -> RangeImage:
            taken.append(number_of[pose.translation.tobytes()])
            return scan_scene(self.scene, pose, SENSOR, caster=self.caster, truth=False)

        bounds, first = self.scene.mesh.bounds(), self.candidates.pose(start)
        explore(scan, bounds, first, self.candidates, SENSOR, options=options, from_outside=True)
        return taken


def mesh_area(scene: Scene) -> float:
    """Area of a scene's triangles, square metres."""
    return float(scene.mesh.face_areas().sum())


def _cells(shares: list[list[list[float]]]) -> list[str]:
    """Return planner beside planner for each number of views."""
    means: FloatArray = np.array([np.mean(of_planner, axis=0) for of_planner in shares])
    return [" / ".join(f"{100 * share:.1f}" for share in means[:, k]) for k in range(len(AT))]


@suite("object-views", smallest="--only tuning --first 1 --candidates 30 --samples 1000 --starts 1")
def object_views(
    only: str = "",
    first: int = 6,
    candidates: int = 500,
    samples: int = 8_000,
    starts: int = 4,
    *,
    literature: bool = False,
) -> Iterator[str]:
    """Views around twelve objects: online, farthest-point, and greedy choices that know the model."""
    planners = {"online": PlannerOptions()}
    if literature:
        planners |= {f"online:{name}": PlannerOptions(criterion=name) for name in CRITERIA}
    columns = " / ".join([*planners, "farthest", "greedy"])
    for half in OBJECTS:
        if only not in ("", half):
            continue
        totals: list[list[list[float]]] = [[] for _ in range(len(planners) + 2)]
        yield from head(f"{half}: {columns}", *(f"{k} views" for k in AT))
        for file in OBJECTS[half][:first]:
            around = AroundObject(file, candidates, samples)
            rng = np.random.default_rng(0)
            begin = rng.choice(around.candidates.n_poses, starts, replace=False).tolist()
            many = rng.integers(around.candidates.n_poses, size=10 * starts).tolist()
            found = [
                [around.shares(around.explore(start, _all_views(options))) for start in begin]
                for options in planners.values()
            ]
            found.append([around.shares(farthest_poses(around.candidates, start, max(AT))) for start in many])
            found.append([around.shares(choose_greedily(around.well, start)) for start in begin])
            for total, shares in zip(totals, found, strict=True):
                total.append(np.mean(shares, axis=0).tolist())
            yield row(file.split("/")[1].split(".")[0], *_cells(found))
        yield row("mean", *_cells(totals))


def _all_views(options: PlannerOptions) -> PlannerOptions:
    return PlannerOptions(max_views=max(AT), epsilon_m2=0.0, criterion=options.criterion)
