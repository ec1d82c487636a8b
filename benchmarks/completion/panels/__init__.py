# SPDX-License-Identifier: MIT
"""Benchmark of the light model: its folds and facets against the truth, and other programs."""
