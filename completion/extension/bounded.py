# SPDX-License-Identifier: MIT
"""Bounded surfaces: what is known of the surfaces of scans before any of them is continued."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from completion.boundary.boundary_pixels import BoundaryPixels
from completion.edits.application import apply_edits
from completion.edits.edit import Edit
from completion.evidence.evidence import Scans
from completion.extension.adjacency import Adjacency
from completion.features.engine.template import TemplateFit
from completion.merging.scan_surfaces import ScanSurfaces
from completion.relations.pipeline import RelatedSurfaces
from scenes.inclination import Up
from scenes.pose import Pose


@dataclass(frozen=True, slots=True, eq=False)
class BoundedSurfaces:
    """Surfaces, what they are to each other, and where each was seen to end; working frame.

    Attributes
    ----------
    joined : ScanSurfaces
        As found, pieces of one floor or wall joined.
    up : Up
        Which way is up in the world.
    related : RelatedSurfaces
        As a person's edits make them, where their relations hold.
    scans : Scans
        The scans as evidence.
    features : list of TemplateFit
        Openings and what else was fitted whole.
    boundaries : list of BoundaryPixels
        Where each surface was seen to end.
    adjacency : Adjacency
        Which of them meet and enclose the room.
    """

    joined: ScanSurfaces
    up: Up
    related: RelatedSurfaces
    scans: Scans
    features: list[TemplateFit]
    boundaries: list[BoundaryPixels]
    adjacency: Adjacency

    def restated(self, edits: Sequence[Edit], world_from_reference: Pose) -> BoundedSurfaces:
        """Return the same with other edits that neither merge nor split other surfaces than before.

        Raises InputError: an edit that fits no surface.
        """
        joined, tolerance = self.joined, self.joined.tolerance
        edited = apply_edits(
            joined.surfaces, edits, joined.observations, world_from_reference, tolerance.flatness_m
        )
        pairs = zip(self.related.surfaces, edited, strict=True)
        surfaces = tuple(replace(held, edits=one.edits) for held, one in pairs)
        return replace(self, related=replace(self.related, surfaces=surfaces))
