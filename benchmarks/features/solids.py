# SPDX-License-Identifier: MIT
"""Stairs and columns over noise and outliers: found, how exact, and how honest; and plain surfaces."""

from __future__ import annotations

import time
from collections import Counter

import numpy as np

from benchmarks.features.solid_rooms import CONTENTS, solid_room
from completion.templates.engine.measured import Measured
from completion.templates.engine.template import Status
from completion.templates.pipeline import find_features
from completion.templates.solids.pipeline import find_solids
from tests.completion.templates.solids.solid_points import column_points, stairs_points

_TRUE = {"stairs": {"going": 0.28, "rise": 0.17}, "column": {"width": 0.6, "radius": 0.2}}
_POINTS = {"stairs": stairs_points, "column": column_points}
_SPACING = 0.03


def run(first_seed: int, n: int) -> None:
    """Print a row for each kind, noise and share of outliers, and how often a floor and walls are either."""
    for kind, true in _TRUE.items():
        for sigma in (0.002, 0.005, 0.01):
            for share in (0.0, 0.1, 0.3):
                errors, shares, refused = [], [], 0
                for seed in range(first_seed, first_seed + n):
                    points = _POINTS[kind](np.random.default_rng(seed), sigma=sigma, outliers=share)
                    measured = Measured(points, sigma, _SPACING)
                    fit = find_solids(measured, [kind], rng=np.random.default_rng(0))[0]
                    if fit.status is not Status.FOUND:
                        refused += 1
                        continue
                    off = np.array([fit.value(name) - value for name, value in true.items()])
                    errors.append(off)
                    shares.append(off / [fit.deviation(name) for name in true])
                rms = [np.sqrt(np.mean(np.square(one), axis=0)).round(5) for one in (errors, shares)]
                print(f"{kind} sigma {sigma} outliers {share:.0%}: refused {refused}", end=" ")
                print(f"{' '.join(true)} RMS {rms[0]} by predicted {rms[1].round(2)}", flush=True)
    for kind in _TRUE:
        false = 0
        for seed in range(first_seed, first_seed + 2 * n):
            points = room_points(np.random.default_rng(seed))
            fit = find_solids(Measured(points, 0.005, _SPACING), [kind], rng=np.random.default_rng(0))[0]
            false += fit.status is Status.FOUND
        print(f"{kind} on {2 * n} floors with walls, boxes or a pole: {false} false", flush=True)


def run_rooms(first_seed: int, n: int) -> None:
    """Print how often a column and stairs are found in scanned rooms, how exactly, and where none are."""
    for kind in _TRUE:
        for content in CONTENTS:
            rows, status, cpu = [], Counter[str](), time.process_time()
            for seed in range(first_seed, first_seed + n):
                scan, true = solid_room(seed, content)
                fit = find_features([scan], [kind], rng=0).fits[0]
                status[str(fit.status)] += 1
                if content == kind and fit.status is not Status.NONE:
                    rows.append([abs(fit.value(name) - value) for name, value in true.items()])
            said = ", ".join(f"{number} {name}" for name, number in sorted(status.items()))
            names, off = " and ".join(_TRUE[kind]), ""
            if rows:
                off = f"; {names} off by {np.round(1e3 * np.median(rows, axis=0), 1)} mm"
            each = (time.process_time() - cpu) / n
            print(f"{kind} in rooms with {content}: {said}{off}; {each:.1f} CPU s each", flush=True)


def room_points(rng: np.random.Generator, n: int = 1_500) -> np.ndarray:
    """Points (m, 3) of a floor with a wall, and a box or a round pole on it."""
    floor = np.column_stack([rng.uniform(-1.5, 1.5, (n, 2)), np.zeros(n)])
    wall = np.column_stack([np.full(n, 1.5), rng.uniform(-1.5, 1.5, n), rng.uniform(0, 2.5, n)])
    angle, radius = rng.uniform(0, 2 * np.pi, n), rng.uniform(0.1, 0.3)
    pole = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), rng.uniform(0, 2.5, n)])
    size = rng.uniform(0.3, 0.8, 3)
    box = rng.uniform(-0.5, 0.5, (n, 3))
    box[np.arange(n), rng.integers(0, 3, n)] = rng.choice([-0.5, 0.5], n)
    box = box * size + [0, 0, size[2] / 2]
    points = np.concatenate([floor, wall, (pole, box)[int(rng.integers(2))]])
    return points + rng.normal(0, 0.005, points.shape)
