# SPDX-License-Identifier: MIT
"""Segmentation of range images into planes and cylinders; `pipeline` is the page to read."""
