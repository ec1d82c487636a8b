# SPDX-License-Identifier: MIT
"""Bodies: walls and slabs that were seen from both sides, with their thickness; others have none.

Two planes back to back are a body where both were seen, and where the scans do not speak against it: no beam
went through between them and no other surface lies there. What only one side is known of has no thickness.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, Literal

import numpy as np
import shapely
from numpy.typing import NDArray

from completion.evidence.chart_grid import ChartGrid
from completion.evidence.free_space import free_cells
from completion.evidence.reach import Reach
from completion.evidence.sight import ScanSight, sight_of
from completion.export.building import limits
from completion.export.building.faces import (
    FaceFrame,
    PlaneFace,
    common,
    fill_holes,
    grow,
    inside,
    less,
    project_area,
    union,
    wide,
)
from completion.observe.observation import Observation
from completion.observe.tolerance import Tolerance
from scenes.checks import FloatArray, Value
from scenes.pose import Pose
from scenes.surfaces.catalogue import Plane

_CELL_M, _MOST_CELLS = 0.03, 200_000  # side of a cell; how many there are at most


@dataclass(frozen=True, slots=True, eq=False)
class ScanBeams:
    """The beams of scans.

    Attributes
    ----------
    sights, reaches : sequences
        Of each scan, working frame.
    world : Pose
        From the working frame to the world.
    """

    sights: Sequence[ScanSight]
    reaches: Sequence[Reach]
    world: Pose

    @classmethod
    def of(
        cls, observations: Sequence[Observation], reach: Sequence[Reach], world: Pose, tolerance: Tolerance
    ) -> ScanBeams:
        """Return the beams of scans that brought something back; `reach` is that of each scan."""
        pairs = [pair for pair in zip(observations, reach, strict=True) if pair[0].scan.valid.any()]
        return cls([sight_of(seen, tolerance) for seen, _ in pairs], [far for _, far in pairs], world)

    def free(self, area: Any, frame: FaceFrame, depth_m: float) -> Any:
        """Return where beams went through an area of a frame, at a depth behind its plane, metres.

        By the same rule as the veto of a surface (`free_cells`), in cells of 3 cm that are joined over gaps
        of two; of it what is at least 10 cm wide.
        """
        if not self.sights or area.is_empty:
            return shapely.Polygon()
        inverse = self.world.inverse()
        local = inverse.apply(frame.place(shapely.get_coordinates(area), -depth_m))
        plane = Plane(local[0], inverse.rotate(frame.normal[None])[0])
        uv = plane.to_uv(local)
        low, high = uv.min(axis=0), uv.max(axis=0)
        cell = max(_CELL_M, float(np.sqrt(np.prod(high - low) / _MOST_CELLS)))
        grid = ChartGrid.over(plane, low, high, cell, full_turn=False)
        is_free = free_cells(grid, np.zeros(grid.shape[0] * grid.shape[1]), self.sights, self.reaches)
        free_area = union(self._cells(grid, np.flatnonzero(is_free), frame))
        free_area = grow(grow(free_area, cell), -cell)
        return wide(common(area, free_area), max(limits.LEAST_WIDE_M, 3 * cell))

    def _cells(self, grid: ChartGrid, chosen: NDArray[np.int64], frame: FaceFrame) -> list[Any]:
        """Squares of some cells in the coordinates of a frame."""
        row, column = np.divmod(chosen, grid.shape[1])
        around = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=np.float64)
        uv = grid.uv_of(row[:, None] + around[:, 1], column[:, None] + around[:, 0])
        places = self.world.apply(grid.surface.from_uv(uv.reshape(-1, 2)))
        return list(shapely.polygons(frame.flat(places).reshape(-1, 4, 2)))


_LEVELS = (0.25, 0.5, 0.75)  # of the thickness, at which beams are looked for


@dataclass(frozen=True, slots=True, eq=False)
class Body(Value):
    """A wall or a slab that was seen from both sides.

    Attributes
    ----------
    kind : "wall" or "slab"
        A slab is level.
    surfaces : (int, int)
        Numbers of its two faces; of a slab the upper one is the first.
    frame : Frame
        On the first face; the body lies behind it.
    measured, inferred : shapely geometry
        Where both faces were measured, and where one was and the other is inferred; coordinates of the frame,
        metres. What is surrounded by these counts as inferred.
    thickness_m, thickness_sd_m : float
        At `place`, along the frame's normal; the deviation is the sum of both faces', which share errors.
    place : (3,) float
        On the first face, world coordinates: where both were measured, as far inside as possible.
    confidence : float
        The smaller of both faces' there.
    angle_deg : float
        Between the faces.
    """

    kind: Literal["wall", "slab"]
    surfaces: tuple[int, int]
    frame: FaceFrame
    measured: Any
    inferred: Any
    thickness_m: float
    thickness_sd_m: float
    place: FloatArray
    confidence: float
    angle_deg: float

    @property
    def area(self) -> Any:
        """Where both faces are."""
        return union((self.measured, self.inferred))

    @property
    def measured_share(self) -> float:
        """Share of its area that was measured on both faces."""
        return float(self.measured.area / self.area.area)


def find_bodies(faces: Sequence[PlaneFace], beams: ScanBeams) -> tuple[Body, ...]:
    """Return the walls and slabs that were seen from both sides, thinnest first where they compete.

    A place of a face belongs to one body alone: to that with the nearest other face.
    """
    taken: dict[int, list[Any]] = {face.number: [] for face in faces}
    bodies = []
    pairs = [pair for first, second in combinations(faces, 2) for pair in _back_to_back(first, second)]
    for _, first, second in sorted(pairs, key=lambda pair: (pair[0], pair[1].number, pair[2].number)):
        body = _body(first, second, faces, taken, beams)
        if body is not None:
            bodies.append(body)
            taken[first.number].append(body.area)
            taken[second.number].append(project_area(body.area, first.frame, second.frame))
    return tuple(sorted(bodies, key=lambda body: body.surfaces))


def _back_to_back(first: PlaneFace, second: PlaneFace) -> Iterator[tuple[float, PlaneFace, PlaneFace]]:
    """Two faces whose planes may be those of a body, with the depth of the second behind the first."""
    if not ((first.is_upright and second.is_upright) or (first.is_level and second.is_level)):
        return
    if first.is_level and first.frame.normal[2] < 0:
        first, second = second, first
    if first.frame.normal @ second.frame.normal > -np.cos(np.radians(limits.ALONG_DEG)):
        return
    middle = second.frame.place(shapely.get_coordinates(second.area).mean(axis=0)[None])
    depth = -float(first.frame.height(middle)[0])
    if limits.THIN_M / 2 < depth < 2 * limits.MOST_THICKNESS_M:
        yield depth, first, second


def _body(
    first: PlaneFace,
    second: PlaneFace,
    faces: Sequence[PlaneFace],
    taken: dict[int, list[Any]],
    beams: ScanBeams,
) -> Body | None:
    """The body of two faces, unless something speaks against it."""
    frame = first.frame
    sides = second.laid_on(frame)
    both = _known_area(first, sides)
    both = less(both, (*taken[first.number], *_laid(taken, second, frame)))
    both = wide(both, limits.LEAST_WIDE_M)
    if both.area < limits.LEAST_OVERLAP_M2 or not _is_seen(first, second, both, frame):
        return None
    depth = _depth(both, first, second)
    if not limits.THIN_M <= depth <= limits.MOST_THICKNESS_M or not _is_parallel(first, second, both):
        return None
    both = less(both, _others_between(both, (first, second), faces, depth))
    for level in _LEVELS:
        both = less(both, [beams.free(both, frame, level * depth)])
    both = wide(both, max(limits.LEAST_WIDE_M, depth))  # else it is the end of a wall, beside a door
    measured = common(both, common(first.measured, sides[0]))
    if (
        both.area < limits.LEAST_OVERLAP_M2
        or measured.area < limits.LEAST_OVERLAP_M2
        or not _is_large(first, second, both)
    ):
        return None
    uv = inside(measured)
    place = frame.place(uv)
    return Body(
        kind="wall" if first.is_upright else "slab",
        surfaces=(first.number, second.number),
        frame=frame,
        measured=measured,
        inferred=less(both, [measured]),
        thickness_m=_depth_at(place, first, second),
        thickness_sd_m=first.element.sd_m(place) + second.element.sd_m(_opposite(place, first, second)),
        place=place,
        confidence=min(
            first.element.confidence(place), second.element.confidence(_opposite(place, first, second))
        ),
        angle_deg=_angle_deg(first, second),
    )


def _known_area(face: PlaneFace, sides: tuple[Any, Any]) -> Any:
    """Where both faces are and one was measured, and what that goes all around."""
    both = common(face.area, union(sides))
    return common(both, fill_holes(common(both, union((face.measured, sides[0])))))


def _laid(taken: dict[int, list[Any]], other: PlaneFace, frame: FaceFrame) -> list[Any]:
    return [project_area(area, other.frame, frame) for area in taken[other.number]]


def _is_seen(first: PlaneFace, second: PlaneFace, both: Any, frame: FaceFrame) -> bool:
    """Whether both faces were measured somewhere in the area that they share."""
    sides = first.measured, second.laid_on(frame)[0]
    return all(common(side, both).area >= limits.LEAST_OVERLAP_M2 for side in sides)


def _is_large(first: PlaneFace, second: PlaneFace, both: Any) -> bool:
    """Whether it is no board: the faces of furniture enclose nothing, and are neither high nor large."""
    if {"wall", "floor", "ceiling"} & {first.element.kind, second.element.kind}:
        return True
    return bool(
        both.bounds[3] - both.bounds[1] >= limits.STANDING_M
        if first.is_upright
        else both.area >= limits.SLAB_M2
    )


def _others_between(
    both: Any, pair: Sequence[PlaneFace], faces: Sequence[PlaneFace], depth: float
) -> list[Any]:
    """Where another plane along the faces lies between them."""
    frame, bodies_between = pair[0].frame, []
    for face in faces:
        if face in pair or abs(face.frame.normal @ frame.normal) < np.cos(np.radians(limits.ALONG_DEG)):
            continue
        area = common(project_area(face.area, face.frame, frame), both)
        if area.area < limits.LEAST_OVERLAP_M2:
            continue
        if limits.SLACK_M < _depth_at(frame.place(inside(area)), pair[0], face) < depth - limits.SLACK_M:
            bodies_between.append(area)
    return bodies_between


def _opposite(place: FloatArray, first: PlaneFace, second: PlaneFace) -> FloatArray:
    """The place (3,) of the other face straight behind a place of the first."""
    return np.asarray(place - _depth_at(place, first, second) * first.frame.normal)


def _depth_at(place: FloatArray, first: PlaneFace, second: PlaneFace) -> float:
    """How far the other face lies behind a place (3,) of the first, along the first's normal."""
    slope = float(second.frame.normal @ first.frame.normal)
    return float(second.frame.height(place[None])[0]) / slope


def _depth(both: Any, first: PlaneFace, second: PlaneFace) -> float:
    return _depth_at(first.frame.place(inside(both)), first, second)


def _angle_deg(first: PlaneFace, second: PlaneFace) -> float:
    across = float(np.linalg.norm(np.cross(first.frame.normal, second.frame.normal)))
    return float(np.degrees(np.arcsin(min(across, 1.0))))


def _is_parallel(first: PlaneFace, second: PlaneFace, both: Any) -> bool:
    """Whether the planes are parallel to 1 degree, or within three deviations of the angle between them."""
    low, high = np.reshape(both.bounds, (2, 2))
    far = first.frame.place(np.array([low, high]))
    apart = max(float(np.linalg.norm(far[1] - far[0])), limits.THIN_M)
    spread = 0.0
    for face in (first, second):
        slope = face.element.gradient(far[1]) - face.element.gradient(far[0])
        variance = float(slope @ face.element.patch.stated.covariance @ slope)
        spread += float(np.sqrt(max(variance, 0.0))) / apart
    return _angle_deg(first, second) <= max(limits.PARALLEL_DEG, limits.N_SIGMA * float(np.degrees(spread)))
