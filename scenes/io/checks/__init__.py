# SPDX-License-Identifier: MIT
"""Checks of files before they are believed: limits, guarded reading, documents, images."""
