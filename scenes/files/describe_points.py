# SPDX-License-Identifier: MIT
"""Description of point files and trajectories for `unseen info`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from scenes.checks import InputError
from scenes.files.point_files import read_points
from scenes.files.scan_files import METRES_PER_UNIT, Units, split_index
from scenes.files.scene_loading import units_doubt
from scenes.formats.trajectory import read_poses

_NO_RAYS = "no ray can be traced: to use these points as a scan say where the scanner stood (--origin X,Y,Z)"


def describe_points(path: str, units: Units) -> dict[str, Any]:
    """Return what a file of points holds; lengths in metres.

    Raises
    ------
    InputError
        Unusable file.
    """
    cloud = read_points(path, units)
    low, high = cloud.points.min(axis=0), cloud.points.max(axis=0)
    diagonal = float(np.linalg.norm(high - low))
    stood = None if cloud.origins is None else np.unique(cloud.origins, axis=0)
    doubt = units_doubt(diagonal) if diagonal > 0 else ""
    return {
        "kind": "points",
        "path": path,
        "format": split_index(path)[0].suffix[1:].lower(),
        "points": len(cloud.points),
        "bounds_m": [low, high],
        "extent_m": high - low,
        "diagonal_m": diagonal,
        "has_normals": cloud.normals is not None,
        "has_colour": cloud.colour is not None,
        "scanner_places_m": [] if stood is None else stood,
        "warnings": [*cloud.warnings, *([_NO_RAYS] if stood is None else []), *([doubt] if doubt else [])],
    }


def describe_poses(path: Path, units: Units) -> dict[str, Any] | None:
    """Return what a file of poses holds, None where it holds none; lengths in metres."""
    try:
        poses = read_poses(path)
    except InputError:
        return None
    if not poses:
        return None
    places = np.array([pose.translation for pose in poses]) * METRES_PER_UNIT[units]
    legs = np.linalg.norm(np.diff(places, axis=0), axis=1)
    warnings = []
    if path.name == "images.txt":
        warnings.append("the unit of a COLMAP model is arbitrary unless it was scaled")
    return {
        "kind": "poses",
        "path": str(path),
        "poses": len(poses),
        "bounds_m": [places.min(axis=0), places.max(axis=0)],
        "way_m": float(legs.sum()),
        "first_world_from_sensor": poses[0].matrix,
        "warnings": warnings,
    }
