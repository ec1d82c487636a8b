# SPDX-License-Identifier: MIT
"""Engine: templates and their fits, what they are fitted to, the search, and what speaks for a fit."""
