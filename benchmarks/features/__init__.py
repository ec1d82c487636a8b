# SPDX-License-Identifier: MIT
"""Benchmarks of features: how often they are found, how exactly, and how often where there are none."""
