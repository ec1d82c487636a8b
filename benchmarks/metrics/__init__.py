# SPDX-License-Identifier: MIT
"""Metrics."""
