# SPDX-License-Identifier: MIT
"""Figures of reports: plots, floor plans, pictures."""
