# SPDX-License-Identifier: MIT
"""The engine: compiled scans of the sample, and the passes that use them."""
