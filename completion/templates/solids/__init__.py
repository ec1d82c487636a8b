# SPDX-License-Identifier: MIT
"""Solids: objects of several faces on a floor, as instances of what any template is."""
