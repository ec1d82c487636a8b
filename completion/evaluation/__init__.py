# SPDX-License-Identifier: MIT
"""Evaluation: scores inferred surface against arrays of truth, by stratum, with calibration.

Names are imported from the files; `score.py` is the page to read first.
"""
