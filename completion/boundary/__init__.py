# SPDX-License-Identifier: MIT
"""Boundaries of surfaces, seen and continued behind occluders: pixels, edges, hidden regions and labels."""
