# SPDX-License-Identifier: MIT
"""Benchmarks: what is measured side by side, outside the wheel."""
