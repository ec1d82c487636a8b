# SPDX-License-Identifier: MIT
"""Dimensions: what people order by, with the interval in which each lies and a word on relying on it."""
