# SPDX-License-Identifier: MIT
"""Things on a bare floor, seen from one to three sides with made-up occluders, and what is true of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree
from trimesh.triangles import closest_point

from benchmarks.cases.backs.held_out import HELD_OUT
from benchmarks.cases.backs.tuning import TUNING
from benchmarks.cases.frames import DATA
from benchmarks.cases.houses.solids import box
from completion.backs.symmetry import mirrors
from completion.backs.views import Setting, ThingView
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor, View
from scenes.checks import BoolArray, FloatArray, IntArray
from scenes.io.scene_files import load_scene
from scenes.mesh.labelled_mesh import LabelledMesh, spread_points
from scenes.pose import Pose
from scenes.world.scene import Scene
from texture.engine.compiled import compiled

NOISE, PIXELS, AWAY = 1e-3, 160, 2.2  # shares of size, pixels a side of the image, sizes to the sensor
MESHES = {
    "tuning": ("beetle.obj", "cycloidal.ply", "octagonal_pocket.stl", "teapot.obj"),
    "held-out": ("fandisk.obj", "featuretype.STL", "rocker-arm.obj", "spot.obj", "stanford-bunny.obj"),
}
CUPBOARDS = {
    "tuning": ("cabinet", "bookshelf", "washing machine"),
    "held-out": ("wardrobe", "nightstand", "fridge"),
}
_SAMPLES, _TESTED, _FEW = 30_000, 2_000, 200


def kinds_of(half: str) -> list[str]:
    """Return the names of the kinds of a half, "tuning" or "held-out"; meshes only where the data are."""
    made = TUNING if half == "tuning" else HELD_OUT
    return [*made, *(name for name in MESHES[half] if (DATA / "scenes/objects" / name).exists())]


def corners_of(kind: str, seed: int) -> FloatArray:
    """Return the triangles (m, 3, 3) of a thing, scaled to a diagonal of 1 m, its foot at height 0."""
    made = TUNING | HELD_OUT
    if kind in made:
        corners = made[kind](np.random.default_rng([51, seed]))
    else:
        mesh = load_scene(DATA / "scenes/objects" / kind, up="y", units="m").mesh
        corners = mesh.vertices[mesh.faces]
    low, high = corners.reshape(-1, 3).min(axis=0), corners.reshape(-1, 3).max(axis=0)
    foot = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
    return np.asarray((corners - foot) / np.linalg.norm(high - low))


@dataclass(frozen=True, slots=True, eq=False)
class ThingCase:
    """Views of a thing of 1 m, their setting, its triangles, and ranges without noise of each view."""

    views: tuple[ThingView, ...]
    setting: Setting
    corners: FloatArray
    true_ranges: tuple[FloatArray, ...]
    covered: float  # share of the thing's width or height in the first image


def make_case(
    kind: str, seed: int, n_views: int = 1, *, occluded: bool = True, wall: bool = False
) -> ThingCase | None:
    """Return a thing seen from chance sides; None where an occluder leaves too little of it.

    A third of the views is free, in the others something nearer covers up to 40 % of the thing's width or
    height, from the left, the right or the top. With a wall, the thing's back, at +y, is 0.5 to 30 % of its
    size before it, and it is seen from the front.
    """
    corners = corners_of(kind, seed)
    rng = np.random.default_rng([52, seed, sum(map(ord, kind))])
    high = corners.reshape(-1, 3).max(axis=0)
    middle = np.array([0, 0, high[2] / 2])
    solids = [corners, box((-30, -30, -1), (30, 30, 0))]
    walls = np.zeros((0, 4))
    if wall:
        if kind in ("cabinet", "bookshelf", "washing machine", "wardrobe", "nightstand", "fridge"):
            corners = corners * [-1, -1, 1]  # the back of furniture is at y = 0: turned to +y
            solids[0] = corners
        at = float(corners[..., 1].max() + rng.uniform(0.005, 0.3))
        solids.append(box((-30, at, 0), (30, at + 0.1, 30)))
        walls = np.array([[0.0, -1.0, 0.0, -at]])
    scene = _scene(solids)
    caster = scene.ray_caster()
    sensor = PinholeSensor(fov_deg=32, width=PIXELS, height=PIXELS, min_range_m=0.01, max_range_m=1e3)
    views, exact, covered = [], [], 0.0
    start = rng.uniform(0, 2 * np.pi)
    for k in range(n_views):
        azimuth = rng.uniform(-2.6, -0.54) if wall else start + k * rng.uniform(1.2, 2.4)
        up = np.radians(rng.uniform(12, 45))
        way = np.array([np.cos(azimuth) * np.cos(up), np.sin(azimuth) * np.cos(up), np.sin(up)])
        scan = scan_scene(scene, View(Pose.looking_at(middle + AWAY * way, middle), sensor), caster=caster)
        truth = scan.truth
        assert truth is not None
        of_thing, ranges = truth.surface == 0, scan.ranges.copy()
        share = max(0.0, float(rng.uniform(-0.2, 0.4))) if occluded else 0.0
        before = _cover(of_thing, share, int(rng.integers(3)))
        ranges[before] = 0.7 * ranges[of_thing].min()
        of_thing = of_thing & ~before
        if of_thing.sum() < 80:
            return None
        noisy = ranges + NOISE * rng.normal(size=ranges.shape)
        views.append(ThingView(replace(scan, ranges=noisy, sigma_m=NOISE, truth=None), of_thing))
        exact.append(ranges)
        covered = share if k == 0 else covered
    return ThingCase(tuple(views), Setting(0.0, NOISE, walls), corners, tuple(exact), covered)


def _scene(solids: Sequence[FloatArray]) -> Scene:
    corners = np.concatenate(solids)
    surface = np.repeat(np.arange(len(solids), dtype=np.int32), [len(one) for one in solids])
    mesh = LabelledMesh(
        corners.reshape(-1, 3), np.arange(3 * len(corners), dtype=np.int32).reshape(-1, 3), surface
    )
    return Scene(
        mesh, (None,) * len(solids), tuple(f"solid {k}" for k in range(len(solids))), "thing", "object"
    )


def _cover(of_thing: BoolArray, share: float, side: int) -> BoolArray:
    """Pixels of an occluder that covers a share of the thing from the left, the right or the top."""
    before = np.zeros_like(of_thing)
    if share <= 0:
        return before
    axis = 0 if side == 2 else 1
    at = np.flatnonzero(of_thing.any(axis=1 - axis))
    n = max(round(share * float(at[-1] - at[0] + 1)), 1)
    span = slice(at[-1] - n + 1, None) if side == 1 else slice(None, at[0] + n)
    before[(slice(None), span) if axis == 1 else (span, slice(None))] = True
    return before


class TrueThing:
    """The true surface and inside of a thing."""

    def __init__(self, corners: FloatArray) -> None:
        self.corners = corners
        self.samples, self._triangle = spread_points(corners, _SAMPLES)
        self._tree = cKDTree(self.samples)

    def distance(self, points: FloatArray) -> FloatArray:
        """Distance (n,) of points (n, 3) from the surface, by the triangles of the nearest samples."""
        if not len(points):
            return np.zeros(0)
        away, near = self._tree.query(points, k=3)
        least = np.asarray(away[:, 0])
        for k in range(3):
            at = closest_point(self.corners[self._triangle[near[:, k]]], points)
            least = np.minimum(least, np.linalg.norm(at - points, axis=1))
        return np.asarray(least)

    def share_mapped(self, isometries: FloatArray, within: float) -> float:
        """Least share of the surface that isometries (k, 3, 4) map within a distance of it."""
        points = self.samples[:: _SAMPLES // _TESTED]
        return min(
            float((self.distance(points @ one[:, :3].T + one[:, 3]) <= within).mean()) for one in isometries
        )

    def has_mirror(self, within: float = 0.03) -> bool:
        """Tell whether a vertical mirror of a grid, 4 deg and 1.5 % apart, maps 85 % so nearly."""
        points = self.samples[:: _SAMPLES // _FEW]
        middle = (self.samples.min(axis=0) + self.samples.max(axis=0)) / 2
        grid = np.meshgrid(np.radians(np.arange(0, 180, 4)), np.arange(-0.15, 0.151, 0.015))
        isometries = mirrors(np.stack(grid, axis=-1).reshape(-1, 2), middle)
        moved = np.einsum("kij,nj->kni", isometries[:, :, :3], points) + isometries[:, None, :, 3]
        near = self._tree.query(moved.reshape(-1, 3), distance_upper_bound=within)[0]
        return bool((np.isfinite(near).reshape(len(isometries), -1).mean(axis=1) >= 0.85).any())


def occupied(corners: FloatArray, low: FloatArray, cell: float, shape: tuple[int, ...]) -> BoolArray:
    """Tell which cell centres lie inside triangles (m, 3, 3), which may be of several solids, by winding."""
    change = np.zeros((shape[0], shape[1], shape[2] + 1), dtype=np.int64)
    _count(np.ascontiguousarray(corners), low + [1.234e-7, 2.345e-7, 0], cell, change)
    return np.asarray(np.cumsum(change, axis=2)[:, :, :-1] > 0)


@compiled
def _count(corners: FloatArray, low: FloatArray, cell: float, change: IntArray) -> None:
    """Add at each column of cell centres +1 above a triangle that faces down, -1 above one that faces up."""
    nx, ny, nz = change.shape
    for m in range(len(corners)):
        ax, ay, az = corners[m, 0, 0], corners[m, 0, 1], corners[m, 0, 2]
        bx, by, bz = corners[m, 1, 0] - ax, corners[m, 1, 1] - ay, corners[m, 1, 2] - az
        cx, cy, cz = corners[m, 2, 0] - ax, corners[m, 2, 1] - ay, corners[m, 2, 2] - az
        twice = bx * cy - by * cx
        if abs(twice) < 1e-14:
            continue
        first = max(int(np.floor((ax + min(bx, cx, 0.0) - low[0]) / cell)), 0)
        last = min(int(np.ceil((ax + max(bx, cx, 0.0) - low[0]) / cell)), nx - 1)
        near = max(int(np.floor((ay + min(by, cy, 0.0) - low[1]) / cell)), 0)
        far = min(int(np.ceil((ay + max(by, cy, 0.0) - low[1]) / cell)), ny - 1)
        for i in range(first, last + 1):
            x = low[0] + i * cell - ax
            for j in range(near, far + 1):
                y = low[1] + j * cell - ay
                u, v = (x * cy - y * cx) / twice, (bx * y - by * x) / twice
                if u < 0 or v < 0 or u + v > 1:
                    continue
                z = az + u * bz + v * cz
                k = min(max(int(np.ceil((z - low[2]) / cell)), 0), nz - 1)
                change[i, j, k] += -1 if twice > 0 else 1
