# SPDX-License-Identifier: MIT
"""The process of a command: its run, progress, interruption, and what ends it in one line."""
