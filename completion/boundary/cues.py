# SPDX-License-Identifier: MIT
"""Cues: what tells where a hidden surface goes on and where it ends, each of which can be left out."""

from __future__ import annotations

from enum import StrEnum


class Cue(StrEnum):
    """A piece of knowledge about surfaces (Dell'Acqua & Fisher 2002)."""

    MERGING = "merging"  # parts that an occluder cut apart are one surface
    INTERSECTION = "intersection"  # it ends where it was seen to meet another surface
    COLLINEAR = "collinear"  # an edge seen on both sides of an occluder goes on between
    CONVERGENT = "convergent"  # an edge that vanishes behind an occluder goes on
    CIRCULAR = "circular"  # so does an arc
    CLOSURE = "closure"  # at a seen corner an edge turns by a right angle
    ARCHITECTURAL = "architectural"  # walls and floors go on to where another one ends them
    FULL_TURN = "full-turn"  # a cylinder closes around its back


ALL_CUES = tuple(Cue)
