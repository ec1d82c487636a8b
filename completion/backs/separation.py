# SPDX-License-Identifier: MIT
"""Separation: the pixels of one scan that are of no room, in parts that stand on one support."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage

from completion.backs import separation_limits as limits
from completion.evidence.evidence import Scans
from completion.extension.patch import Patch, in_hull
from completion.observe.observation import Observation
from completion.room.roles import Room
from completion.room.walls import Wall
from scenes.checks import BoolArray, FloatArray, IntArray
from scenes.inclination import LIMIT_DEG
from scenes.scan.projection import SphericalProjection
from scenes.surfaces.catalogue import Cylinder, Plane
from texture.engine.compiled import compiled


@dataclass(frozen=True, slots=True, eq=False)
class Support:
    """A level surface, no floor, on which things may stand; its outline in the plan."""

    number: int  # of its surface, from 0
    plane: Plane
    sd_m: float  # standard deviation of its height
    height_m: float  # of its middle along up
    outline: shapely.Geometry  # hull of what was measured of it, coordinates along the plan's axes

    def carries(self, foot: FloatArray, whole: FloatArray) -> bool:
        """Tell whether what has a foot and a whole, places (n, 2) of the plan, stands on it by itself.

        The foot lies on it. What goes along all of its side is a back or an arm of what it is of.
        """
        inside = shapely.contains_xy(self.outline.buffer(limits.GAP_M / 2), *foot.T)
        if inside.mean() < limits.INSIDE:
            return False
        _, directions = np.linalg.eigh(np.cov(foot.T) if len(foot) > 1 else np.eye(2))
        along = directions[:, 1]
        own, side = np.ptp(whole @ along), np.ptp(shapely.get_coordinates(self.outline) @ along)
        return bool(own < limits.ALONG * side)


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """Some pixels of one scan that are linked and stand on one support.

    Attributes
    ----------
    scan : int
        Number of the scan.
    pixels : (n,) int64
        Flat pixels, ascending.
    support : int
        Number of the surface, from 0, on which they stand; -1 for a floor or nothing known.
    points : (m, 3) float
        Some of its points, working frame.
    spacing_m : float
        Distance between neighbouring pixels at the median range, metres.
    sigma_m : float
        Median standard deviation of their ranges, metres.
    """

    scan: int
    pixels: IntArray
    support: int
    points: FloatArray
    spacing_m: float
    sigma_m: float


@dataclass(frozen=True, slots=True, eq=False)
class RoomFrame:
    """The directions and surfaces by which things are told from the room, working frame."""

    up: FloatArray  # (3,)
    axes: FloatArray  # (2, 3) level directions
    walls: tuple[Wall, ...]
    floors: Mapping[int, Plane]  # by the numbers of their surfaces, from 0
    ceilings: tuple[Plane, ...]
    is_room: BoolArray  # (1 + surfaces,) which numbers of pixels' surfaces, from 1, are of the room
    supports: tuple[Support, ...]  # the lowest first

    @classmethod
    def of(cls, patches: Sequence[Patch], room: Room, scans: Scans) -> RoomFrame:
        """Look at completed surfaces for what is of the room, and for supports."""
        up, observations = room.up, scans.observations
        seed = np.eye(3)[int(np.argmin(np.abs(up)))]
        first = np.cross(up, seed) / np.linalg.norm(np.cross(up, seed))
        axes = np.stack([first, np.cross(up, first)])
        eye = max(float(seen.scan.origin @ up) for seen in observations)
        roles = [_role(patch, up, eye, observations) for patch in patches]
        level = [k for k, role in enumerate(roles) if role == "level"]
        level.sort(key=lambda k: (-patches[k].observed_m2, k))
        if level and "floor" not in roles and patches[level[0]].observed_m2 > limits.GROUND_M2:
            roles[level.pop(0)] = "floor"
        supports = [_support(k, patches[k], observations, axes, up) for k in level[: limits.N_SUPPORTS]]
        return cls(
            up=up,
            axes=axes,
            walls=room.walls,
            floors={k: _plane(patches[k]) for k, role in enumerate(roles) if role == "floor"},
            ceilings=tuple(_plane(patches[k]) for k, role in enumerate(roles) if role == "ceiling"),
            is_room=np.array([False, *(role not in ("", "level") for role in roles)]),
            supports=tuple(sorted(supports, key=lambda one: one.height_m)),
        )

    def height(self, points: FloatArray) -> FloatArray:
        """Height (n,) of points (n, 3) above the highest floor below them, metres; inf without a floor."""
        if not self.floors:
            return np.full(len(points), np.inf)
        above = np.stack([plane.distance(points) for plane in self.floors.values()])
        nearest = np.where(above > -limits.GAP_M, above, np.inf).min(axis=0)
        return np.asarray(np.where(np.isfinite(nearest), nearest, above.max(axis=0)))

    def is_outside(self, points: FloatArray, origin: FloatArray, slack: FloatArray) -> BoolArray:
        """Tell which points (n, 3) are of floors, ceilings or walls to `slack` (n,), or behind them."""
        outside = np.zeros(len(points), dtype=np.bool_)
        for plane in self.floors.values():
            outside |= np.abs(plane.distance(points)) < slack
        if self.floors:
            outside |= np.max([plane.distance(points) for plane in self.floors.values()], axis=0) < 0
        for plane in self.ceilings:
            outside |= plane.distance(points) < slack
        for wall in self.walls:
            depth = wall.plane.distance(points)
            before = float(wall.plane.distance(origin[None])[0])
            if before <= 0:
                continue
            at = np.flatnonzero(depth < slack)
            part = before / np.maximum(before - np.minimum(depth[at], 0.0), 1e-9)
            place = wall.places(origin + part[:, None] * (points[at] - origin))
            outside[at] |= ((place > wall.low) & (place < wall.high)).all(axis=1)
        return outside


@dataclass(frozen=True, slots=True, eq=False)
class ScanView:
    """One scan as the separation reads it: all (rows * columns,) or (rows * columns, 3)."""

    number: int
    seen: Observation
    points: FloatArray  # working frame; NaN without return
    plan: FloatArray  # (rows * columns, 2) of these
    owners: NDArray[np.int32]
    sigma: FloatArray
    free: BoolArray  # measured, and of no room

    @classmethod
    def of(cls, number: int, seen: Observation, owners: NDArray[np.int32], frame: RoomFrame) -> ScanView:
        """Read a scan, by the surfaces `owners` (rows, columns) of its pixels, less what is of the room."""
        points, own = seen.scan.points().reshape(-1, 3), owners.ravel()
        sigma = seen.noise.deviation(seen.scan.ranges.ravel())
        free = seen.valid.ravel() & ~frame.is_room[own]
        at = np.flatnonzero(free)
        slack = np.hypot(limits.OFF_ROOM_M, limits.N_SIGMA * sigma[at])
        free[at] = ~frame.is_outside(points[at], seen.scan.origin, slack)
        plan = points @ frame.axes.T
        return cls(number=number, seen=seen, points=points, plan=plan, owners=own, sigma=sigma, free=free)

    @property
    def spacing(self) -> FloatArray:
        """Distance (rows * columns,) of neighbouring pixels on what faces the scanner, metres."""
        return np.asarray(self.seen.scan.ranges.ravel() * self.seen.scan.projection.pixel_angle)

    def linked(self, kept: BoolArray) -> IntArray:
        """Number the connected parts of kept pixels (rows * columns,), from 0; -1 elsewhere."""
        rows, columns = self.seen.scan.shape
        slack = limits.STEEP * np.where(kept, self.spacing, 0.0)
        slack += limits.N_SIGMA * np.sqrt(2.0) * self.sigma
        out = np.full(rows * columns, -1, dtype=np.int64)
        _link(self.points, kept, self.owners, slack, rows, columns, wraps(self.seen), limits.ACROSS_PX, out)
        return out

    def parts(self, frame: RoomFrame) -> Iterator[Part]:
        """Yield its parts: what stands on each support, then the rest."""
        standing = np.full(len(self.free), -1, dtype=np.int64)
        for k, support in enumerate(frame.supports):
            for pixels in self._on(support):
                standing[pixels] = k
        for k in range(-1, len(frame.supports)):
            part = self.linked(self.free & (standing == k))
            number = -1 if k < 0 else frame.supports[k].number
            yield from (self._part(pixels, number) for pixels in groups(part, limits.LEAST_PIXELS // 4))

    def _on(self, support: Support) -> Iterator[IntArray]:
        """Yield flat pixels of each group that stands on a support, and not beside it or under it."""
        height = support.plane.distance(self.points)
        slack = limits.N_SIGMA * np.hypot(self.sigma, support.sd_m) + limits.OFF_ROOM_M / 4
        west, south, east, north = support.outline.bounds
        over = (self.plan > [west, south]).all(axis=1) & (self.plan < [east, north]).all(axis=1) & self.free
        if np.count_nonzero(over & (height > slack)) < limits.LEAST_PIXELS // 4:
            return
        at = np.flatnonzero(over & (np.abs(height) < slack))
        level = self.owners == support.number + 1
        level[at] |= shapely.contains_xy(support.outline, *self.plan[at].T)
        rest = self.free & ~level
        for pixels in groups(self.linked(rest), limits.LEAST_PIXELS // 4):
            above = height[pixels]
            bottom, top = np.quantile(above, (0.02, 0.98))
            gap = limits.GAP_M + limits.STEEP * float(np.median(self.spacing[pixels])) / 2
            if (above < -slack[pixels]).mean() > limits.BELOW or bottom > gap + np.median(slack[pixels]):
                continue
            foot = pixels[above < bottom + max(limits.FOOT * (top - bottom), gap)]
            if support.carries(self.plan[foot], self.plan[pixels]):
                yield pixels

    def _part(self, pixels: IntArray, support: int) -> Part:
        """Some pixels as a part."""
        spacing, sigma = (float(np.median(values[pixels])) for values in (self.spacing, self.sigma))
        return Part(
            scan=self.number,
            pixels=pixels,
            support=support,
            points=self.points[pixels[:: max(1, len(pixels) // limits.N_POINTS)]],
            spacing_m=spacing,
            sigma_m=sigma,
        )


def _plane(patch: Patch) -> Plane:
    """The plane of a patch that is known to have one."""
    plane = patch.source.fit.surface
    if not isinstance(plane, Plane):
        raise TypeError(f"expected a plane, got {plane.kind}")
    return plane


def _role(patch: Patch, up: FloatArray, eye: float, observations: Sequence[Observation]) -> str:
    """What a surface is: of the room, "level" where things may stand on it, or "".

    A plane that faces down above the scanners is of a ceiling that may slope, a long level cylinder a pipe.
    """
    shape = patch.source.fit.surface
    if patch.limits.role or not patch.source.n_pixels:
        return patch.limits.role
    if isinstance(shape, Cylinder):
        length = float(patch.limits.own_high[1] - patch.limits.own_low[1])
        is_level = abs(float(shape.direction @ up)) < np.sin(np.radians(LIMIT_DEG))
        return "pipe" if is_level and length > limits.PIPE_DIAMETERS * 2 * shape.radius else ""
    if not isinstance(shape, Plane):
        return ""
    facing = float(shape.normal_direction @ up)
    if facing < -limits.FACING_DOWN:
        height = patch.source.points(observations, limits.N_POINTS) @ up
        return "above" if np.quantile(height, limits.FOOT) > eye else ""
    return "level" if patch.limits.is_level and patch.observed_m2 >= limits.LEAST_SUPPORT_M2 else ""


def _support(
    number: int, patch: Patch, observations: Sequence[Observation], axes: FloatArray, up: FloatArray
) -> Support:
    """A level surface as a support."""
    middle = patch.source.points(observations, limits.N_POINTS).mean(axis=0)
    sd = float(patch.stated.standard_deviation(middle[None])[0])
    return Support(number, _plane(patch), sd, float(middle @ up), _outline(patch, axes))


def _outline(patch: Patch, axes: FloatArray) -> shapely.Geometry:
    """The plan of a level surface: its hull, or, where beams passed much of that, the hulls of its pieces."""
    places = (patch.grid.centres() @ axes.T).reshape(*patch.grid.shape, 2)
    hull = in_hull(patch.observed, np.ones(patch.grid.shape, dtype=np.bool_))
    pieces = [patch.observed]
    if patch.evidence.open[hull].mean() > limits.PASSED:
        number, n = ndimage.label(patch.observed, structure=np.ones((3, 3)))
        pieces = [number == k for k in range(1, n + 1)]
    hulls = [shapely.MultiPoint(places[piece]).convex_hull for piece in pieces]
    return shapely.union_all(hulls).buffer(float(patch.grid.cell.max()) / 2)


def groups(part: IntArray, least: int) -> Iterator[IntArray]:
    """Yield the places (n,) of each number from 0 of `part` (m,) that at least so many have, ascending."""
    order = np.argsort(part, kind="stable")
    order = order[np.searchsorted(part[order], 0) :]
    for one in np.split(order, np.flatnonzero(np.diff(part[order])) + 1):
        if len(one) >= max(least, 1):
            yield one


def wraps(seen: Observation) -> bool:
    """Tell whether the first column of a scan is next to its last."""
    projection = seen.scan.projection
    if not isinstance(projection, SphericalProjection) or len(projection.azimuths) < 2:
        return False
    step = abs(float(projection.azimuths[1] - projection.azimuths[0]))
    return abs(abs(float(projection.azimuths[-1] - projection.azimuths[0])) + step - 2 * np.pi) < step


@compiled
def _root(parent: NDArray[np.int64], one: int) -> int:
    while parent[one] != one:
        parent[one] = parent[parent[one]]
        one = parent[one]
    return one


@compiled
def _link(
    points: FloatArray,
    kept: BoolArray,
    owners: NDArray[np.int32],
    slack: FloatArray,
    rows: int,
    columns: int,
    wraps: bool,
    across: int,
    out: NDArray[np.int64],
) -> None:
    """Number connected parts of kept pixels in `out`; across few others if the distance allows it."""
    parent = np.arange(rows * columns)
    for pixel in range(rows * columns):
        if not kept[pixel]:
            continue
        row, column = pixel // columns, pixel % columns
        for way in range(2):
            for step in range(1, across + 1):
                other_row = row + step if way == 1 else row
                other_column = column + step if way == 0 else column
                if other_column >= columns and wraps:
                    other_column -= columns
                if other_row >= rows or other_column >= columns:
                    break
                other = other_row * columns + other_column
                if not np.isfinite(points[other, 0]):
                    continue
                if kept[other]:
                    square = 0.0
                    for axis in range(3):
                        square += (points[pixel, axis] - points[other, axis]) ** 2
                    most = max(slack[pixel], slack[other])
                    same = owners[pixel] > 0 and owners[pixel] == owners[other]
                    if square <= most * most or same:
                        one, two = _root(parent, pixel), _root(parent, other)
                        parent[max(one, two)] = min(one, two)
                break
    n = 0
    for pixel in range(rows * columns):
        if kept[pixel]:
            if parent[pixel] == pixel:
                out[pixel] = n
                n += 1
            else:
                out[pixel] = out[_root(parent, pixel)]
