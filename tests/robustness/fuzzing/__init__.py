# SPDX-License-Identifier: MIT
"""Fuzzing: valid files of every kind, spoilt in every way, given to every reader; see docs/fuzzing.md."""
