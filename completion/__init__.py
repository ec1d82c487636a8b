# SPDX-License-Identifier: MIT
"""Completion: the surfaces behind occluders, inferred, bounded, textured, and marked as inferred."""

from completion.evidence import EvidenceOptions, Label
from completion.extension import Patch, Provenance
from completion.fitting import FitError, SurfaceFit, fit_cylinder, fit_plane
from completion.growing import SegmentationOptions
from completion.model import Completion
from completion.pipeline import CompletionOptions, complete
from completion.texturing import TexturingOptions

__all__ = [
    "Completion",
    "CompletionOptions",
    "EvidenceOptions",
    "FitError",
    "Label",
    "Patch",
    "Provenance",
    "SegmentationOptions",
    "SurfaceFit",
    "TexturingOptions",
    "complete",
    "fit_cylinder",
    "fit_plane",
]
