# SPDX-License-Identifier: MIT
"""Unseen sides of parts, by mirror planes and axes of their surfaces."""
