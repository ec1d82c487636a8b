# SPDX-License-Identifier: MIT
"""Furnished flats by seed, as triangle meshes, with the frames that a person takes of them."""
