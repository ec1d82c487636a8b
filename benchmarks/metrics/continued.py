# SPDX-License-Identifier: MIT
"""Continued area of things that end where they end: figures, chairs and plants are no walls."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from benchmarks.metrics.inferred import Hypothesis
from completion.extension.patch import Provenance
from completion.result.completed_model import CompletedModel
from completion.result.labelled_points import PROVENANCE_NAMES
from scenes.checks import BoolArray
from scenes.mesh.labelled_mesh import triangle_areas
from scenes.surfaces.catalogue import Cylinder

_ENCLOSED = PROVENANCE_NAMES[str(Provenance.INTERIOR.value)]


@dataclass(frozen=True, slots=True)
class Continued:
    """What was inferred of surfaces that were measured on a thing."""

    n_surfaces: int  # surfaces of which more than half of the pixels lie on the thing
    enclosed_m2: float  # inferred area in holes that their measured part encloses
    # inferred on its cylinders around what was measured: no continuation of their length, whatever the reason
    turned_m2: float
    beyond_m2: float  # all other inferred area of theirs
    beyond_by_reason: dict[str, float] = field(default_factory=dict)  # the same by why it was inferred, m2


def continued_area_of(completed: CompletedModel, hypothesis: Hypothesis, of_thing: BoolArray) -> Continued:
    """Return the area that was continued from surfaces (n_patches,) that are known to be a thing's.

    `completed`: a completion. `hypothesis`: what it inferred. `of_thing` (n_patches,) bool: which of its
    surfaces were measured on the thing.
    """
    areas = triangle_areas(hypothesis.vertices[hypothesis.faces])
    enclosed = np.array([reason == _ENCLOSED for reason in hypothesis.reasons])[hypothesis.face_reason]
    turned = _along_measured(completed, hypothesis) & ~enclosed
    counted = of_thing[hypothesis.surface]
    beyond = counted & ~enclosed & ~turned
    by_reason = np.bincount(hypothesis.face_reason[beyond], areas[beyond], len(hypothesis.reasons))
    return Continued(
        n_surfaces=int(of_thing.sum()),
        enclosed_m2=float(areas[counted & enclosed].sum()),
        turned_m2=float(areas[counted & turned].sum()),
        beyond_m2=float(areas[beyond].sum()),
        beyond_by_reason={
            name: float(area) for name, area in zip(hypothesis.reasons, by_reason, strict=True) if area > 0
        },
    )


def _along_measured(completed: CompletedModel, hypothesis: Hypothesis) -> BoolArray:
    """Which faces (m,) lie on a cylinder, between the ends of what was measured of it."""
    result = np.zeros(len(hypothesis.faces), dtype=np.bool_)
    places = completed.world_from_reference.inverse().apply(hypothesis.vertices)
    for number, patch in enumerate(completed.patches):
        if isinstance(patch.limits.chart, Cylinder):
            faces = np.flatnonzero(hypothesis.surface == number)
            along = patch.limits.chart.to_uv(places[hypothesis.faces[faces]].mean(axis=1))[:, 1]
            result[faces] = (along >= patch.limits.own_low[1]) & (along <= patch.limits.own_high[1])
    return result
