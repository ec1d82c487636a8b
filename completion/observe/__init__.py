# SPDX-License-Identifier: MIT
"""Observation: scans prepared for completion, with their noise and the tolerances that follow from it."""
