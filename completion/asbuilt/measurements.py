# SPDX-License-Identifier: MIT
"""Measurements: a prepared design, aligned scans, and what their beams say of its faces, before verdicts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from completion.asbuilt.alignment import Aligned
from completion.asbuilt.beams import Evidence, Gates, Surfaces
from completion.asbuilt.deviation import Judged
from completion.asbuilt.faces import DesignFaces
from completion.asbuilt.samples import SurfaceSamples
from completion.observe.observation import Observation
from scenes.checks import FloatArray
from scenes.mesh.design import ElementMesh
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.scan.range_image import RangeImage


@dataclass(frozen=True, slots=True, eq=False)
class Measurements:
    """All that was measured, in the frame whose origin is the design's `middle`; `given` are the scans.

    The `design` has each surface once, `whole` all elements; `twins` are those left out, and whose they have.
    """

    design: ElementMesh
    whole: LabelledMesh
    twins: Mapping[int, int]
    faces: DesignFaces
    surfaces: Surfaces
    samples: SurfaceSamples
    exposed: FloatArray
    gates: Gates
    scale: float
    middle: FloatArray
    observations: tuple[Observation, ...]
    given: tuple[RangeImage, ...]
    evidence: tuple[Evidence, ...]
    aligned: Aligned
    judged: tuple[Judged, ...]
    far: tuple[Judged, ...]
    chosen: tuple[int, ...]
    warnings: tuple[str, ...]
