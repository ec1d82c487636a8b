# SPDX-License-Identifier: MIT
"""Mesh formats: each checked before a library believes it."""
