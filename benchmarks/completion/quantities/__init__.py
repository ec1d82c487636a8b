# SPDX-License-Identifier: MIT
"""Quantities: areas, thicknesses, openings and volumes of a completed building against its own elements."""
