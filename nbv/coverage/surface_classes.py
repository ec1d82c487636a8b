# SPDX-License-Identifier: MIT
"""Classes of surface when completion stands in for views: met, modelled, inferred, unknown."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from nbv.coverage.completed_surfaces import CompletedSurfaces
from nbv.visibility.samples import SurfaceSamples
from scenes.checks import BoolArray, FloatArray
from scenes.mesh.labelled_mesh import LabelledMesh, triangle_areas

MET, MODELLED, INFERRED, UNKNOWN = range(4)
CLASSES = ("met", "modelled", "inferred", "unknown")


@dataclass(frozen=True, slots=True)
class Shares:
    """Shares of a scene's area by class after some views, and how much of the inferred area is right.

    Attributes
    ----------
    met, modelled, inferred, unknown : float
        Measured as required; seen, but not so, within 2 cm of a fitted surface that is known exactly enough;
        neither, within 2 cm of inferred surface; the rest.
    reached : float
        Share of the reachable area that is not unknown; 1 where nothing is reachable.
    inferred_m2, right_m2 : float
        Area of inferred surface in square metres, and how much of it lies within 2 cm of the true surface.
    """

    views: int
    met: float
    modelled: float
    inferred: float
    unknown: float
    reached: float
    inferred_m2: float
    right_m2: float

    @property
    def known(self) -> float:
        """Share of the area that is met, modelled or inferred."""
        return self.met + self.modelled + self.inferred

    def to_json(self) -> dict[str, float]:
        """Return the entry of `plan.json`."""
        return asdict(self)


def classify(
    samples: SurfaceSamples, met: BoolArray, seen: BoolArray, completed: CompletedSurfaces
) -> NDArray[np.int8]:
    """Return the class (n,) of each sample of the true surface.

    Views have measured `met` (n,) of them as required, and `seen` (n,); `completed` is made of their scans.
    """
    classes = np.full(len(samples), UNKNOWN, np.int8)
    classes[completed.inferred(samples.points, samples.normals, CLOSE_M)] = INFERRED
    classes[seen & completed.modelled(samples.points, samples.normals, CLOSE_M)] = MODELLED
    classes[met] = MET
    return classes


def shares_of(
    classes: NDArray[np.int8],
    samples: SurfaceSamples,
    reachable: BoolArray,
    completed: CompletedSurfaces,
    truth: LabelledMesh,
    views: int,
) -> Shares:
    """Return the shares of `classes` (n,) of the samples, and how much inferred area is true.

    `reachable` (n,) tells which samples some candidate could measure as required.
    """
    met, modelled, inferred, unknown = (
        float(samples.areas[classes == kind].sum()) / samples.total_m2 for kind in range(len(CLASSES))
    )
    areas = samples.areas[reachable]
    reached = float(areas[classes[reachable] != UNKNOWN].sum() / areas.sum()) if len(areas) else 1.0
    vertices, faces, _ = completed.hypothesised()
    corners = vertices[faces]
    area = triangle_areas(corners)
    right = distances(corners.mean(axis=1), truth.corners) <= CLOSE_M
    claimed, true = float(area.sum()), float(area[right].sum())
    return Shares(
        views=views,
        met=met,
        modelled=modelled,
        inferred=inferred,
        unknown=unknown,
        reached=reached,
        inferred_m2=claimed,
        right_m2=true,
    )


CLOSE_M = 0.02  # inferred surface this near to the true one counts as right
_NEAREST = 8  # triangles that are tried for each point
_PIECES = 20_000  # about as many triangles as large ones are cut into


def distances(points: FloatArray, corners: FloatArray) -> FloatArray:
    """Distance (n,) of points (n, 3) from triangles (m, 3, 3), metres; inf where there are none.

    Triangles are cut until all are of similar size; for each point those with the nearest centres are tried.
    """
    nearest = np.full(len(points), np.inf)
    if not len(corners) or not len(points):
        return nearest
    corners = _similar(corners)
    k = min(_NEAREST, len(corners))
    found = cKDTree(corners.mean(axis=1)).query(points, k=k)[1].reshape(len(points), k)
    for column in range(k):
        foot = trimesh.triangles.closest_point(corners[found[:, column]], points)
        nearest = np.minimum(nearest, np.linalg.norm(foot - points, axis=1))
    return nearest


def _similar(corners: FloatArray) -> FloatArray:
    """Cut triangles at the middle of their longest side until all are of similar size."""
    sides = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).max(axis=1)
    slivers = float(sides.sum()) / max(_PIECES, 4 * len(corners))  # cut by area these would be countless
    longest = max(2 * float(np.sqrt(triangle_areas(corners).sum() / _PIECES)), slivers)
    done = []
    while len(corners):
        sides = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
        large = sides.max(axis=1) > longest
        done.append(corners[~large])
        corners, start = corners[large], sides[large].argmax(axis=1)
        a, b, c = (
            np.take_along_axis(corners, (start + k)[:, None, None] % 3, axis=1)[:, 0] for k in range(3)
        )
        middle = (a + b) / 2
        corners = np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
    return np.concatenate(done)
