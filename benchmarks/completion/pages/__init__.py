# SPDX-License-Identifier: MIT
"""Pages of the evaluation: summaries, tables, plots and their text."""
