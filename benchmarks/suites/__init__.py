# SPDX-License-Identifier: MIT
"""Suites."""
