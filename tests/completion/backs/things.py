# SPDX-License-Identifier: MIT
"""Things on a floor, scanned from a chosen side, for the tests of back sides."""

from dataclasses import replace

import numpy as np

from benchmarks.cases.houses.solids import box
from completion.backs.views import Setting, ThingView
from nbv.scanning.scanner import scan_scene
from nbv.scanning.sensor import PinholeSensor, View
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.pose import Pose
from scenes.world.scene import Scene

SIGMA = 1e-3


def view_of(corners, azimuth=0.6, elevation=0.45, *, covered=0.0, seed=0):
    """A thing's triangles (m, 3, 3), its foot at height 0, from one side; an occluder from the left."""
    floor = box((-20, -20, -1), (20, 20, 0))
    every = np.concatenate([corners, floor])
    surface = np.repeat(np.arange(2, dtype=np.int32), [len(corners), len(floor)])
    faces = np.arange(3 * len(every), dtype=np.int32).reshape(-1, 3)
    scene = Scene(
        LabelledMesh(every.reshape(-1, 3), faces, surface), (None,) * 2, ("thing", "floor"), "x", "object"
    )
    low, high = corners.reshape(-1, 3).min(axis=0), corners.reshape(-1, 3).max(axis=0)
    middle, size = (low + high) / 2, float(np.linalg.norm(high - low))
    way = np.array(
        [np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)]
    )
    sensor = PinholeSensor(fov_deg=32, width=160, height=160, min_range_m=0.01, max_range_m=100)
    scan = scan_scene(scene, View(Pose.looking_at(middle + 2.2 * size * way, middle), sensor))
    of_thing, ranges = scan.truth.surface == 0, scan.ranges.copy()
    if covered:
        columns = np.flatnonzero(of_thing.any(axis=0))
        last = columns[0] + round(covered * len(columns))
        ranges[:, :last] = 0.7 * ranges[of_thing].min()
        of_thing = of_thing & (np.arange(160) >= last)
    noise = SIGMA * size * np.random.default_rng(seed).normal(size=ranges.shape)
    return ThingView(replace(scan, ranges=ranges + noise, sigma_m=SIGMA * size, truth=None), of_thing)


def setting_of(view, walls=()):
    return Setting(0.0, view.scan.sigma_m, np.reshape(walls, (-1, 4)))
