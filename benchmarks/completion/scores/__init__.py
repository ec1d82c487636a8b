# SPDX-License-Identifier: MIT
"""Scores: inferred surface held against the truth."""
