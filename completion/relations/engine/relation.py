# SPDX-License-Identifier: MIT
"""A relation: what surfaces are to each other, and what became of it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Literal, get_args

import numpy as np

from scenes.checks import InputError

RelationKind = Literal[
    "parallel",
    "perpendicular",
    "angle",
    "coplanar",
    "coaxial",
    "distance",
    "equal_distance",
    "radius",
    "equal_radius",
    "equal_ring_radius",
    "half_angle",
    "axis_in_plane",
    "vertical",
    "horizontal",
    "symmetric",
    "regular",
]
KINDS: tuple[RelationKind, ...] = get_args(RelationKind)
VALUED = ("angle", "distance", "radius", "half_angle")
_N_SURFACES = {"radius": 1, "half_angle": 1, "vertical": 1, "horizontal": 1, "equal_distance": 4}
_LEAST = {"regular": 3, "symmetric": 4}  # surfaces, of which there may be more


def kind_text(kind: RelationKind) -> str:
    """A kind of relation in words."""
    return kind.replace("_", " ")


class Status(Enum):
    """What became of a relation."""

    ACCEPTED = "accepted"
    IMPLIED = "implied"  # inferred, and others say it already
    REDUNDANT = "redundant"  # stated, and others say it already
    REJECTED = "rejected"
    UNDECIDED = "undecided"


@dataclass(frozen=True, slots=True, kw_only=True)
class Relation:
    """What surfaces are to each other, by their numbers from 0.

    Attributes
    ----------
    kind : str
        "parallel", "perpendicular": normals of planes, axes of what has one. "angle": between these, `value`
        in radians. "coplanar", "coaxial". "distance": between two parallel planes or axes, `value` in metres.
        "equal_distance": of the first two as of the last two. "radius", "half_angle": `value` in metres or
        radians. "equal_radius" (of tori the tubes'); "equal_ring_radius" of the circles in tori's tubes.
        "axis_in_plane": a plane, then what has an axis. "vertical", "horizontal": a
        plane or an axis, against gravity. "regular": three or more parallel planes or axes in a row, each as
        far from the next. "symmetric": two or more pairs, one after the other, each one's halves images of
        each other in one mirror; of planes, cylinders and spheres.
    surfaces : tuple of int
        Which.
    value : float, optional
        See `kind`.
    is_given : bool
        Whether a person stated it, else it was proposed.
    is_forbidden : bool
        Whether a person said that it does not hold: it is neither proposed nor imposed.
    status : Status
        What became of it.
    p, log_evidence : float
        Probability of so large a misfit, given what was accepted before, if it holds; logarithm of how many
        times likelier the misfit is if it holds than if the surfaces have nothing to do with each other.
    chi2, rank : float, int
        The misfit, squared, in its standard deviations, and how many degrees of freedom it takes away.
    n_tried : float
        How many such sets of surfaces there were of which it was chosen; its evidence is the less for them.
    reason : str
        In words.
    conflicts : tuple of int
        Accepted relations that it contradicts, by their places among all of the graph.

    Raises
    ------
    InputError
        An unknown kind, another number of surfaces than it has, one surface twice, a value that is missing
        or has no use.
    """

    kind: RelationKind
    surfaces: tuple[int, ...]
    value: float | None = None
    is_given: bool = False
    is_forbidden: bool = False
    status: Status = Status.UNDECIDED
    p: float = float("nan")
    log_evidence: float = float("nan")
    chi2: float = float("nan")
    rank: int = 0
    n_tried: float = 1.0
    reason: str = ""
    conflicts: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise InputError(f"a relation is one of {', '.join(KINDS)}; got {self.kind!r}")
        self._check_surfaces()
        if (self.value is not None) != (self.kind in VALUED):
            need = "needs a value" if self.kind in VALUED else "has no value"
            raise InputError(f"{self.kind} {need}, got {self.value}")
        if self.value is not None and not (np.isfinite(self.value) and self.value >= 0):
            raise InputError(f"the value of {self.kind} must be a number from 0, got {self.value}")

    def _check_surfaces(self) -> None:
        found = len(self.surfaces)
        different = f"{self.kind} relates different surfaces, got {list(self.surfaces)}"
        if self.kind in _LEAST:
            least = _LEAST[self.kind]
            if found < least or (self.kind == "symmetric" and found % 2):
                need = "pairs of surfaces, two or more" if self.kind == "symmetric" else "3 or more surfaces"
                raise InputError(f"{self.kind} is a relation of {need}, got {found}")
            if len(set(self.surfaces)) < found:
                raise InputError(different)
            return
        n = _N_SURFACES.get(self.kind, 2)
        if found != n:
            raise InputError(f"{self.kind} is a relation of {n} surfaces, got {found}")
        pairs = (self.surfaces[:2], self.surfaces[2:])
        if any(len(set(pair)) < len(pair) for pair in pairs) or (n == 4 and set(pairs[0]) == set(pairs[1])):
            raise InputError(different)

    @property
    def holds(self) -> bool:
        """Whether the surfaces are so in the end."""
        return self.status in (Status.ACCEPTED, Status.IMPLIED, Status.REDUNDANT)
