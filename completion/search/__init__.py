# SPDX-License-Identifier: MIT
"""Search: the best of what no gradient leads to, better with every evaluation."""
