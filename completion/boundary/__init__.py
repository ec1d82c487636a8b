# SPDX-License-Identifier: MIT
"""Boundaries of surfaces, seen and continued behind occluders: rim pixels, edges, pieces and their labels."""
