# SPDX-License-Identifier: MIT
"""Edits: what a person says of completed surfaces (Dell'Acqua & Fisher 2002 work in cooperation with one).

`Fitted...` values are what features that were fitted whole say of surfaces: openings, holes, joints, faces.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon, contains_xy

from completion.boundary.edges import ChartLine, Circle
from completion.boundary.meshing import Trim
from completion.evidence.chart_grid import ChartGrid
from completion.merging.merged_surface import MergedSurface
from scenes.checks import BoolArray, FloatArray, InputError, Value, check_point, check_points, frozen_copy
from scenes.surfaces.catalogue import Plane, Surface

_CORNERS = 48  # of a round hole's outline


@dataclass(frozen=True, slots=True, eq=False)
class FittedOpening(Value):
    """An opening fitted as a whole and accepted by evidence; working frame, metres.

    Attributes
    ----------
    outline : (4, 3) float
        Corners from the lower left, anticlockwise as seen from the room; sides lead from each to the next.
    deviation : (4,) float
        Standard deviation of each side across itself.
    seen : (4,) float
        Share of each side that was seen; 0 of one that nobody saw.
    slack : (4, 2) float
        How far inwards and outwards a side may be off that nobody saw; 0 of others.
    number : int
        Which feature it is, from 1.
    """

    outline: FloatArray
    deviation: FloatArray
    seen: FloatArray
    slack: FloatArray
    number: int


@dataclass(frozen=True, slots=True, eq=False)
class FittedHole(Value):
    """A round hole of a row, a grid or a circle, which are all equal; working frame, metres.

    Attributes
    ----------
    centre : (3,) float
        Its middle.
    axis : (3,) float
        Across the plate.
    radius : float
        Of all holes of the pattern.
    deviation : float
        Standard deviation of its place, in the direction in which it is known worst.
    seen : float
        Share of its rim that was seen.
    number : int
        Which feature it is of, from 1.
    """

    centre: FloatArray
    axis: FloatArray
    radius: float
    deviation: float
    seen: float
    number: int

    @property
    def outline(self) -> FloatArray:
        """Corners (n, 3) along its rim, as if it had so many."""
        angle = np.linspace(0.0, 2 * np.pi, _CORNERS, endpoint=False)
        return Plane(self.centre, self.axis).from_uv(
            self.radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        )

    def rim(self, chart: Surface) -> Circle:
        """Its rim in the chart of the plane that it lies in."""
        return Circle(chart.to_uv(self.centre[None])[0], self.radius)

    def within(self, grid: ChartGrid) -> tuple[tuple[slice, slice], FloatArray]:
        """A box of a grid about it, and how far within its rim those cells (rows, columns) lie, metres."""
        rim, most = self.rim(grid.surface), np.array(grid.shape[::-1])
        reach = self.radius + grid.cell
        low, high = (
            np.clip(np.floor((rim.centre + sign * reach - grid.corner) / grid.cell), 0, most)
            for sign in (-1, 1)
        )
        columns, rows = (slice(int(low[axis]), int(high[axis]) + 1) for axis in (0, 1))
        u, v = grid.axes()
        return (rows, columns), rim.across(np.stack(np.meshgrid(u[columns], v[rows]), axis=-1))


@dataclass(frozen=True, slots=True, eq=False)
class FittedJoint(Value):
    """Where a surface ends at another one that it was fitted together with; working frame.

    Attributes
    ----------
    plane : Plane
        The surface lies on its normal's side.
    number : int
        Which feature it is of, from 1.
    """

    plane: Plane
    number: int


@dataclass(frozen=True, slots=True, eq=False)
class KnownFace:
    """A face whose place and outline are known from the feature that it is of; working frame.

    Attributes
    ----------
    surface : MergedSurface
        The plane, its normal to the side that is free, its chart along the outline with the origin in the
        middle; and what was measured of it, which may be nothing.
    size : (2,) float
        Along u and v, metres.
    feature : int
        Which feature it is of, from 1.
    """

    surface: MergedSurface
    size: FloatArray
    feature: int


Action = Literal["accept", "reject", "merge", "split", "end", "opening"]
ACTIONS: tuple[Action, ...] = get_args(Action)

_LEAST_SIDE_M = 1e-9  # of an outline


@dataclass(frozen=True, slots=True, eq=False)
class Anchor(Value):
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
class Edit(Value):
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
        named = tuple(
            surface if isinstance(surface, Anchor) else Anchor(surface) for surface in self.surfaces
        )
        object.__setattr__(self, "surfaces", named)
        if self.action == "merge" and len(named) < 2:
            raise InputError(f"{source}: takes two surfaces or more, got {len(named)}")
        if self.action != "merge" and len(named) != 1:
            raise InputError(f"{source}: takes one surface, got {len(named)}")
        if (self.cut is not None) != (self.action in ("split", "end")):
            sentence = "needs a plane, or a line" if self.cut is None else "has no use for a plane or line"
            raise InputError(f"{source}: {sentence}")
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


@dataclass(frozen=True, slots=True, eq=False)
class Wish(Value):
    """Hidden area that a person accepts or rejects: inside an outline (n, 3), or all of the surface's."""

    accepts: bool
    outline: FloatArray | None = None


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceEdits(Value):
    """What a person says of one surface; working frame, metres."""

    actions: tuple[Action, ...] = ()  # what was done to it, in order
    ends: tuple[Plane, ...] = ()  # where it ends; it lies on their normals' side
    wishes: tuple[Wish, ...] = ()  # what is accepted and rejected; later ones prevail
    openings: tuple[FloatArray, ...] = ()  # (n, 3) outlines in which there is nothing
    fitted: tuple[FittedOpening, ...] = ()  # what was fitted as a whole, and nobody said
    holes: tuple[FittedHole, ...] = ()  # of patterns that were fitted as a whole
    joints: tuple[FittedJoint, ...] = ()  # where it ends at what it was fitted together with

    @property
    def outlines(self) -> tuple[FloatArray, ...]:
        """Outlines (n, 3) with corners, of declared and fitted openings."""
        return (*self.openings, *(opening.outline for opening in self.fitted))

    @property
    def of_features(self) -> SurfaceEdits:
        """Those of it that features say, and no person."""
        return SurfaceEdits(fitted=self.fitted, holes=self.holes, joints=self.joints)

    @property
    def is_joined(self) -> bool:
        """Whether a person joined it from several."""
        return "merge" in self.actions

    def labels(self, grid: ChartGrid) -> NDArray[np.int8]:
        """Label each cell (rows, columns): 1 accepted, -1 rejected, 0 neither."""
        labels = np.zeros(grid.shape, np.int8)
        for wish in self.wishes:
            labels[_area(grid, wish.outline)] = 1 if wish.accepts else -1
        return labels

    def accepted_cells(self, grid: ChartGrid, known: BoolArray) -> BoolArray:
        """Cells (rows, columns) to be filled: inside a drawn outline, without one those `known` to fit."""
        return np.asarray((self.labels(grid) > 0) & (known | self.outlined_cells(grid)), dtype=np.bool_)

    def rejected_cells(self, grid: ChartGrid) -> BoolArray:
        """Cells (rows, columns) that are to stay as measured."""
        return np.asarray(self.labels(grid) < 0, dtype=np.bool_)

    def outlined_cells(self, grid: ChartGrid) -> BoolArray:
        """Cells (rows, columns) inside an outline that was drawn around what is accepted."""
        inside = np.zeros(grid.shape, dtype=np.bool_)
        for wish in self.wishes:
            if wish.accepts and wish.outline is not None:
                inside |= _area(grid, wish.outline)
        return inside

    def open_cells(self, grid: ChartGrid) -> BoolArray:
        """Cells (rows, columns) whose centre lies in a declared or fitted opening."""
        inside = np.zeros(grid.shape, dtype=np.bool_)
        for outline in self.outlines:
            inside |= _area(grid, outline)
        for hole in self.holes:
            box, within = hole.within(grid)
            inside[box] |= within > 0
        return inside

    def declared_cells(self, grid: ChartGrid) -> BoolArray:
        """Cells (rows, columns) whose centre lies in a declared opening, or a hole of a fitted pattern."""
        return replace(self, fitted=()).open_cells(grid)

    def trims(self, grid: ChartGrid) -> Iterator[Trim]:
        """Yield the sides of declared and fitted openings, where the mesh of inferred cells is cut."""
        for outline in self.outlines:
            corners = outline_uv(grid.surface, outline)
            sign = -1.0 if Polygon(corners).exterior.is_ccw else 1.0
            for shift in _turns(grid):
                for start, end in zip(corners + shift, np.roll(corners, -1, axis=0) + shift, strict=True):
                    side = _side(grid, start, end, sign)
                    if side is not None and side.cells.any():
                        yield side
        for hole in self.holes:
            box, within = hole.within(grid)
            cells = np.zeros(grid.shape, dtype=np.bool_)
            cells[box] = np.abs(within) <= _half_diagonal(grid)
            if cells.any():
                yield Trim(hole.rim(grid.surface), -1.0, cells)


def outline_uv(chart: Surface, outline: FloatArray) -> FloatArray:
    """Corners (n, 2) of an outline (n, 3) in a chart, also where it crosses the seam of a cylinder."""
    uv = chart.to_uv(outline)
    if np.isfinite(chart.period):
        uv[:, 0] = np.unwrap(uv[:, 0], period=chart.period)
    return uv


def _turns(grid: ChartGrid) -> list[FloatArray]:
    """Shifts in the chart that lead to the same places."""
    period = grid.surface.period
    return [np.array([k * period, 0.0]) for k in (-1, 0, 1)] if np.isfinite(period) else [np.zeros(2)]


def _area(grid: ChartGrid, outline: FloatArray | None) -> BoolArray:
    """Cells whose centre lies inside an outline; all without one."""
    if outline is None:
        return np.ones(grid.shape, dtype=np.bool_)
    corners, uv = outline_uv(grid.surface, outline), grid.centres_uv()
    inside = np.zeros(grid.shape, dtype=np.bool_)
    for shift in _turns(grid):
        inside |= contains_xy(Polygon(corners + shift), uv[..., 0], uv[..., 1])
    return inside


def _half_diagonal(grid: ChartGrid) -> float:
    return float(np.hypot(*grid.cell)) / 2


def _side(grid: ChartGrid, start: FloatArray, end: FloatArray, sign: float) -> Trim | None:
    """One side of an outline as a cut through the cells that it crosses; None of no length."""
    length = float(np.linalg.norm(end - start))
    if length <= _LEAST_SIDE_M:
        return None
    line = ChartLine(start, (end - start) / length)
    uv = grid.centres_uv()
    half = _half_diagonal(grid)
    along = line.along(uv)
    near = (np.abs(line.across(uv)) <= half) & (along >= -half) & (along <= length + half)
    return Trim(line, sign, near)
