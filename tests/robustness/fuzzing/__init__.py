# SPDX-License-Identifier: MIT
"""Fuzzing: mutated files of every kind for every reader; see docs/how-it-works/robustness.md."""
