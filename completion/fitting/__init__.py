# SPDX-License-Identifier: MIT
"""Fits of planes, spheres, cylinders and cones with uncertainty; `pipeline` is the page to read."""
