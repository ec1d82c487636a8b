# SPDX-License-Identifier: MIT
"""Profiles of parts: what is swept along a direction, or about an axis, as lines and arcs in a plane."""
