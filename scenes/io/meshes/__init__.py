# SPDX-License-Identifier: MIT
"""Meshes: readers, checks and writers of their files."""
