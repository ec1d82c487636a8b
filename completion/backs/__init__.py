# SPDX-License-Identifier: MIT
"""Back sides: the things that stand in a room, and the shape of what no scan shows of them."""
