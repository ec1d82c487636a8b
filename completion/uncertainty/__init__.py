# SPDX-License-Identifier: MIT
"""Uncertainty: covariances that hold, though errors of neighbouring pixels are alike."""
