# SPDX-License-Identifier: MIT
"""Building: what a completed model consists of, which drawings, IFC files and decisions are made of."""

from __future__ import annotations

from completion.export.building.bodies import Beams
from completion.export.building.model import building_model
from completion.export.building.parts import BuildingParts, building_parts
from completion.observe.tolerance import REGISTRATION_M, EvidenceOptions
from completion.result.completed_model import CompletedModel
from completion.result.polygons import polygons_record


def building_of(completion: CompletedModel) -> BuildingParts:
    """Return the light model in world coordinates with its walls, slabs, rooms, columns and pipes."""
    several = len(completion.observations) > 1
    tolerance = EvidenceOptions().tolerance(
        flatness_m=completion.flatness_m, registration_m=REGISTRATION_M if several else 0.0
    )
    model = building_model(
        completion.panels(),
        completion.patches,
        polygons_record(completion),
        completion.errors,
        world=completion.world_from_reference,
    )
    return building_parts(
        model,
        Beams.of(completion.observations, completion.found.reach, completion.world_from_reference, tolerance),
    )
