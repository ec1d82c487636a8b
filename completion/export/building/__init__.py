# SPDX-License-Identifier: MIT
"""Building elements: storeys, rooms, walls, slabs, columns, pipes."""
