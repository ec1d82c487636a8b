# SPDX-License-Identifier: MIT
"""Figures of reports: plots and floor plans."""
