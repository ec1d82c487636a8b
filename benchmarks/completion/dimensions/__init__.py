# SPDX-License-Identifier: MIT
"""Dimensions of rooms of known truth: whether intervals hold, and what advice is worth."""
