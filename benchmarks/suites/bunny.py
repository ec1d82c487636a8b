# SPDX-License-Identifier: MIT
"""Views around the Stanford bunny: the online planner beside random, farthest-point and greedy choices.

The mesh is scaled to a bounding-box diagonal of 0.20 m; 500 candidates on a sphere of 1.2 m look at its
centre with 1280 x 720 pixels and a field of view of 70 deg. A true point counts as covered when a scanned
point lies within 2 mm of it, and as seen well when a view sees it within 60 deg of its normal. The planner
knows its voxels and its own scans alone; greedy knows both tables of the truth.

Medians over starts, in per cent of the area, for 2 to 8 views. With --literature the criteria of
`nbv.online.literature` explore from the same starts.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from benchmarks.cases.frames import DATA
from benchmarks.run import head, row, suite
from nbv.online.literature import CRITERIA
from nbv.online.planner import PlannerOptions, explore
from nbv.online.targets import GainOptions
from nbv.plan.baselines import farthest_poses
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor
from nbv.visibility.requirement import SightLimits
from nbv.visibility.samples import SurfaceSamples, sample_surface
from nbv.visibility.viewpoints import Candidates, viewing_sphere
from nbv.visibility.visibility import lines_of_sight
from scenes.io.scene_files import load_scene
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.pose import Pose
from scenes.rays.raycast import RayCaster
from scenes.scan.range_image import RangeImage
from scenes.world.scene import Scene

BUNNY = DATA / "scenes/objects/stanford-bunny.obj"
SENSOR = PinholeSensor(fov_deg=70, width=1280, height=720)
DIAGONAL_M, RADIUS_M, WITHIN_M, WELL = 0.20, 1.2, 0.002, 0.5
N_VIEWS, N_STARTS, N_BLIND = 8, 10, 200

Sequences = list[list[int]]


@dataclass(frozen=True)
class Truth:
    """Which samples each candidate covers within 2 mm, and which it sees within 60 deg (n_poses, n) bool."""

    covered: NDArray[np.bool_]
    well: NDArray[np.bool_]


def load_bunny() -> Scene:
    """Load the bunny, scaled and centred."""
    mesh = load_scene(BUNNY, up="y").mesh
    low, high = mesh.bounds()
    vertices = (mesh.vertices - (low + high) / 2) * (DIAGONAL_M / np.linalg.norm(high - low))
    return Scene(LabelledMesh(vertices, mesh.faces), (None,), ("bunny",), "bunny", "object")


def place_candidates(scene: Scene, n: int) -> Candidates:
    """Return `n` candidates on the sphere of 1.2 m, looking at its middle."""
    sphere = viewing_sphere(scene.mesh.bounds(), SENSOR, n)
    return Candidates(-RADIUS_M * sphere.directions[:, 0], sphere.directions)


def measure_truth(scene: Scene, caster: RayCaster, candidates: Candidates, samples: SurfaceSamples) -> Truth:
    """Scan from every candidate: what the scores, and greedy alone among the planners, are made of."""
    covered, well = np.zeros((2, candidates.n_poses, len(samples)), np.bool_)
    everything = np.arange(len(samples))
    for number in range(candidates.n_poses):
        scan = scan_scene(scene, candidates.pose(number), SENSOR, caster=caster, truth=False)
        tree = cKDTree(scan.points()[scan.valid])
        distance, _ = tree.query(samples.points, distance_upper_bound=WITHIN_M)
        covered[number] = np.isfinite(distance)
        limits = SightLimits(min_cosine=WELL)
        well[number, lines_of_sight(caster, candidates.positions[number], samples, limits, everything)[0]] = 1
    return Truth(covered, well)


def explore_bunny(
    scene: Scene, caster: RayCaster, candidates: Candidates, start: int, options: PlannerOptions
) -> list[int]:
    """Return the numbers of the views that the online planner takes."""
    options = replace(options, max_views=N_VIEWS, epsilon_m2=0.0)
    number_of = {candidates.pose(k).translation.tobytes(): k for k in range(candidates.n_poses)}
    taken: list[int] = []

    def scan(pose: Pose) -> RangeImage:
        taken.append(number_of[pose.translation.tobytes()])
        return scan_scene(scene, pose, SENSOR, caster=caster, truth=False)

    bounds, first = scene.mesh.bounds(), candidates.pose(start)
    explore(scan, bounds, first, candidates, SENSOR, options=options, from_outside=True)
    return taken


def choose_greedily(seen: NDArray[np.bool_], start: int) -> list[int]:
    """Return views that each see most of what is left, in truth."""
    chosen, left = [start], ~seen[start]
    while len(chosen) < N_VIEWS:
        chosen.append(int(np.count_nonzero(seen & left, axis=1).argmax()))
        left &= ~seen[chosen[-1]]
    return chosen


def _medians(name: str, sequences: Sequences, truth: Truth) -> str:
    """Return the medians of a planner as a row of a table."""
    cells = []
    for seen in (truth.covered, truth.well):
        shares = [
            [seen[chosen[:k]].any(axis=0).mean() for k in range(2, N_VIEWS + 1)] for chosen in sequences
        ]
        cells += [f"{100 * share:.2f}" for share in np.median(shares, axis=0)]
    return row(name, len(sequences), *cells)


@suite("bunny", smallest="--candidates 30 --samples 3000 --starts 1 --blind 2")
def bunny(
    candidates: int = 500,
    samples: int = 60_000,
    starts: int = N_STARTS,
    blind: int = N_BLIND,
    *,
    literature: bool = False,
) -> Iterator[str]:
    """Views around the Stanford bunny: online beside random, farthest-point and greedy choices."""
    scene = load_bunny()
    caster, places = scene.ray_caster(), place_candidates(scene, candidates)
    spacing = float(np.sqrt(scene.mesh.face_areas().sum() / samples))
    truth = measure_truth(scene, caster, places, sample_surface(scene.mesh, spacing))
    rng = np.random.default_rng(0)
    first = rng.choice(places.n_poses, starts, replace=False).tolist()
    many = rng.integers(places.n_poses, size=blind).tolist()
    yield from head(
        "planner", "starts", *(f"{what} {k}" for what in ("2 mm,", "60 deg,") for k in range(2, N_VIEWS + 1))
    )
    online = {
        "online": PlannerOptions(),
        "online, w_q = 0": PlannerOptions(gain=GainOptions(quality_weight=0.0)),
        **{f"online:{name}": PlannerOptions(criterion=name) for name in CRITERIA if literature},
    }
    for name, options in online.items():
        yield _medians(name, [explore_bunny(scene, caster, places, start, options) for start in first], truth)
    yield _medians("farthest-point", [farthest_poses(places, start, N_VIEWS) for start in many], truth)
    random = [[start, *rng.integers(places.n_poses, size=N_VIEWS - 1).tolist()] for start in many]
    yield _medians("random", random, truth)
    yield _medians("greedy for 2 mm", [choose_greedily(truth.covered, start) for start in first], truth)
    yield _medians("greedy for 60 deg", [choose_greedily(truth.well, start) for start in first], truth)
