# SPDX-License-Identifier: MIT
"""Surfaces: planes, spheres, cylinders, cones and tori, each with a chart."""
