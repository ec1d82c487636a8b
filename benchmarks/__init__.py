# SPDX-License-Identifier: MIT
"""Benchmarks of occluded structure: cases of known truth, metrics, methods, and one runner."""
