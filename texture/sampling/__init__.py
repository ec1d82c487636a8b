# SPDX-License-Identifier: MIT
"""Sampling: canvas, sample, template, and the matching rule."""
