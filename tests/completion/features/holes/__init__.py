# SPDX-License-Identifier: MIT
"""Tests of hole patterns."""
