# SPDX-License-Identifier: MIT
"""Building: the light model in world coordinates, what each surface is in a room, and cuts through it."""
