# SPDX-License-Identifier: MIT
"""Features: how well openings, patterns of holes, joints and patches are found."""
