# SPDX-License-Identifier: MIT
"""Efros-Leung texture synthesis: arrays in, arrays out; knows no geometry, no files, no screen."""

from texture.pipeline import fill, grow
from texture.synthesis import Synthesis

__all__ = ["Synthesis", "fill", "grow"]
