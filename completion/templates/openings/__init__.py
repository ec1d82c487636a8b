# SPDX-License-Identifier: MIT
"""Openings: doorways, windows and niches in upright planes, by the beams that go through or stop."""
