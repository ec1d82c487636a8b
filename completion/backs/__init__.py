# SPDX-License-Identifier: MIT
"""Back sides: the things that stand in a room, and the closed shape of what scans show of them."""
