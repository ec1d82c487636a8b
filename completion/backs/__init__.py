# SPDX-License-Identifier: MIT
"""Back sides of things: symmetries, the surface that they imply, closed shapes, volume and depth."""
