# SPDX-License-Identifier: MIT
"""Points of a flight of stairs and of a column with a square base, as scans show them."""

import numpy as np


def turned(points, angle):
    cosine, sine = np.cos(angle), np.sin(angle)
    return points @ np.array([[cosine, sine, 0], [-sine, cosine, 0], [0, 0, 1]])


def with_errors(points, rng, sigma, outliers):
    points = points + rng.normal(0, sigma, points.shape)
    wrong = rng.uniform(size=len(points)) < outliers
    points[wrong] = rng.uniform(points.min(axis=0), points.max(axis=0), (wrong.sum(), 3))
    return points


def stairs_points(rng, n=3000, sigma=0.004, outliers=0.1, steps=6):
    """Going 0.28, rise 0.17, 1 m wide, up towards 0.6 rad; the first nose at the origin."""
    step, place, across = rng.integers(0, steps, n), rng.uniform(size=n), rng.uniform(-0.5, 0.5, n)
    is_tread = rng.uniform(size=n) < 0.6
    along = 0.28 * np.where(is_tread, step + place, step)
    up = 0.17 * np.where(is_tread, step, step - place)
    return with_errors(turned(np.column_stack([along, across, up]), 0.6), rng, sigma, outliers)


def column_points(rng, n=4000, sigma=0.004, outliers=0.1):
    """A shaft of radius 0.2 on a base of 0.6, 0.3 high, about (1, 2); seen from one side."""
    part, along, angle = rng.uniform(size=n), rng.uniform(-0.3, 0.3, n), rng.uniform(0, 2 * np.pi, n)
    side = np.column_stack([rng.choice([-0.3, 0.3], n), along, rng.uniform(0, 0.3, n)])
    swapped = rng.uniform(size=n) < 0.5
    side[swapped, :2] = side[swapped][:, [1, 0]]
    out = rng.uniform(0.2, 0.3, n)
    flat = np.column_stack([out * np.cos(angle), out * np.sin(angle), np.full(n, 0.3)])
    shaft = np.column_stack([0.2 * np.cos(angle), 0.2 * np.sin(angle), rng.uniform(0.3, 1.8, n)])
    points = np.where((part < 0.3)[:, None], side, np.where((part < 0.4)[:, None], flat, shaft))
    points = turned(points, 0.35)
    points = points[points[:, 0] > -0.1]
    return with_errors(points, rng, sigma, outliers) + [1.0, 2.0, 0.0]
