# SPDX-License-Identifier: MIT
"""Candidates: what registration compares of a scan, and the poses that two scans propose."""
