# SPDX-License-Identifier: MIT
"""Features found whole by what is known of them: openings, rows of holes, junctions, columns, stairs."""
