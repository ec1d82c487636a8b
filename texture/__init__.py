# SPDX-License-Identifier: MIT
"""Efros-Leung texture synthesis: arrays in, arrays out; knows no geometry, no files, no screen."""

from texture.analysis.lattice import Lattice, find_lattice, measure_phase_error
from texture.analysis.quality import measure_distance, measure_seam, measure_verbatim_share
from texture.examination import Examination, examine
from texture.pipeline import fill, grow
from texture.result import Synthesis
from texture.surface.surface_fill import SurfaceFill, fill_surface

__all__ = [
    "Examination",
    "Lattice",
    "SurfaceFill",
    "Synthesis",
    "examine",
    "fill",
    "fill_surface",
    "find_lattice",
    "grow",
    "measure_distance",
    "measure_phase_error",
    "measure_seam",
    "measure_verbatim_share",
]
