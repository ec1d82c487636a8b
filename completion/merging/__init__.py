# SPDX-License-Identifier: MIT
"""Merging of regions that are one surface; `pipeline` is the page to read."""
