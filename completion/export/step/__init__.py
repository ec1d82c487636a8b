# SPDX-License-Identifier: MIT
"""STEP files: trimmed faces and solids by Open CASCADE."""
