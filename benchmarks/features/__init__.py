# SPDX-License-Identifier: MIT
"""Features against their truth: openings, holes, junctions, patches."""
