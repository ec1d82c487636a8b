# SPDX-License-Identifier: MIT
"""Extension: how far a surface goes on behind its occluders, and how probable that is."""
