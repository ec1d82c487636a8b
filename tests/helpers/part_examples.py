# SPDX-License-Identifier: MIT
"""Surfaces whose relations are known: rows of walls, and surfaces as they are."""

from __future__ import annotations

import numpy as np

from benchmarks.completion.relations.figure_one import plane_fit
from completion.fitting.result import SurfaceFit
from scenes.surfaces.catalogue import Cone, Cylinder, Plane


def walls(seed: int, places, sigma: float = 2e-3, turns_deg=None) -> list[SurfaceFit]:
    """Parallel walls x = place, 3 m wide and 2.5 m high, in metres, turned as told about z."""
    rng = np.random.default_rng(seed)
    turns = np.zeros(len(places)) if turns_deg is None else np.radians(turns_deg)
    return [
        plane_fit(
            rng,
            (place, 0, 1.25),
            (np.cos(turn), np.sin(turn), 0),
            (-np.sin(turn), np.cos(turn), 0),
            (3.0, 2.5),
            sigma=sigma,
            n=400,
        )
        for place, turn in zip(places, turns, strict=True)
    ]


def exact(surface, deviation: float = 1e-3) -> SurfaceFit:
    """A fit of a surface as it is, with all parameters equally well known."""
    k = {Plane: 3, Cylinder: 5, Cone: 6}.get(type(surface), 4)
    return SurfaceFit(surface, deviation, deviation**2 * np.eye(k), 100)
