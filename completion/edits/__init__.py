# SPDX-License-Identifier: MIT
"""Edits: what a person says of a completion, read from a file and carried out."""
