# SPDX-License-Identifier: MIT
"""Outlines: what a plan shows below its cut, and of the openings that it cuts."""

from __future__ import annotations

import numpy as np
import shapely

from completion.exchange.building.building_model import BuildingModel, OpeningOutline
from scenes.checks import FloatArray

_LEVEL = float(np.cos(np.radians(10.0)))
_RAGGED_M, _LEAST_M = 0.02, 0.3  # to which outlines are simplified; length of those that are drawn


def seen_below(model: BuildingModel, height_m: float) -> list[FloatArray]:
    """Return outlines (n, 2) of level surfaces seen from above and below a height, such as table tops.

    Holes in them are left out: what stands on a floor hides it, and so does the scanner's own stand.
    """
    corners = model.vertices[model.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1)
    is_level = (normal[:, 2] > _LEVEL * length) & (model.surface > 0)
    own = is_level & (corners[:, :, 2].max(axis=1) < height_m)
    faces = model.faces[own]
    edges = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2), axis=2).reshape(-1, 2)
    numbered = np.column_stack([np.repeat(model.surface[own], 3), edges])
    found, count = np.unique(numbered, axis=0, return_counts=True)
    outlines = []
    for number in np.unique(found[:, 0]).tolist():
        places = model.vertices[found[(found[:, 0] == number) & (count == 1), 1:], :2]
        merged = shapely.line_merge(
            shapely.multilinestrings([shapely.linestrings(place) for place in places])
        )
        lines = shapely.simplify(shapely.get_parts(merged), _RAGGED_M)
        areas = [shapely.Polygon(line) if line.is_ring else line for line in lines]
        outlines += [
            shapely.get_coordinates(line)
            for k, line in enumerate(lines)
            if line.length > _LEAST_M
            and not any(other.contains(line) for other in (*areas[:k], *areas[k + 1 :]))
        ]
    return outlines


def opening_at(opening: OpeningOutline, height_m: float) -> FloatArray | None:
    """Return both ends (2, 2) of an opening at a height; None where it is not there."""
    points, following = opening.points, np.roll(opening.points, -1, axis=0)
    rise = following[:, 2] - points[:, 2]
    crosses = (points[:, 2] >= height_m) != (following[:, 2] >= height_m)
    if crosses.sum() < 2:
        return None
    share = (height_m - points[crosses, 2]) / rise[crosses]
    places = points[crosses, :2] + share[:, None] * (following - points)[crosses, :2]
    apart = np.linalg.norm(places[:, None] - places[None], axis=2)
    return np.asarray(places[list(np.unravel_index(int(np.argmax(apart)), apart.shape))])
