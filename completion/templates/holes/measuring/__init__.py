# SPDX-License-Identifier: MIT
"""What was measured of plates: their planes, their charts, and what went through them."""
