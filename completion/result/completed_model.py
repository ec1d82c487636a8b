# SPDX-License-Identifier: MIT
"""Completed model: the result, in which what was measured and what was inferred are never mixed up."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from completion.edits.application import anchor_point
from completion.edits.edit import Edit
from completion.extension.extent import Mode
from completion.extension.patch import Patch
from completion.observe.observation import Observation
from completion.result.audit import AuditResult
from completion.result.derived_model import DerivedModel, DerivedSurface
from completion.result.labelled_points import LabelledPoints
from completion.texturing.chart_texture import ChartTexture
from scenes.checks import FloatArray, InputError
from scenes.pose import Pose

_MOST_SURFACES = 6  # that a card lists


@dataclass(frozen=True, slots=True, eq=False)
class CompletedModel:
    """What `complete` found, before any file; `Completion` describes the attributes."""

    observations: tuple[Observation, ...]
    patches: tuple[Patch, ...]
    textures: tuple[ChartTexture | None, ...]
    hypothesised: LabelledPoints
    audit: AuditResult
    owners: tuple[NDArray[np.int32], ...]
    mode: Mode
    edits: tuple[Edit, ...]
    world_from_reference: Pose
    derived: DerivedModel = field(init=False, repr=False)

    def __post_init__(self) -> None:
        pairs = zip(self.patches, self.hypothesised.charts, strict=True)
        surfaces = tuple(DerivedSurface(patch, mesh) for patch, mesh in pairs)
        derived = DerivedModel(self.observations, self.owners, surfaces, self.textures)
        object.__setattr__(self, "derived", derived)

    @property
    def observed_m2(self) -> float:
        """Measured area of all surfaces, square metres."""
        return float(sum(patch.observed_m2 for patch in self.patches))

    @property
    def hypothesised_m2(self) -> float:
        """Inferred area of all surfaces, square metres."""
        return self.hypothesised.area_m2

    @property
    def free_space_violation_m2(self) -> float:
        """Inferred area that observed beams went through, by the audit, square metres."""
        return self.audit.violation_m2

    def anchor(self, number: int) -> FloatArray:
        """Return a measured point (3,) deep inside surface `number`, from 1: its name in edits.

        World coordinates, metres.

        Raises
        ------
        InputError
            There is no such surface.
        """
        if not 1 <= number <= len(self.patches):
            raise InputError(f"there is no surface {number}: there are {len(self.patches)}, counted from 1")
        point = anchor_point(self.patches[number - 1].source, self.observations)
        return self.world_from_reference.apply(point)

    def observed_mesh(self) -> LabelledPoints:
        """Return all measured points of all scans as one mesh, working frame."""
        return self.derived.observed

    def _repr_html_(self) -> str:
        """What a notebook shows: measured and inferred area, the largest surfaces, a small picture."""
        from scenes.card import INFERRED, MEASURED, Card, Share  # only notebooks need it and the picture
        from scenes.scan.thumbnail import thumbnails

        observed, inferred = self.observed_m2, self.hypothesised_m2
        whole = max(observed + inferred, 1e-12)
        more = f" (+{100 * inferred / observed:.1f} %)" if observed > 0 else ""
        figures = [
            ("measured", f"{observed:.2f} m\u00b2 on {len(self.patches)} surfaces"),
            ("inferred", f"{inferred:.2f} m\u00b2{more}, mode {self.mode}"),
            ("inferred where a beam went through", f"{self.free_space_violation_m2:.3f} m\u00b2"),
            *(
                (f"surface {number}", f"{patch.grid.surface.kind}, {_areas(patch)}")
                for number, patch in enumerate(self.patches[:_MOST_SURFACES], start=1)
            ),
        ]
        rest, first = len(self.patches) - _MOST_SURFACES, self.observations[0].scan
        return Card(
            "Completion",
            first.name if len(self.observations) == 1 else f"{len(self.observations)} scans",
            figures,
            bar=(
                Share("measured", observed / whole, MEASURED),
                Share("inferred", inferred / whole, INFERRED),
            ),
            pictures=thumbnails(first.ranges, first.colour, first.projection)[:1],
            note=f"and {rest} more" if rest > 0 else "",
        ).to_html()


def _areas(patch: Patch) -> str:
    """Measured and inferred area of a surface."""
    inferred = f" + {patch.hypothesised_m2:.2f} m\u00b2 inferred" if patch.hypothesised_m2 > 0 else ""
    return f"{patch.observed_m2:.2f} m\u00b2{inferred}"
