# SPDX-License-Identifier: MIT
"""Scan mesh: the surface that scans have measured as triangles, few enough to draw and to cast rays at."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from completion.boundary.range_mesh import mesh_range_image
from nbv.online.limits import LONGEST_EDGE
from scenes.checks import FloatArray
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.scan.range_image import RangeImage


def scan_faces(scan: RangeImage) -> tuple[FloatArray, NDArray[np.int32], NDArray[np.int64]]:
    """Return a scan's surface: vertices (n, 3) in world coordinates, metres, faces (m, 3) and pixels (n,).

    The faces turn towards the sensor, and none leads across a jump; `pixels` are row * columns + column.
    """
    points, valid = scan.points(), scan.valid
    footprint = np.where(valid, scan.ranges, 0.0) * scan.projection.pixel_angle
    longest = LONGEST_EDGE * (footprint + (scan.sigma_m or 0.0))
    faces = mesh_range_image(points, valid, longest, scan.origin)
    used = np.zeros(scan.ranges.size, np.bool_)
    used[faces] = True
    number = np.cumsum(used, dtype=np.int32) - 1
    return points.reshape(-1, 3)[used], number[faces].astype(np.int32), np.flatnonzero(used)


def joined_faces(parts: Sequence[tuple[FloatArray, NDArray[np.int32]]]) -> LabelledMesh:
    """Return vertices (n, 3) and faces (m, 3) of several surfaces as one mesh, labelled by their numbers."""
    start = np.cumsum([0, *(len(vertices) for vertices, _ in parts)])
    faces = [part + offset for (_, part), offset in zip(parts, start, strict=False)]
    label = np.repeat(np.arange(len(parts)), [len(part) for part in faces])
    return LabelledMesh(
        np.concatenate([np.zeros((0, 3)), *(vertices for vertices, _ in parts)]),
        np.concatenate([np.zeros((0, 3), np.int32), *faces]).astype(np.int32),
        label.astype(np.int32),
    )
