# SPDX-License-Identifier: MIT
"""IFC: a building's parts as an IFC4 file, with what was measured of each and how well it is known."""
