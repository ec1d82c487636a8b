# SPDX-License-Identifier: MIT
"""Templates and their fit: search, refinement, evidence."""
