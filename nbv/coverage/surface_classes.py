# SPDX-License-Identifier: MIT
"""Classes of surface when completion stands in for views: met, modelled, inferred, unknown."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from nbv.coverage.completed_surfaces import CompletedSurfaces
from nbv.visibility.samples import SurfaceSamples
from scenes.checks import BoolArray
from scenes.mesh.labelled_mesh import LabelledMesh, triangle_areas
from scenes.mesh.triangle_distance import distances

MET, MODELLED, INFERRED, UNKNOWN = range(4)
CLASSES = ("met", "modelled", "inferred", "unknown")
CLOSE_M = 0.02  # inferred surface this near to the true one counts as right


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
