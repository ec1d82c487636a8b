# SPDX-License-Identifier: MIT
"""Surfaces: planes, spheres, cylinders and cones, each with a metric chart."""
