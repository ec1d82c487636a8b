# SPDX-License-Identifier: MIT
"""Fits of planes, spheres, cylinders and cones with uncertainty: names; `pipeline` is the page to read."""

from completion.fitting.euclidean import fit_cylinder, fit_plane
from completion.fitting.pipeline import fit
from completion.fitting.result import FitError, SurfaceFit, inflated, surface_parameters
from completion.fitting.selection import Selection, select

__all__ = [
    "FitError",
    "Selection",
    "SurfaceFit",
    "fit",
    "fit_cylinder",
    "fit_plane",
    "inflated",
    "select",
    "surface_parameters",
]
