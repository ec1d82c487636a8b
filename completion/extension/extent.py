# SPDX-License-Identifier: MIT
"""Extent: how far a surface may be continued, from other surfaces and its own straight boundary."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from completion.boundary.boundary_pixels import BoundaryKind, BoundaryPixels, ended_sides, seen_ends
from completion.boundary.continuation import ALL_CUES, Cue
from completion.boundary.edges import ChartLine, find_edges
from completion.extension import limits
from completion.extension.adjacency import Adjacency, stands_upright
from completion.merging.merged_surface import MergedSurface
from completion.observe.observation import Observation
from completion.observe.user_options import UserOptions
from completion.room.planes import Role
from completion.segmentation.regions import observed_arc
from scenes.checks import ArrayValue, BoolArray, FloatArray, Value
from scenes.surfaces.catalogue import Cylinder, Plane, Surface

_MOST_POINTS = 50_000


@dataclass(frozen=True, kw_only=True, slots=True)
class ExtensionRules(Value):
    """What a continuation may use, and how sure it must be."""

    wishes: UserOptions  # of a person: how probable and how certain inferred area must be
    max_cells: int  # in how many cells at most its chart is weighed
    cues: Collection[Cue] = ALL_CUES  # what is made use of
    cell_m: float | None = None  # side of a cell, metres; None: that of the pixels


@dataclass(frozen=True, slots=True, eq=False)
class Extent(ArrayValue):
    """Where one surface may be continued.

    Attributes
    ----------
    chart : Surface
        The surface with its chart laid along the directions that bound it.
    enclosures : tuple of (int, Surface)
        Number, from 1, and shape of every other surface that encloses the room.
    cuts : tuple of Surface
        Enclosing surfaces that this one ends at; it stays on their normals' side.
    neighbours : tuple of Surface
        Other surfaces that it was seen to meet in a crease.
    own_low, own_high : (2,) float
        The rectangle of the measured part in the chart, metres.
    ends : (2, 2) float
        Chart coordinates at which enclosing planes close the low and the high sides, -inf and inf where none
        does, metres.
    end_probability : (2, 2) float
        Probability that the surface goes on to each of them.
    ended : (2, 2) bool
        Sides of that rectangle at which the surface was seen to end.
    full_turn : bool
        Whether a cylinder may be closed around its back.
    encloses : bool
        Whether the surface is a plane that bounds all that was measured, as walls and floors do.
    is_inset : bool
        Whether it is a pane or the back of a niche, which ends at its reveal.
    is_level : bool
        Whether the surface is a level plane, as floors and tables are.
    reach : (2, 2) float
        Chart coordinates past which it goes on too improbably on the low and the high sides, metres.
    by_edit, by_feature : (2, 2) bool
        Which of its ends a person set, and which the joint of a feature did.
    seen_ends : (2,) float
        Share of the boundary at the low and the high end of a cylinder at which it was seen to end.
    tilt : float
        Sine of the angle between a cylinder's axis and the nearest normal of a plane that closes it; 1 where
        none does.
    radius_sd : float
        Standard deviation of a cylinder's radius, in units of the radius.
    index : int
        Number of the surface, from 0; -1 of faces of features.
    role : str
        What it is to the room: "floor", "ceiling", "wall" or "".
    """

    chart: Surface
    enclosures: tuple[tuple[int, Surface], ...]
    cuts: tuple[Surface, ...]
    neighbours: tuple[Surface, ...]
    own_low: FloatArray
    own_high: FloatArray
    ends: FloatArray
    end_probability: FloatArray
    ended: BoolArray
    full_turn: bool
    encloses: bool
    is_inset: bool = False
    is_level: bool = False
    reach: FloatArray = field(default_factory=lambda: np.repeat([[-np.inf], [np.inf]], 2, axis=1))
    by_edit: BoolArray = field(default_factory=lambda: np.zeros((2, 2), dtype=np.bool_))
    by_feature: BoolArray = field(default_factory=lambda: np.zeros((2, 2), dtype=np.bool_))
    seen_ends: FloatArray = field(default_factory=lambda: np.zeros(2))
    tilt: float = 1.0
    radius_sd: float = 0.0
    index: int = -1
    role: Role = ""

    def window(self) -> tuple[FloatArray, FloatArray]:
        """Low and high corners (2,) of the rectangle of the chart in which a continuation is considered.

        On each side it goes to where the surface may end, as far as it may get with some probability. Without
        such an end, and where the surface was not seen to end, walls and floors may go on by their diagonal,
        cylinders by their length along the axis, and other planes by their size in that direction.
        """
        size = self.own_high - self.own_low
        further = np.array([0.0, size[1]]) if isinstance(self.chart, Cylinder) else size
        if self.encloses:
            further = np.full(2, np.linalg.norm(size))
        low = np.where(self.end_probability[0] > 0, self.ends[0], self.own_low - further * ~self.ended[0])
        high = np.where(self.end_probability[1] > 0, self.ends[1], self.own_high + further * ~self.ended[1])
        low, high = np.maximum(low, self.reach[0]), np.minimum(high, self.reach[1])
        return np.maximum(low, self.ends[0]), np.minimum(high, self.ends[1])

    def known_window(self) -> tuple[FloatArray, FloatArray]:
        """Low and high corners (2,) of the measured rectangle, widened to where it is known to end."""
        low = np.where(self.end_probability[0] > 0, self.ends[0], self.own_low)
        high = np.where(self.end_probability[1] > 0, self.ends[1], self.own_high)
        return low, high


def find_extent(
    index: int,
    surfaces: Sequence[MergedSurface],
    boundaries: Sequence[BoundaryPixels],
    adjacency: Adjacency,
    observations: Sequence[Observation],
    *,
    cues: Collection[Cue] = ALL_CUES,
    up: FloatArray | None = None,
) -> Extent:
    """Bound the continuation of surface `index`.

    The surface ends at surfaces that enclose the room. A cylinder closes around its back where it was seen
    from outside over at least 90 degrees and its radius is known.

    Parameters
    ----------
    index : int
        Which surface.
    surfaces, boundaries : sequences
        All surfaces, working frame, and the boundary pixels of each.
    adjacency : Adjacency
        Which surfaces enclose, and which meet.
    observations : sequence of Observation
        The scans.
    cues : collection of Cue
        Whether creases, enclosing planes and full turns are made use of.
    up : (3,) float, optional
        Direction that is up in the working frame; z when not given.

    Raises
    ------
    TypeError
        The surface is neither a plane nor a cylinder.
    """
    merged, encloses = surfaces[index], adjacency.encloses
    surface, points = merged.fit.surface, merged.points(observations, _MOST_POINTS)

    # 1. Neighbours: what it ends at, and what it meets in a crease.
    ending = [
        adjacency.ends[other] and adjacency.room.may_end(other, index) and Cue.ARCHITECTURAL in cues
        for other in range(len(surfaces))
    ]
    cuts = enclosing_cuts(index, surfaces, np.array(ending, dtype=np.bool_), points)
    neighbours = [
        other.fit.surface
        for number, other in enumerate(surfaces)
        if Cue.INTERSECTION in cues and adjacency.meets[index, number] and not encloses[number]
    ]

    # 2. Chart: along the directions that bound it; a cylinder with its seam at the back.
    full_turn, radius_sd = False, 0.0
    if isinstance(surface, Cylinder):
        chart: Surface = facing_chart(surface, points)
        radius_sd = merged.fit.parameter_deviations()["radius"] / surface.radius
        full_turn = Cue.FULL_TURN in cues and _may_close(surface, radius_sd, points)
    elif isinstance(surface, Plane):
        straight = [
            surface for surface in (*(cut for _, cut in cuts), *neighbours) if isinstance(surface, Plane)
        ]
        chart = aligned_chart(surface, straight, points, boundaries[index])
    else:
        raise TypeError(f"no extent is known for a {type(surface).__name__}")

    # 3. Rectangle: of what was measured, and on to the sides at which it was seen to end.
    low, high = np.quantile(chart.to_uv(points), (limits.OUTLYING_SHARE, 1 - limits.OUTLYING_SHARE), axis=0)
    boundary = boundaries[index].in_chart(surface, chart)
    sides = ended_sides(boundary, low, high)
    ended = np.isfinite(sides) | adjacency.is_inset[index]
    low, high = np.fmin(low, sides[0]), np.fmax(high, sides[1])

    # 4. Ends: where enclosing planes close the sides, and how probably it goes on to them.
    closing = [(number, cut) for number, cut in cuts if isinstance(cut, Plane)]
    ends, which = closed_sides(chart, [plane for _, plane in closing], low, high)
    stands = [
        adjacency.standing[number] * stands_upright(merged.fit, surfaces[number].fit) for number, _ in closing
    ]
    goes_on = encloses[index] or isinstance(chart, Cylinder)
    probability = np.where(np.isfinite(ends), 1.0 if goes_on else np.array([*stands, 0.0])[which], 0.0)
    probability *= not adjacency.is_inset[index]
    return Extent(
        chart=chart,
        enclosures=tuple(
            (number + 1, other.fit.surface)
            for number, other in enumerate(surfaces)
            if number != index and encloses[number]
        ),
        cuts=tuple(cut for _, cut in cuts),
        neighbours=tuple(neighbours),
        own_low=low,
        own_high=high,
        ends=ends,
        end_probability=probability,
        ended=ended,
        full_turn=full_turn,
        encloses=bool(encloses[index]) and isinstance(chart, Plane),
        is_inset=bool(adjacency.is_inset[index]),
        is_level=merged.fit.inclination(np.array([0.0, 0.0, 1.0]) if up is None else up).is_level
        and isinstance(surface, Plane),
        seen_ends=seen_ends(boundary, low[1], high[1]) if isinstance(chart, Cylinder) else np.zeros(2),
        tilt=_tilt(chart, [closing[k][1] for k in which[which >= 0]]),
        radius_sd=radius_sd,
        index=index,
        role=adjacency.room.role(index),
    )


def _tilt(chart: Surface, closing: Sequence[Plane]) -> float:
    if not isinstance(chart, Cylinder):
        return 1.0
    cosines = [min(abs(float(plane.normal_direction @ chart.direction)), 1.0) for plane in closing]
    return float(np.sqrt(1 - max(cosines, default=0.0) ** 2))


def _may_close(cylinder: Cylinder, radius_sd: float, points: FloatArray) -> bool:
    """Tell whether a cylinder may be closed around its back: seen from outside, far round, and well known."""
    known = radius_sd < limits.MOST_RADIUS_SD
    return bool(not cylinder.concave and observed_arc(cylinder, points) >= limits.FULL_TURN_ARC and known)


def with_ends(extent: Extent, planes: Sequence[Plane]) -> Extent:
    """Return the extent of a surface that goes on to `planes` and ends there, because a person says so.

    It lies on their normals' side. Where an enclosing plane is nearer, it ends at that.
    """
    ended, by_edit = _ended_at(extent, planes)
    return replace(ended, by_edit=by_edit)


def with_joints(extent: Extent, planes: Sequence[Plane]) -> Extent:
    """Return the extent of a surface that goes on to the joints of features, `planes`, and ends there."""
    ended, by_feature = _ended_at(extent, planes)
    return replace(ended, by_feature=by_feature)


def _ended_at(extent: Extent, planes: Sequence[Plane]) -> tuple[Extent, BoolArray]:
    """The extent with ends at planes, and which of the four (2, 2) are."""
    ends, _ = closed_sides(extent.chart, planes, extent.own_low, extent.own_high)
    is_new = np.stack([ends[0] > extent.ends[0], ends[1] < extent.ends[1]])
    ended = replace(
        extent,
        cuts=(*extent.cuts, *planes),
        ends=np.where(is_new, ends, extent.ends),
        end_probability=np.where(is_new, 1.0, extent.end_probability),
    )
    return ended, is_new


def aligned_chart(plane: Plane, cuts: Sequence[Plane], points: FloatArray, boundary: BoundaryPixels) -> Plane:
    """Return the plane with u along the straight boundary that was seen most of, else along its longest side.

    Boundaries are its meeting lines with the planes `cuts` and its own edges, by its boundary pixels in the
    given plane's chart; `points` (n, 3) are its measured ones, metres.
    """
    size = np.linalg.norm(boundary.step, axis=1)
    seen = boundary.only(
        (size > 0) & np.isin(boundary.kind, (BoundaryKind.CONTIGUOUS, BoundaryKind.OWN_EDGE))
    )
    size = np.linalg.norm(seen.step, axis=1)
    at = plane.from_uv(seen.uv)
    directions, supports = [], []
    for cut in cuts:
        along = np.cross(plane.normal_direction, cut.normal_direction)
        if np.linalg.norm(along) > 0.5:
            near = (np.abs(cut.distance(at)) <= size) & (seen.kind == BoundaryKind.CONTIGUOUS)
            directions.append(along)
            supports.append(float(size[near].sum()))
    for edge in find_edges(seen.only(seen.kind == BoundaryKind.OWN_EDGE)):
        if isinstance(edge.curve, ChartLine):
            directions.append(plane.from_uv(edge.curve.direction) - plane.point)
            supports.append(float(np.ptp(edge.runs, axis=1).sum()))
    if max(supports, default=0.0) > 0:
        return Plane(plane.point, plane.normal_direction, directions[int(np.argmax(supports))])
    uv = plane.to_uv(points).astype(np.float32)
    (_, _), (width, height), angle_deg = cv2.minAreaRect(uv)
    angle = np.radians(angle_deg if width >= height else angle_deg + 90.0)
    along = np.cos(angle) * plane.u_direction + np.sin(angle) * plane.v_direction
    return Plane(plane.point, plane.normal_direction, along)


def facing_chart(cylinder: Cylinder, points: FloatArray) -> Cylinder:
    """Return the cylinder with the middle of its measured points (n, 3) at u = 0, the seam at its back."""
    angle = np.sort(cylinder.to_uv(points)[:, 0] / cylinder.radius)
    gaps = np.diff(np.append(angle, angle[0] + 2 * np.pi))
    widest = int(np.argmax(gaps))
    middle = (angle[widest] + gaps[widest] / 2 + np.pi) * cylinder.radius
    outward = cylinder.from_uv(np.array([[middle, 0.0]]))[0] - cylinder.point
    return Cylinder(cylinder.point, cylinder.direction, cylinder.radius, outward, cylinder.concave)


def enclosing_cuts(
    index: int, surfaces: Sequence[MergedSurface], enclosing: BoolArray, points: FloatArray
) -> list[tuple[int, Surface]]:
    """Return the enclosing surfaces, with their indices, that have points (n, 3) of one on their inner side.

    `enclosing` (n_surfaces,) tells which of the surfaces it may end at.
    """
    cuts = []
    for other, candidate in enumerate(surfaces):
        if other == index or not enclosing[other]:
            continue
        distance = candidate.fit.surface.distance(points)
        slack = 3 * candidate.fit.rms + 0.02 * float(np.ptp(distance))
        if np.abs(distance).max() > 2 * slack and np.mean(distance > -slack) >= limits.INNER_POINTS:
            cuts.append((other, candidate.fit.surface))
    return cuts


def closed_sides(
    chart: Surface, cuts: Sequence[Plane], low: FloatArray, high: FloatArray
) -> tuple[FloatArray, NDArray[np.int64]]:
    """Find where planes close the sides of the rectangle from `low` to `high` (2,) of a chart, metres.

    Returns
    -------
    ends : (2, 2) float
        Chart coordinate at which the nearest plane closes the low and the high side (rows) along u and v
        (columns), metres; -inf and inf where none does.
    which : (2, 2) int64
        Its index, -1 for none.
    """
    ends = np.array([[-np.inf, -np.inf], [np.inf, np.inf]])
    which = np.full((2, 2), -1)
    for axis in (0, 1) if isinstance(chart, Plane) else (1,):
        for row, (sign, side) in enumerate(((-1.0, low), (1.0, high))):
            for number, cut in enumerate(cuts):
                end = _end_along(chart, cut, axis=axis, sign=sign, low=low, high=high)
                if end is not None and sign * (end - side[axis]) >= 0 > sign * (end - ends[row, axis]):
                    ends[row, axis], which[row, axis] = end, number
    return ends, which


def _end_along(
    chart: Surface, cut: Plane, axis: int, sign: float, low: FloatArray, high: FloatArray
) -> float | None:
    """Chart coordinate where the cut meets the rectangle's continuation, None if it faces away."""
    centre = (low + high) / 2
    step = np.zeros(2)
    step[axis] = max(float((high - low)[axis]), 1e-3) * 0.5
    here = centre if isinstance(chart, Plane) else np.array([0.0, centre[1]])
    pair = cut.distance(chart.from_uv(np.stack([here - step, here + step])))
    slope = float(pair[1] - pair[0]) / (2 * float(step[axis]))
    if sign * slope > -limits.SIDEWAYS_COSINE:
        return None
    corners = np.array([low, high])  # of the side
    corners[:, axis] = (high if sign > 0 else low)[axis]
    ends = corners[:, axis] - cut.distance(chart.from_uv(corners)) / slope
    return float(ends.max() if sign > 0 else ends.min())
