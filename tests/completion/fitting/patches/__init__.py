# SPDX-License-Identifier: MIT
"""Tests of free-form patches."""
