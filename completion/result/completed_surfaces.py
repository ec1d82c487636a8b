# SPDX-License-Identifier: MIT
"""Completed surfaces: the surfaces of scans, each continued as far as it goes behind its occluders."""

from __future__ import annotations

from dataclasses import dataclass

from completion.edits.edit import Edit
from completion.evidence.evidence import Scans
from completion.extension.claims import Choice
from completion.extension.extent import Mode
from completion.extension.patch import Patch
from completion.features.engine.template import TemplateFit
from completion.relations.pipeline import FoundRelations
from completion.uncertainty.joint_errors import JointErrors


@dataclass(frozen=True, slots=True, eq=False)
class CompletedSurfaces:
    """The surfaces of scans, continued behind their occluders, working frame.

    Attributes
    ----------
    patches : tuple of Patch
        The surfaces; number i + 1 in files.
    scans : Scans
        The scans as evidence, each pixel with the number of its surface.
    relations : FoundRelations, optional
        What surfaces are to each other; None where not asked for.
    errors : JointErrors
        Joint errors of the surfaces.
    features : tuple of TemplateFit
        Openings fitted whole: accepted, ambiguous and rejected ones.
    choice : Choice
        Which surfaces were wanted.
    mode : str
        How probable inferred area had to be.
    edits : tuple of Edit
        What a person says of the surfaces, world coordinates.
    """

    patches: tuple[Patch, ...]
    scans: Scans
    relations: FoundRelations | None
    errors: JointErrors
    features: tuple[TemplateFit, ...]
    choice: Choice
    mode: Mode
    edits: tuple[Edit, ...]
