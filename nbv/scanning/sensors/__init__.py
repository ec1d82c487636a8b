# SPDX-License-Identifier: MIT
"""Sensors: apertures and pixels, and instruments by name."""
