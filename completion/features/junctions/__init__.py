# SPDX-License-Identifier: MIT
"""Tangent junctions and elbows."""
