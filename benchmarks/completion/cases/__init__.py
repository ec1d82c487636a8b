# SPDX-License-Identifier: MIT
"""Cases of the evaluation: what is completed, by whom, and what came of it, kept in an archive."""
