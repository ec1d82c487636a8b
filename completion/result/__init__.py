# SPDX-License-Identifier: MIT
"""Result: the completed model, its openings, outlines, audit, and the files that hold it."""
