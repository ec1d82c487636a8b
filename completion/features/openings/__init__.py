# SPDX-License-Identifier: MIT
"""Doorways, windows and niches in walls."""
