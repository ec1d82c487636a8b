# SPDX-License-Identifier: MIT
"""Alignment: charts laid along what bounds a surface."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from completion.boundary.boundary_pixels import Rim, RimPoints
from completion.boundary.curves import Line
from completion.boundary.edges import find_edges
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Cylinder, Plane


def aligned_chart(plane: Plane, cuts: Sequence[Plane], points: FloatArray, rim: RimPoints) -> Plane:
    """The plane with u along the straight boundary that was seen most of, else along its longest side.

    Boundaries are its meeting lines with the planes `cuts` and its own edges.
    """
    size = np.linalg.norm(rim.step, axis=1)
    seen = rim.only((size > 0) & np.isin(rim.kind, (Rim.CONTIGUOUS, Rim.OWN_EDGE)))
    size = np.linalg.norm(seen.step, axis=1)
    at_rim = plane.from_uv(seen.uv)
    directions, supports = [], []
    for cut in cuts:
        along = np.cross(plane.normal_direction, cut.normal_direction)
        if np.linalg.norm(along) > 0.5:
            near = (np.abs(cut.distance(at_rim)) <= size) & (seen.kind == Rim.CONTIGUOUS)
            directions.append(along)
            supports.append(float(size[near].sum()))
    for edge in find_edges(seen.only(seen.kind == Rim.OWN_EDGE)):
        if isinstance(edge.curve, Line):
            directions.append(plane.from_uv(edge.curve.direction) - plane.point)
            supports.append(float(np.ptp(edge.runs, axis=1).sum()))
    if max(supports, default=0.0) > 0:
        return Plane(plane.point, plane.normal_direction, directions[int(np.argmax(supports))])
    uv = plane.to_uv(points).astype(np.float32)
    (_, _), (width, height), angle_deg = cv2.minAreaRect(uv)
    angle = np.radians(angle_deg if width >= height else angle_deg + 90.0)
    along = np.cos(angle) * plane.u_direction + np.sin(angle) * plane.v_direction
    return Plane(plane.point, plane.normal_direction, along)


def facing_chart(cylinder: Cylinder, points: FloatArray) -> Cylinder:
    """The cylinder with its zero direction in the middle of the measured arc, the seam at its back."""
    angle = np.sort(cylinder.to_uv(points)[:, 0] / cylinder.radius)
    gaps = np.diff(np.append(angle, angle[0] + 2 * np.pi))
    widest = int(np.argmax(gaps))
    middle = (angle[widest] + gaps[widest] / 2 + np.pi) * cylinder.radius
    outward = cylinder.from_uv(np.array([[middle, 0.0]]))[0] - cylinder.point
    return Cylinder(cylinder.point, cylinder.direction, cylinder.radius, outward, cylinder.concave)
