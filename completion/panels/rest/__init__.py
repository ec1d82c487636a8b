# SPDX-License-Identifier: MIT
"""Rest: what no surface explains, as few triangles that stand off the pixels by no more than their error."""
