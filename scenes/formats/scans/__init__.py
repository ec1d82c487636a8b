# SPDX-License-Identifier: MIT
"""Scan formats: organised points, text and clouds as range images."""
