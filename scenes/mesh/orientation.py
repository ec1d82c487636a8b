# SPDX-License-Identifier: MIT
"""Orientation of a mesh: is it a room or an object, and which of its axes points up."""

from __future__ import annotations

from typing import Literal

import numpy as np

from scenes.checks import FloatArray
from scenes.inclination import LEVEL_COSINE
from scenes.limits import AXIS_LEAD, ENCLOSED, OPEN_FLOOR, ROOM_HEIGHT_M, ROOM_SIDE_M, WALLED
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.pose import Pose
from scenes.rays.raycast import RayCaster

Axis = Literal["x", "y", "z"]
_AXES: tuple[Axis, Axis, Axis] = ("x", "y", "z")
_STATIONS = 7  # grid points along each horizontal side of the bounding box
_HEIGHTS = (0.10, 0.25, 0.50)  # of the box's height
_RAYS = 32


def world_from_file_up(up: Axis) -> Pose:
    """Return the rotation that makes axis `up` of a file the world's z; a cyclic turn, nothing is mirrored.

    Examples
    --------
    >>> world_from_file_up("y").apply(np.array([[0.0, 1.0, 0.0]])).tolist()
    [[0.0, 0.0, 1.0]]
    """
    rotations = {
        "x": [[0, 1, 0], [0, 0, 1], [1, 0, 0]],
        "y": [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
        "z": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    }
    return Pose.from_parts(np.array(rotations[up], dtype=np.float64), np.zeros(3))


def decide_mode(mesh: LabelledMesh) -> Literal["room", "object"]:
    """Tell whether `mesh` (z up, metres) is scanned from within ("room") or from around ("object").

    A room either encloses its visitors or offers them a floor to stand on:

    * enclosed: from 7 x 7 stations at a tenth, a quarter and half of the bounding box's height, 32
      horizontal rays and one down are cast. A station counts when 70 % of the horizontal rays first meet
      the *front* of a face (inside a solid they meet backs) and the ray down meets a floor's front; a room
      has 30 % such stations.
    * open floor: seen from above, 60 % of the footprint is upward surface in the lowest 15 % of the height;
      both sides are at least 3 m long and the height is at least 1.5 m.
    """
    low, high = mesh.bounds()
    extent = high - low
    if not (extent > 0).all():
        return "object"
    caster, normals = RayCaster(mesh.vertices, mesh.faces), mesh.face_normals()
    if _enclosed_share(caster, normals, low, extent) >= ENCLOSED:
        return "room"
    roomy = min(extent[0], extent[1]) >= ROOM_SIDE_M and extent[2] >= ROOM_HEIGHT_M
    return "room" if roomy and _floor_share(caster, normals, low, extent) >= OPEN_FLOOR else "object"


def _grid(low: FloatArray, extent: FloatArray, heights: tuple[float, ...]) -> FloatArray:
    steps = (np.arange(_STATIONS) + 0.5) / _STATIONS
    parts = np.stack(np.meshgrid(steps, steps, np.array(heights), indexing="ij"), axis=-1)
    placed: FloatArray = low + extent * parts.reshape(-1, 3)
    return placed


def _enclosed_share(caster: RayCaster, normals: FloatArray, low: FloatArray, extent: FloatArray) -> float:
    stations = _grid(low, extent, _HEIGHTS)
    turn = 2 * np.pi * (np.arange(_RAYS) + 0.3) / _RAYS  # no ray along an axis, where walls meet edge on
    around = np.stack([np.cos(turn), np.sin(turn), np.zeros(_RAYS)], axis=1)
    meets = _meets_front(
        caster, normals, np.repeat(stations, _RAYS, axis=0), np.tile(around, (len(stations), 1))
    )
    walled = meets.reshape(-1, _RAYS).mean(axis=1) >= WALLED
    down = np.broadcast_to(np.array([0.0, 0.0, -1.0]), stations.shape)
    return float((walled & _meets_front(caster, normals, stations, down)).mean())


def _meets_front(
    caster: RayCaster, normals: FloatArray, origins: FloatArray, along: FloatArray
) -> FloatArray:
    """Tell which rays first meet a face whose normal points against them."""
    hits = caster.first_hit(origins, along)
    front: FloatArray = hits.hit & (np.einsum("ij,ij->i", normals[hits.face], along) < 0)
    return front


def _floor_share(caster: RayCaster, normals: FloatArray, low: FloatArray, extent: FloatArray) -> float:
    above = _grid(low, extent, (1.01,))
    hits = caster.first_hit(above, np.broadcast_to(np.array([0.0, 0.0, -1.0]), above.shape))
    height = above[:, 2] - hits.ranges - low[2]
    return float((hits.hit & (height <= 0.15 * extent[2]) & (normals[hits.face, 2] > LEVEL_COSINE)).mean())


def suggest_up(mesh: LabelledMesh, mode: Literal["room", "object"]) -> Axis | None:
    """Return the axis of the file that looks vertical, None when no axis leads clearly.

    The score of an axis is the share of the area that lies at right angles to it (floors, seats, table
    tops). For a room it is divided by the extent, since rooms are wider than high. For an object, a tenth
    of how much broader its low end is than its high end is added (things stand on their broad end), and an
    axis along which the area is distributed symmetrically is out (left and right are alike, up and down are
    not).
    """
    areas, normals = mesh.face_areas(), mesh.face_normals()
    extent = np.diff(mesh.bounds(), axis=0)[0]
    if areas.sum() == 0 or not (extent > 0).all():
        return None
    scores = (
        np.array([areas[np.abs(normals[:, axis]) > LEVEL_COSINE].sum() for axis in range(3)]) / areas.sum()
    )
    if mode == "room":
        scores = scores / extent
    else:
        stance = np.array([_stance(mesh, axis) for axis in range(3)])
        scores = (scores + 0.1 * np.maximum(stance, 0)) * np.array([_asymmetry(mesh, a) for a in range(3)])
    order = np.argsort(-scores, kind="stable")
    return _AXES[int(order[0])] if scores[order[0]] > AXIS_LEAD * scores[order[1]] else None


def _stance(mesh: LabelledMesh, axis: int) -> float:
    """Breadth of the lowest 3 % of the faces less that of the highest, as parts of the footprint."""
    low, high = mesh.bounds()
    corners = mesh.corners
    height = (corners.mean(axis=1)[:, axis] - low[axis]) / (high - low)[axis]
    others = [other for other in range(3) if other != axis]

    def breadth(chosen: FloatArray) -> float:
        if not chosen.any():
            return 0.0
        points = corners[chosen].reshape(-1, 3)[:, others]
        return float(np.prod(np.ptp(points, axis=0) / (high - low)[others]))

    return breadth(height < 0.03) - breadth(height > 0.97)


def _asymmetry(mesh: LabelledMesh, axis: int) -> float:
    """0 when the area along an axis is distributed as in its mirror image, 1 from a difference of 5 % on."""
    low, high = mesh.bounds()
    height = (mesh.corners.mean(axis=1)[:, axis] - low[axis]) / (high - low)[axis]
    share, _ = np.histogram(height, bins=20, range=(0.0, 1.0), weights=mesh.face_areas())
    difference = np.abs(share - share[::-1]).sum() / (2 * share.sum())
    return float(min(1.0, difference / 0.05))


def axis_in_file(axis: Axis, up: Axis) -> Axis:
    """Which axis of the file became this axis of the world when `up` became z."""
    order: dict[Axis, tuple[Axis, Axis, Axis]] = {
        "x": ("y", "z", "x"),
        "y": ("x", "z", "y"),
        "z": ("x", "y", "z"),
    }
    return order[up]["xyz".index(axis)]
