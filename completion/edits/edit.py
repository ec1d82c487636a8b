# SPDX-License-Identifier: MIT
"""Edits: what a person says of completed surfaces (Dell'Acqua & Fisher 2002 work in cooperation with one)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from scenes.checks import FloatArray, InputError, check_point, check_points, frozen_copy
from scenes.surfaces.plane import Plane

Action = Literal["accept", "reject", "merge", "split", "end", "opening"]
ACTIONS: tuple[Action, ...] = get_args(Action)


@dataclass(frozen=True, slots=True, eq=False)
class Anchor:
    """A surface named by a place where it was measured, which holds however surfaces are numbered.

    Attributes
    ----------
    point : (3,) float
        On the surface, world coordinates, metres.
    kind : str, optional
        "plane" or "cylinder": what the surface there must be for the edit to be meant for it.
    name : str
        What messages call it.
    """

    point: FloatArray
    kind: str | None = None
    name: str = "the surface"

    def __post_init__(self) -> None:
        object.__setattr__(self, "point", frozen_copy(check_point("point of a surface", self.point)))


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Edit:
    """One thing that a person says of one or several surfaces; world coordinates, metres.

    Attributes
    ----------
    action : str
        "accept": hidden area is filled however improbable, never where beams went through; without an outline
        in the measured rectangle and on to its known ends. "reject": the surface is kept as measured.
        "merge": all `surfaces` are one. "split": the surface is two that end at `cut`. "end": the surface
        goes on to `cut` and ends there. "opening": there is nothing inside `outline`.
    surfaces : tuple of Anchor
        Which; one, and for "merge" two or more. Points (3,) become anchors.
    cut : Plane or (2, 3) float, optional
        Of "split" and "end": a plane, or two points of a line on the surface, to be cut straight through.
    outline : (n, 3) float, optional
        Corners on the surface, in order: of the opening; of the part that is accepted or rejected, all of the
        surface without. An accepted part need not hang together with what was measured.
    source : str
        Where it was said, for messages, such as "edits.json: edit 2".

    Raises
    ------
    InputError
        Something missing, or that this action has no use for.

    Examples
    --------
    >>> Edit(action="reject", surfaces=((4.0, 1.0, 0.5),)).surfaces[0].point.tolist()
    [4.0, 1.0, 0.5]
    """

    action: Action
    surfaces: tuple[Anchor, ...]
    cut: Plane | FloatArray | None = None
    outline: FloatArray | None = None
    source: str = "an edit"

    def __post_init__(self) -> None:
        if self.action not in ACTIONS:
            raise InputError(f"{self.source}: do must be one of {', '.join(ACTIONS)}, got {self.action!r}")
        source = f"{self.source} ({self.action})"
        object.__setattr__(self, "source", source)
        named = tuple(one if isinstance(one, Anchor) else Anchor(one) for one in self.surfaces)
        object.__setattr__(self, "surfaces", named)
        if self.action == "merge" and len(named) < 2:
            raise InputError(f"{source}: takes two surfaces or more, got {len(named)}")
        if self.action != "merge" and len(named) != 1:
            raise InputError(f"{source}: takes one surface, got {len(named)}")
        if (self.cut is not None) != (self.action in ("split", "end")):
            said = "needs a plane, or a line" if self.cut is None else "has no use for a plane or line"
            raise InputError(f"{source}: {said}")
        if self.outline is None and self.action == "opening":
            raise InputError(f"{source}: needs an outline")
        if self.outline is not None and self.action in ("merge", "split", "end"):
            raise InputError(f"{source}: has no use for an outline")
        self._check_places(source)

    def _check_places(self, source: str) -> None:
        if self.outline is not None:
            outline = check_points(f"{source}: points of the outline", self.outline)
            if len(outline) < 3:
                raise InputError(f"{source}: an outline takes three points or more, got {len(outline)}")
            object.__setattr__(self, "outline", frozen_copy(outline))
        if self.cut is not None and not isinstance(self.cut, Plane):
            line = check_points(f"{source}: points of the line", self.cut)
            if len(line) != 2 or np.allclose(line[0], line[1], rtol=0, atol=1e-6):
                raise InputError(f"{source}: a line takes two different points, got {line.tolist()}")
            object.__setattr__(self, "cut", frozen_copy(line))
