# SPDX-License-Identifier: MIT
"""Texturing: measured colour in each surface's chart, continued over what is inferred."""
