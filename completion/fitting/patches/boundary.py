# SPDX-License-Identifier: MIT
"""Boundaries: which surface a patch meets along each, and how; which joins exclude each other."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from completion.fitting.patches.patch import SIDES, SideName
from scenes.checks import InputError
from scenes.surfaces.catalogue import Cylinder, Plane

_SQUARE = 1e-10
"""Radians: planes that are off by more leave no corner at which both joins hold."""


class Join(StrEnum):
    """How a patch meets a surface along a boundary."""

    CONNECTED = "connected"  # the boundary lies on it
    TANGENT = "tangent"  # and both have one tangent plane there
    ORTHOGONAL = "orthogonal"  # and their tangent planes are at right angles there


@dataclass(frozen=True, slots=True, eq=False)
class Boundary:
    """What a patch meets along one of its boundaries.

    Attributes
    ----------
    surface : Plane or Cylinder
        In the unit of the points.
    join : Join
        How they are joined.
    deviations : mapping
        How well the surface is known, as `SurfaceFit.parameter_deviations` names it: "offset" and "normal" of
        a plane; "point", "direction" and "radius" of a cylinder. Needed where surfaces are free.

    Raises
    ------
    InputError
        Another surface, or an unknown join.
    """

    surface: Plane | Cylinder
    join: Join
    deviations: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        surface: object = self.surface
        if not isinstance(surface, Plane | Cylinder):
            kind = getattr(self.surface, "kind", type(self.surface).__name__)
            raise InputError(f"a patch is joined to planes and cylinders, not to a {kind}")
        if self.join not in tuple(Join):
            raise InputError(f"a join is one of {', '.join(Join)}, got {self.join!r}")
        object.__setattr__(self, "join", Join(self.join))


Boundaries = Mapping[SideName, Boundary]
"""By side; a side that is not named is free."""


def check_boundaries(boundaries: Boundaries) -> None:
    """Raise InputError for an unknown side, or two planes whose joins exclude each other at a corner."""
    strange = [name for name in boundaries if name not in SIDES]
    if strange:
        raise InputError(f"a patch has the boundaries {', '.join(SIDES)}, not {strange[0]!r}")
    for one in ("u0", "u1"):
        for other in ("v0", "v1"):
            if one in boundaries and other in boundaries:
                _check_corner(one, other, boundaries[one], boundaries[other])


def _check_corner(name: str, next_name: str, one: Boundary, other: Boundary) -> None:
    if not (isinstance(one.surface, Plane) and isinstance(other.surface, Plane)):
        return
    normal, next_normal = one.surface.normal_direction, other.surface.normal_direction
    across = float(np.linalg.norm(np.cross(normal, next_normal)))
    angle = float(np.arctan2(across, abs(normal @ next_normal)))
    joins = {one.join, other.join}
    if joins == {Join.TANGENT}:
        is_good, needs = angle <= _SQUARE, "in one plane"
    else:
        is_good = Join.ORTHOGONAL not in joins or abs(angle - np.pi / 2) <= _SQUARE
        needs = "square to the last digits (hold their directions: `unseen fit --axis`)"
    if not is_good:
        raise InputError(
            f"{name} ({one.join}) and {next_name} ({other.join}) exclude each other at their corner: "
            f"their planes meet at {np.degrees(angle):.6g} deg and have to be {needs}; "
            "or join one of them otherwise"
        )
