# SPDX-License-Identifier: MIT
"""Drawings of a building model: DXF, and a floor plan to scale as SVG."""
