# SPDX-License-Identifier: MIT
"""Sweeps of spinning lidars in a street: level ground, facades on both sides, cars, the carrier's roof."""

from dataclasses import dataclass

import numpy as np

VLP16 = np.arange(-15.0, 15.1, 2.0)
HDL32 = np.linspace(-30.67, 10.67, 32)
HDL64 = np.concatenate([np.linspace(-24.8, -8.83, 32), np.linspace(-8.33, 2.0, 32)])
VLP32 = np.array([
    -25.0, -15.639, -11.31, -8.843, -7.254, -6.148, -5.333, -4.667, -4.0, -3.667, -3.333, -3.0, -2.667,
    -2.333, -2.0, -1.667, -1.333, -1.0, -0.667, -0.333, 0.0, 0.333, 0.667, 1.0, 1.333, 1.667, 2.333, 3.333,
    4.667, 7.0, 10.333, 15.0,
])  # fmt: skip
OUSTER128 = np.linspace(-22.5, 22.5, 128)
"""Elevations of the beams of common lidars, degrees."""

HEIGHT_M = 1.73
"""Of the lidar above the ground."""
CARS = np.array([[6.0, 2.5, -1.73, 10.0, 4.2, -0.2], [-9.0, -4.4, -1.73, -5.0, -2.7, -0.3]])
FACADES = np.array([[-60.0, 9.0, -1.73, 60.0, 10.0, 8.0], [-60.0, -9.0, -1.73, 60.0, -8.0, 5.0]])
ROOF = np.array([[-1.5, -0.8, -1.0, 1.0, 0.8, -0.6]])
"""Boxes as (x0, y0, z0, x1, y1, z1), metres about the lidar."""


@dataclass
class Sweep:
    """Points of a sweep in the order of its file; the number of each one's beam from below, and its range."""

    points: np.ndarray
    ring: np.ndarray
    on_carrier: np.ndarray


def ranges_to(origins, rays, boxes, *, ground=True):
    """Range (n,) of each ray to the ground or the nearest box, inf where it meets none."""
    with np.errstate(divide="ignore", invalid="ignore"):
        found = np.where(rays[:, 2] < 0, (-HEIGHT_M - origins[:, 2]) / rays[:, 2], np.inf)
        found = found if ground else np.full(len(rays), np.inf)
        for box in boxes:
            first, last = (box[:3] - origins) / rays, (box[3:] - origins) / rays
            enters = np.fmin(first, last).max(axis=1)
            leaves = np.fmax(first, last).min(axis=1)
            met = (enters <= leaves) & (enters > 0)
            found = np.where(met, np.minimum(found, enters), found)
    return found


def sweep(
    elevations, step_deg=0.4, *, by="firing", offset_m=0.0, jitter=0.02, carrier=False, seed=0, reach_m=100.0
):
    """Return a sweep of beams at `elevations` (k,), degrees.

    by : "beam" (one turn after the other, from the top, as in KITTI) or "firing" (all beams at each azimuth)
    offset_m : how far the beams' origins are apart along z, as in an HDL-64
    jitter : of the azimuth, in steps
    """
    rng = np.random.default_rng(seed)
    azimuth = np.radians(np.arange(0.0, 360.0, step_deg))
    ring, turn = np.meshgrid(np.arange(len(elevations))[::-1], np.arange(len(azimuth)), indexing="ij")
    if by == "firing":
        ring, turn = ring.T, turn.T
    ring, turn = ring.ravel(), turn.ravel()
    phase = rng.uniform(0, 0.9, len(elevations))[ring]  # lasers do not fire at the same time
    around = azimuth[turn] + np.radians(step_deg) * (phase + rng.normal(0, jitter, len(ring)))
    up = np.radians(elevations[ring])
    rays = np.column_stack([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)])
    origins = np.zeros_like(rays)
    origins[:, 2] = offset_m * (ring / (len(elevations) - 1) - 0.5)
    ranges = ranges_to(origins, rays, np.concatenate([CARS, FACADES]))
    own = ranges_to(origins, rays, ROOF, ground=False) if carrier else np.full(len(rays), np.inf)
    on_carrier = own < ranges
    ranges = np.minimum(ranges, own) + rng.normal(0, 0.01, len(rays))
    back = ranges < reach_m
    points = origins[back] + ranges[back, None] * rays[back]
    return Sweep(points, ring[back], on_carrier[back])
