# SPDX-License-Identifier: MIT
"""Options of relations: how exactly things are built, and which values are round."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from completion.relations.relation import KINDS, RelationKind
from scenes.checks import FloatArray, InputError, Value, check_direction, frozen_copy


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RelationOptions(Value):
    """What relations are looked for, and how they are tested.

    Attributes
    ----------
    tolerance_deg, tolerance_m : float, optional
        How far things are built off what they are meant to be, as standard deviations: relations pull by as
        much and no more. 0: they hold exactly, as on machined parts. None: read off the surfaces that are
        known best (`with_tolerance`).
    up : (3,) float, optional
        Against gravity, where the sensor knows it: what is vertical or level is looked for.
    round_angle_deg : float
        Angles that are multiples of it are looked for.
    round_length_m : float, optional
        Radii and distances that are multiples of it are looked for; none when not given.
    kinds : tuple of str
        Kinds of relation that are looked for; what a person states may be of any kind.
    level : float
        Probability with which any relation that holds is rejected.

    Raises
    ------
    InputError
        A number out of range, an up without a direction.
    """

    tolerance_deg: float | None = 0.0
    tolerance_m: float | None = 0.0
    up: FloatArray | None = None
    round_angle_deg: float = 15.0
    round_length_m: float | None = None
    kinds: tuple[RelationKind, ...] = KINDS
    level: float = 1e-3

    def __post_init__(self) -> None:
        for name in ("tolerance_deg", "tolerance_m"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value >= 0):
                raise InputError(f"{name} must be a number from 0, got {value}")
        for kind in self.kinds:
            if kind not in KINDS:
                raise InputError(f"kinds must be some of {', '.join(KINDS)}, got {kind!r}")
        if not 0 < self.level < 1:
            raise InputError(f"level must lie between 0 and 1, got {self.level}")
        if not 0 < self.round_angle_deg <= 90:
            raise InputError(f"round_angle_deg must lie above 0 and up to 90, got {self.round_angle_deg}")
        if self.round_length_m is not None and not 0 < self.round_length_m < np.inf:
            raise InputError(f"round_length_m must be a positive number, got {self.round_length_m}")
        if self.up is not None:
            object.__setattr__(self, "up", frozen_copy(check_direction("up", self.up)))

    @property
    def built_sd(self) -> FloatArray:
        """Standard deviations (3,) of angles, lengths and radii, as built; 0 where it is not known yet."""
        length = self.tolerance_m or 0.0
        return np.array([np.radians(self.tolerance_deg or 0.0), length, length])


BUILT = RelationOptions(
    tolerance_deg=None,
    tolerance_m=None,
    kinds=("parallel", "perpendicular", "angle", "coplanar", "coaxial", "axis_in_plane", "equal_radius"),
)
"""How buildings are: within a tolerance that their walls tell, and distances repeat by chance."""
