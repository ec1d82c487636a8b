# SPDX-License-Identifier: MIT
"""Curves in which surfaces meet, and the corners where these do."""
