# SPDX-License-Identifier: MIT
"""Unorganised points and meshes of parts as planes, spheres, cylinders, cones and tori."""
