# SPDX-License-Identifier: MIT
"""Dimensions with their intervals, and whether they can be relied on."""
