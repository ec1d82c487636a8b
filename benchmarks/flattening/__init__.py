# SPDX-License-Identifier: MIT
"""Flattening against the truth: generated walls with relief, under generated ripple."""
