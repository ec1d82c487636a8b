# SPDX-License-Identifier: MIT
"""Panels: the light model, facets that meet in their fold edges."""
