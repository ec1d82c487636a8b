# SPDX-License-Identifier: MIT
"""Scans of walls, patches and holes, on the grid of their projection and off it."""

import numpy as np

from completion.evidence.evidence import Scans
from completion.observe.observation import observe
from completion.observe.tolerance import EvidenceOptions
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection, SphericalProjection
from scenes.scan.range_image import RangeImage
from scenes.surfaces.catalogue import Plane

TOLERANCE = EvidenceOptions().tolerance(registration_m=0.002)
UNEVEN = np.cumsum(np.random.default_rng(1).uniform(0.002, 0.02, 70))
CAMERAS = {
    "pinhole": PinholeProjection(90, 70, 60.0, 62.0, 44.0, 35.0),
    "upside down": PinholeProjection(75, 53, 140.0, -150.0, 31.0, 18.0),
    "turning": SphericalProjection(
        np.linspace(-np.pi, np.pi, 120, endpoint=False), np.linspace(1.0, -0.9, 60)
    ),
    "rising": SphericalProjection(np.linspace(-0.7, 0.8, 80), np.linspace(-0.5, 1.2, 50) ** 3),
    "uneven": SphericalProjection(-UNEVEN, UNEVEN - 0.6),
    "one row": SphericalProjection(np.linspace(-1, 1, 70), np.array([0.1])),
}
KINDS = (*CAMERAS, "pinhole off the grid", "turning off the grid")


def draw_scan(kind, seed, noise_m=0.003):
    """A scan from anywhere in a room, of its walls, of patches before and behind them, and of holes."""
    rng = np.random.default_rng(seed)
    camera = CAMERAS[kind.removesuffix(" off the grid")]
    eye = rng.uniform(-0.6, 0.6, 3)
    pose = Pose.looking_at(eye, eye + rng.normal(size=3))
    rays = camera.directions()
    if kind.endswith("off the grid"):
        rays = rays + rng.normal(0, 0.02, (*camera.shape, 1)) * rng.normal(size=3)
        rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    flat = pose.rotate(rays.reshape(-1, 3))
    walls = [Plane(2.0 * axis, -axis) for axis in (*np.eye(3), *-np.eye(3))]
    ranges = np.min([wall.ray_ranges(eye, flat) for wall in walls], axis=0).reshape(camera.shape)
    patch = np.kron(rng.choice([0.4, 1.0, 1.0, 1.0, 3.0], (10, 10)), np.ones((17, 17)))
    ranges = ranges * np.resize(patch, (170, 170))[: camera.shape[0], : camera.shape[1]]
    ranges = ranges + rng.normal(0, noise_m, camera.shape)
    ranges[rng.random(camera.shape) < 0.1] = np.inf
    ranges[: camera.shape[0] // 4, : camera.shape[1] // 3] = np.inf
    if kind.endswith("off the grid"):
        points = np.where(
            np.isfinite(ranges)[..., None], np.where(ranges < 1e9, ranges, 0.0)[..., None] * rays, np.nan
        )
        return RangeImage.from_points(points.astype(np.float32), camera, pose)
    return RangeImage(ranges, camera, pose)


def draw_scans(kinds, noise_m=0.003, owners=3):
    """Scans of some kinds in their frame, their pixels on a few surfaces."""
    observations = tuple(
        observe(draw_scan(kind, seed, noise_m), Pose.identity(), noise_m) for seed, kind in enumerate(kinds)
    )
    rng = np.random.default_rng(9)
    numbers = tuple(
        np.kron(rng.integers(0, owners, (20, 20)), np.ones((8, 8)))[
            : seen.valid.shape[0], : seen.valid.shape[1]
        ].astype(np.int32)
        for seen in observations
    )
    return Scans(observations, numbers, TOLERANCE)


def knowing_nothing(reach):
    """The reach of a scan of which nothing is known, so that nothing is left out."""
    boxes = np.zeros_like(reach.boxes)
    boxes[..., 1:, :] = 1e9 * np.eye(3, dtype=np.float32)
    return reach._replace(far=np.full_like(reach.far, 1e9), part=np.full_like(reach.part, 1e9), boxes=boxes)


def without_reach(scans):
    """The same scans, held in full."""
    held = Scans(scans.observations, scans.owners, scans.tolerance)
    object.__setattr__(held, "reach", tuple(map(knowing_nothing, held.reach)))
    return held
