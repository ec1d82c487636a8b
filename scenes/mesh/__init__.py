# SPDX-License-Identifier: MIT
"""Meshes: labelled triangles, their appearance, and what is doubtful about them."""
