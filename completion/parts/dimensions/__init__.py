# SPDX-License-Identifier: MIT
"""Dimensions of parts: sizes, distances, angles, depths and patterns, each with its interval."""
