# SPDX-License-Identifier: MIT
"""Limits of texturing: samples, materials and resolution, each with unit and origin. Colours are CIELAB.

Lengths are metres and angles radians unless said. Sizes of samples and blocks, and guards against rounding,
stand where they are used. "By eye" stands for a value that was tried on examples, without a measurement.
"""

from __future__ import annotations

# Chart texture
DOUBTFUL = 0.5
"""Mean confidence below which a fill is called garbage: less than even."""

# Material
BIN = 4.0
"""Units of colour: closer ones than about two just noticeable differences (2.3) pass for one."""
RARE_SHARE = 0.002
"""Of the texels below which a colour is no material's. By eye."""
SPECK_TEXELS = 5
"""Side of the smallest spot that is another material's. By eye."""
MATERIALS_SHARE = 2 / 3
"""Of what borders the hidden area: the materials that make two thirds of it are its. By eye."""
COMMON_SHARE = 0.25
"""Of a material's neighbourhoods in which a colour of its own is found. By eye."""
SHADOW_LUMINANCE = 0.6
"""Of the usual luminance, below which a place lies in shadow. By eye."""
EDGE_LUMINANCE = 0.75
"""Just within a shadow over that just outside it, at most: shading has no edge. By eye."""
SAME_CHROMA = 8.0
"""Units of chroma between a material in light and in shadow: two bins."""
LEAST_COSINE = 0.05
"""Of incidence, 87 deg: more oblique pixels say nothing of detail."""
COARSEST_TEXELS = 2.0
"""Longest side of a pixel whose colour shows a texture as fine as the chart's. By eye."""
FEWEST_SHARE = 0.25
"""Of a surface's own texels that are sampled, however coarse. By choice."""
FEWEST_TEXELS = 400
"""Of a sample: fewer are no texture. By eye."""

# Pipeline
MOSTLY = 0.5
"""Share of a coarser texel that makes it one of the same."""
FULL_SHARE = 0.75
"""Of a block that makes it a good one. By choice."""
RIM_TEXELS = 4
"""From the hidden area, within which colour may be the occluder's. By eye."""
BEYOND_CELLS = 5.0
"""Beyond what is covered, that facets may reach: up to the fold where they end."""
