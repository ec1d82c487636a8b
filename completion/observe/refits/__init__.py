# SPDX-License-Identifier: MIT
"""Refits: surfaces from all their pixels in all scans, errors along the rays."""
