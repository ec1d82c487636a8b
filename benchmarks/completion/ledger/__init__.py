# SPDX-License-Identifier: MIT
"""Ledger: what was inferred of real and of simulated frames, surface by surface, and what is there."""
