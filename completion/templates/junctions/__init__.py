# SPDX-License-Identifier: MIT
"""Junctions: surfaces that run into each other, fitted as one: tangent by construction."""
