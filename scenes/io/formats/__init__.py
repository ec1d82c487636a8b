# SPDX-License-Identifier: MIT
"""Formats: what readers and writers share: registry, headers, columns, units, grids of angles."""
