# SPDX-License-Identifier: MIT
"""Visibility: which samples of a surface are seen from where, and whether that meets a requirement."""
