# SPDX-License-Identifier: MIT
"""Real scans of a place without a model: what they cover, and where to stand next."""
