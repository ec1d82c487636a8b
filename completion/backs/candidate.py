# SPDX-License-Identifier: MIT
"""Candidate: joined parts, whether they are a thing, and what that stands on and touches."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from completion.backs import separation_limits as limits
from completion.backs.separation import Part, RoomFrame
from completion.backs.standing import BORDER, OCCLUDER, ROOM, UNKNOWN, Outlines
from completion.backs.thing import Cut, Thing, UprightBox
from completion.evidence.evidence import Scans
from completion.extension.patch import Patch
from completion.room.walls import Wall
from scenes.checks import BoolArray, FloatArray, IntArray
from scenes.pose import Pose


class OutOfSight(NamedTuple):
    """Whether the foot and the top of something go on out of sight, and the top past the border."""

    foot: bool
    top: bool
    past_border: bool


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """Parts that may be a thing, working frame; the largest part first."""

    parts: tuple[Part, ...]
    scans: Scans
    pixels: tuple[IntArray, ...]  # of each scan, flat, ascending
    points: FloatArray  # (n, 3) some of them
    support: int  # number of the surface on which most of them stand, from 0; -1 for a floor or nothing known

    @classmethod
    def of(cls, parts: Sequence[Part], scans: Scans) -> Candidate:
        """Put parts of one thing together."""
        pixels = []
        for scan in range(len(scans.observations)):
            held = [part.pixels for part in parts if part.scan == scan]
            pixels.append(np.sort(np.concatenate([np.zeros(0, np.int64), *held])))
        support = np.array([part.support + 1 for part in parts])
        most = np.bincount(support, [len(part.pixels) for part in parts]).argmax() - 1
        points = np.concatenate([part.points for part in parts])
        return cls(tuple(parts), scans, tuple(pixels), points, int(most))

    @property
    def n_pixels(self) -> int:
        """Pixels in the scan that shows most of it."""
        return max(len(pixels) for pixels in self.pixels)

    @property
    def slack_m(self) -> float:
        """Distance that noise and sampling leave open, metres."""
        part = self.parts[0]
        return limits.N_SIGMA * part.sigma_m + limits.STEEP / 2 * part.spacing_m

    def is_resolved(self, frame: RoomFrame, outlines: Outlines) -> bool:
        """Tell whether it has pixels enough, rises above what is flat, and is not a mere glimpse."""
        share = max(
            len(pixels) / seen.scan.ranges.size
            for pixels, seen in zip(self.pixels, self.scans.observations, strict=True)
        )
        if share < limits.LEAST_SHARE or self.n_pixels < limits.LEAST_PIXELS:
            return False
        pairs = zip(outlines.each, self.pixels, strict=True)
        ends = np.concatenate([outline.ends[0, outline.at(pixels)] for outline, pixels in pairs])
        cut = np.isin(ends[ends > 0], (BORDER, OCCLUDER)).mean()
        if cut > limits.GLIMPSE_CUT and share < limits.GLIMPSE_SHARE:
            return False
        if self.is_between(frame):
            return False
        box = self.box(frame)
        sides = np.sort(box.size)
        least = limits.LEAST_SPACINGS * self.parts[0].spacing_m
        rises = box.size[2] > max(limits.OFF_PLANE * box.diagonal_m, limits.N_SIGMA * self.parts[0].sigma_m)
        return bool(sides[1] >= least and rises)

    def is_between(self, frame: RoomFrame) -> bool:
        """Tell whether it is of beams that met two surfaces: of no surface, and deep along the beams."""
        scan, pixels = self.parts[0].scan, self.parts[0].pixels
        is_free = self.scans.owners[scan].ravel()[pixels] == 0
        plan = self.parts[0].points @ frame.axes.T
        away = plan.mean(axis=0) - self.scans.observations[scan].scan.origin @ frame.axes.T
        frame_of = np.stack([away, [-away[1], away[0]]]) / max(float(np.linalg.norm(away)), 1e-9)
        depth, width = np.ptp(np.quantile(plan @ frame_of.T, (0.05, 0.95), axis=0), axis=0)
        return bool(is_free.mean() > limits.UNEXPLAINED and depth > limits.RADIAL * width)

    def is_cut(self, outlines: Outlines) -> bool:
        """Tell whether the border cuts it in each scan that shows it."""
        pairs = zip(outlines.each, self.pixels, strict=True)
        return all(outline.cut(held)[0] for outline, held in pairs if len(held))

    def plan(self, frame: RoomFrame) -> shapely.Geometry:
        """The convex hull of its plan, along the frame's level axes."""
        return shapely.MultiPoint(self.points @ frame.axes.T).convex_hull

    def area(self, frame: RoomFrame) -> shapely.Geometry:
        """The plan that it may take up: what was measured, and behind that as much as half its width."""
        plan = self.plan(frame)
        eye = self.scans.observations[self.parts[0].scan].scan.origin @ frame.axes.T
        away = np.array(plan.centroid.coords[0]) - eye
        away = away / max(float(np.linalg.norm(away)), 1e-9)
        width = float(np.ptp(self.points @ frame.axes.T @ np.array([-away[1], away[0]])))
        step = min(limits.DEEP * width, limits.DEEPEST_M) * away
        behind = shapely.transform(plan, lambda places: places + step)
        return shapely.union(plan, behind).convex_hull.buffer(self.slack_m)

    def box(self, frame: RoomFrame) -> UprightBox:
        """The least upright box, working frame."""
        plan = self.points @ frame.axes.T
        ring = shapely.get_coordinates(shapely.MultiPoint(plan).minimum_rotated_rectangle)
        side = ring[1] - ring[0] if len(ring) > 1 else np.array([1.0, 0.0])
        first = side @ frame.axes / max(float(np.linalg.norm(side)), 1e-12)
        axes = np.stack([first, np.cross(frame.up, first), frame.up])
        places = self.points @ axes.T
        return UprightBox(axes, places.min(axis=0), places.max(axis=0))

    def stands(self, frame: RoomFrame, outlines: Outlines) -> bool:
        """Tell whether it may stand in the room.

        What comes up to a wall and was seen to end above the floor hangs there. What stays close to a wall,
        reaches the ceiling, or goes up out of sight, is taken to be of the building.
        """
        if any(self.lies_along(wall) for wall in frame.walls):
            return False
        hidden = self.hidden(frame, outlines)
        for plane in frame.ceilings:
            if np.quantile(plane.distance(self.points), 0.01) < limits.BUILT_IN_M + self.slack_m:
                return False
        if hidden.past_border and self.is_building(frame, outlines):
            return False
        if self.support >= 0:
            return True
        return self.reaches(frame) or hidden.foot or not self.hangs(frame)

    def hangs(self, frame: RoomFrame) -> bool:
        """Tell whether there is a wall at which it may hang."""
        return any(map(self.leans_at, frame.walls))

    def is_building(self, frame: RoomFrame, outlines: Outlines) -> bool:
        """Tell whether, its top out of sight, it is the end of a wall, a jamb, a column, or as high.

        These go on into the room at their sides, or are nearly all of one tall surface.
        """
        height = np.sort(frame.height(self.points))
        highest = float(height[-1 - len(height) // 100])
        scan = self.parts[0].scan
        pixels = self.pixels[scan]
        share = np.bincount(self.scans.owners[scan].ravel()[pixels])[1:].max(initial=0) / len(pixels)
        outline = outlines.each[scan]
        at = outline.at(pixels)
        at = at[outline.ends[0, at] > 0]
        level = self.scans.observations[scan].points_at(outline.pixels[at]) @ frame.up
        low, high = np.quantile(self.points @ frame.up, (0.01, 0.99))
        sides = outline.ends[0, at[level > low + (high - low) / 4]]
        goes_on = np.count_nonzero(sides == ROOM) > limits.JOINED * len(sides)
        is_tall = high - low > limits.RISING_M
        is_slender = high - low > limits.SLENDER * self.box(frame).size[:2].max()
        return bool(
            highest > limits.TALLEST_M
            or is_slender
            or (is_tall and goes_on)
            or (highest > limits.SHAFT_M and share > limits.SHAFT_SHARE)
        )

    def hidden(self, frame: RoomFrame, outlines: Outlines) -> OutOfSight:
        """Tell whether its ends go on out of sight."""
        low, high = np.quantile(self.points @ frame.up, (0.01, 0.99))
        band = max(limits.END * float(high - low), self.slack_m)
        foot, top = list[NDArray[np.uint8]](), list[NDArray[np.uint8]]()
        for seen, outline, pixels in zip(self.scans.observations, outlines.each, self.pixels, strict=True):
            at = outline.at(pixels)
            level = seen.points_at(outline.pixels[at]) @ frame.up
            _, above, below = outline.ends[:, at]
            foot.append(below[(level < low + band) & (below > 0)])
            top.append(above[(level > high - band) & (above > 0)])
        out = (BORDER, OCCLUDER, UNKNOWN)
        bottoms, tops = np.concatenate(foot), np.concatenate(top)
        return OutOfSight(_most(np.isin(bottoms, out)), _most(np.isin(tops, out)), _most(tops == BORDER))

    def reaches(self, frame: RoomFrame) -> bool:
        """Tell whether what was measured reaches a floor, or the surface on which it stands."""
        if self.support >= 0:
            return True
        lowest = np.sort(frame.height(self.points))[len(self.points) // 100]
        return bool(lowest < limits.STANDS_M + self.slack_m)

    def lies_along(self, wall: Wall) -> bool:
        """Tell whether hardly anything of it is farther before a wall than what is fixed to it."""
        near = np.abs(wall.plane.distance(self.points)) < max(limits.FLAT_M, self.slack_m)
        return bool(near.mean() > limits.WITHIN)

    def leans_at(self, wall: Wall) -> bool:
        """Tell whether it comes up to a wall."""
        place = wall.places(self.points)
        beside = ((place > wall.low) & (place < wall.high)).all(axis=1)
        near = wall.plane.distance(self.points[beside]) < limits.OFF_ROOM_M + limits.LEAN_M + self.slack_m
        return bool(np.count_nonzero(near) >= limits.CUT_PIXELS)

    def surfaces(self, n_surfaces: int) -> IntArray:
        """Numbers (n,), from 0, of the surfaces most of whose pixels are of it."""
        own, every = np.zeros(n_surfaces + 1), np.zeros(n_surfaces + 1)
        for owners, pixels in zip(self.scans.owners, self.pixels, strict=True):
            own += np.bincount(owners.ravel()[pixels], minlength=n_surfaces + 1)
            every += np.bincount(owners.ravel(), minlength=n_surfaces + 1)
        return np.flatnonzero((own > every / 2)[1:])

    def area_m2(self) -> float:
        """Measured area by solid angles, metres squared, in the scan that shows most of it."""
        scan = int(np.argmax([len(pixels) for pixels in self.pixels]))
        seen = self.scans.observations[scan]
        ranges = seen.scan.ranges.ravel()[self.pixels[scan]]
        return float(((ranges * seen.scan.projection.pixel_angle) ** 2).sum())


def _most(hidden: BoolArray) -> bool:
    """Whether a good part of the ends (n,) that are looked at is hidden."""
    return bool(len(hidden) and hidden.mean() >= limits.HIDDEN)


def join_hanging(candidates: Sequence[Candidate], frame: RoomFrame, outlines: Outlines) -> list[Candidate]:
    """Return candidates of which those that stand on nothing in sight are joined with what they are in.

    Two things take up different parts of a plan, unless one stands on the other. So what lies in the plan of
    another, and whose own foot or top is out of sight or at the other's height, is of the other.
    """
    occluded = outlines.occluded[1:, 1:]
    hidden = [one.hidden(frame, outlines) for one in candidates]
    cut = [one.is_cut(outlines) for one in candidates]
    loose = [k for k, one in enumerate(candidates) if one.support < 0 or cut[k] or hidden[k].foot]
    areas = {k: candidates[k].area(frame) for k in loose}
    rests = [one.support >= 0 or one.reaches(frame) or one.hangs(frame) for one in candidates]
    ranges = {k: np.quantile(candidates[k].points @ frame.up, (0.01, 0.99)) for k in loose}
    joins = list[tuple[int, int]]()
    for k in loose:
        one = candidates[k]
        stands, best, most = one.support < 0 and one.reaches(frame), -1, 0
        for m in loose:
            other = candidates[m]
            if m == k or not areas[k].intersects(areas[m]) or (best >= 0 and other.n_pixels < most):
                continue
            if shapely.contains_xy(areas[m], *(one.points @ frame.axes.T).T).mean() < limits.INSIDE:
                continue
            slack = one.slack_m + other.slack_m
            above = ranges[k][0] < ranges[m][1] + slack and ranges[k][1] > ranges[m][1]
            within = ranges[k][1] < ranges[m][1] + slack
            is_behind = occluded[k, m] >= limits.CUT_PIXELS
            if one.support >= 0 and not (is_behind or cut[k]):
                continue
            is_leg = is_behind and within and (hidden[k].top or not rests[m])
            if is_leg if stands else (above or within or (is_behind and hidden[k].foot)):
                best, most = m, other.n_pixels
        joins += [(k, best)] if best >= 0 else []
    pairs = np.array(joins, dtype=np.int64).reshape(-1, 2)
    n = len(candidates)
    graph = coo_array((np.ones(len(pairs), np.int8), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    _, number = connected_components(graph, directed=False)
    groups: dict[int, list[Part]] = {}
    for one, group in zip(candidates, number.tolist(), strict=True):
        groups.setdefault(group, []).extend(one.parts)
    return [
        Candidate.of(sorted(parts, key=lambda part: -len(part.pixels)), candidates[0].scans)
        for parts in groups.values()
    ]


def relate(
    candidates: Sequence[Candidate],
    frame: RoomFrame,
    outlines: Outlines,
    patches: Sequence[Patch],
    world_from_reference: Pose,
) -> Iterator[Thing]:
    """Yield the things that candidates are, with what they are to each other, world coordinates."""
    surfaces = [one.surfaces(len(patches)) for one in candidates]
    owner = {int(number): k for k, held in enumerate(surfaces) for number in held}
    occluded, touching = outlines.occluded, outlines.touching
    behind = (occluded >= limits.CUT_PIXELS)[1:, 1:]
    beside = ((touching + touching.T) >= limits.CUT_PIXELS)[1:, 1:]
    index_of = [patch.limits.index for patch in patches]
    for k, one in enumerate(candidates):
        number = one.support if one.support >= 0 else _floor_of(one, frame)
        box = one.box(frame)
        carrier = owner.get(number)
        foot = one.points[np.argmin(one.points @ frame.up)]
        yield Thing(
            index=k,
            pixels=one.pixels,
            box=_in_world(box, world_from_reference),
            stands_on=None if number < 0 else number,
            stands_on_thing=None if carrier == k else carrier,
            support_m=None if number < 0 else _height(patches[number], foot, frame, world_from_reference),
            leans_at=tuple(
                index_of.index(wall.number)
                for wall in frame.walls
                if wall.number in index_of and one.leans_at(wall)
            ),
            touches=tuple(np.flatnonzero(beside[k]).tolist()),
            occluded_by=tuple(np.flatnonzero(behind[k]).tolist()),
            hides=tuple(np.flatnonzero(behind[:, k]).tolist()),
            cuts=tuple(
                Cut(scan, *outline.cut(one.pixels[scan]))
                for scan, outline in enumerate(outlines.each)
                if len(one.pixels[scan])
            ),
            surfaces=tuple(surfaces[k].tolist()),
            measured_m2=one.area_m2(),
        )


def _floor_of(one: Candidate, frame: RoomFrame) -> int:
    """Number of the floor on which a candidate stands, from 0: the nearest to its foot; -1 for none."""
    if not frame.floors or not one.reaches(frame):
        return -1
    foot = one.points[[np.argmin(one.points @ frame.up)]]
    return min(frame.floors, key=lambda k: abs(float(frame.floors[k].distance(foot)[0])))


def _height(patch: Patch, foot: FloatArray, frame: RoomFrame, world_from_reference: Pose) -> float:
    """Height along up, world coordinates, of a support below a foot (3,), metres."""
    off = float(patch.source.fit.surface.distance(foot[None])[0])
    place = world_from_reference.apply((foot - off * frame.up)[None])[0]
    return float(place @ world_from_reference.rotate(frame.up[None])[0])


def _in_world(box: UprightBox, world_from_reference: Pose) -> UprightBox:
    """A box of the working frame in world coordinates."""
    axes = world_from_reference.rotate(box.axes)
    shift = axes @ world_from_reference.translation
    return UprightBox(axes, box.low + shift, box.high + shift)
