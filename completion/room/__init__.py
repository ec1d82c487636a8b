# SPDX-License-Identifier: MIT
"""The room that scans show: up, levels, walls, and what bounds it."""
