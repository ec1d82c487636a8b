# SPDX-License-Identifier: MIT
"""LAS and LAZ: point clouds, checked, read and written."""
