# SPDX-License-Identifier: MIT
"""Efros-Leung texture synthesis: arrays in, arrays out; knows no geometry, no files, no screen."""

from texture.examination import Examination, examine
from texture.pipeline import fill, grow
from texture.quality import measure_distance, measure_seam, measure_verbatim_share
from texture.surface import SurfaceFill, fill_surface
from texture.synthesis import Synthesis

__all__ = [
    "Examination",
    "SurfaceFill",
    "Synthesis",
    "examine",
    "fill",
    "fill_surface",
    "grow",
    "measure_distance",
    "measure_seam",
    "measure_verbatim_share",
]
