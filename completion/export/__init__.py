# SPDX-License-Identifier: MIT
"""Completed models for other programs: building elements, dimensions, DXF, SVG, IFC, STEP."""
