# SPDX-License-Identifier: MIT
"""What the segmentation of a part gives: a label for each point, a surface for each label."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np

from completion.fitting.result import SurfaceFit
from scenes.checks import IntArray, frozen_copy


@dataclass(frozen=True, slots=True, eq=False)
class PartSegmentation:
    """Points of a part divided into faces, each on one surface.

    A face is connected: two bores on one axis are two faces. `groups` says which faces are on one surface.

    Attributes
    ----------
    labels : (n,) int
        Face of each point, in the order of the input: k + 1 for `fits[k]`, 0 for none. Of a mesh, of each
        vertex: on an edge that of the larger face.
    fits : tuple of SurfaceFit
        A surface for each face: plane, sphere, cylinder, cone or torus, with its covariance, residuals of
        neighbours that are alike allowed for.
    groups : tuple of int
        One a face: faces with equal numbers are on one surface, as far as the points tell.
    noise_m, spacing_m : float
        Estimated deviation of the points along the normal, and their sampling distance; metres.
    triangle_labels : (m,) int or None
        Of a mesh, the face of each triangle.
    names : tuple of int
        What each face is called, ascending: 1, 2, ... unless labels were given.
    warnings : tuple of str
        What is doubtful, a sentence each.
    """

    labels: IntArray
    fits: tuple[SurfaceFit, ...]
    groups: tuple[int, ...]
    noise_m: float
    spacing_m: float
    triangle_labels: IntArray | None = None
    names: tuple[int, ...] = ()
    warnings: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "labels", frozen_copy(self.labels, np.int32))
        if not self.names:
            object.__setattr__(self, "names", tuple(range(1, len(self.fits) + 1)))
        if self.triangle_labels is not None:
            object.__setattr__(self, "triangle_labels", frozen_copy(self.triangle_labels, np.int32))

    def members(self, number: int) -> IntArray:
        """Places (m,) of the points of face `number`, from 1."""
        return np.flatnonzero(self.labels == number)

    def by_surface(self) -> IntArray:
        """Labels (n,) of surfaces: of each point the least number of a face on its surface, 0 for none."""
        first = {group: number for number, group in reversed(list(enumerate(self.groups, start=1)))}
        own = np.array([0, *(first[group] for group in self.groups)], dtype=np.int64)
        return own[self.labels]

    def __repr__(self) -> str:
        kinds = Counter(fit.surface.kind for fit in self.fits)
        named = ", ".join(f"{count} {kind}" for kind, count in sorted(kinds.items())) or "nothing"
        share = float(np.mean(self.labels > 0)) if len(self.labels) else 0.0
        return f"PartSegmentation({named}; {share:.1%} of {len(self.labels)} points)"


def no_faces(n: int, reason: str) -> PartSegmentation:
    """The division of n points that have no surface, and why."""
    return PartSegmentation(np.zeros(n, np.int32), (), (), noise_m=0.0, spacing_m=0.0, warnings=(reason,))
