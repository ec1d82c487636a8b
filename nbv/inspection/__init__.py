# SPDX-License-Identifier: MIT
"""Inspection: designs that were checked against scans, and what is to be scanned next."""
