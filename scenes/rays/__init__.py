# SPDX-License-Identifier: MIT
"""Rays: Embree behind checked input, ranges in float64. No other folder knows Embree."""
