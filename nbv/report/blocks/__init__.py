# SPDX-License-Identifier: MIT
"""Blocks of reports: tables, figures and pictures that several reports share."""
