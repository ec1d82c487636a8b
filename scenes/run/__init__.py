# SPDX-License-Identifier: MIT
"""Runs: whole outputs, locks, journals, memory and limits."""
