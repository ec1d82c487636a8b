# SPDX-License-Identifier: MIT
"""Panel model: few facets, each of one surface and one state, and the folds and corners that they share.

Fold edges and corners say where they are, how well that is known, and what is measured of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from completion.export.panels import limits
from completion.export.panels.fold import Fold
from completion.export.panels.sheet import Sheet
from completion.extension.patch import Provenance
from scenes.checks import BoolArray, FloatArray, Value
from scenes.surfaces.catalogue import Surface
from scenes.surfaces.surface import cross

_STEPS = 32  # in which a crossing is looked for
_HALVINGS = 50


@dataclass(frozen=True, slots=True, eq=False)
class FoldCorner:
    """A point in which three surfaces meet, and folds end or cross."""

    surfaces: tuple[int, int, int]  # numbers, from 1, ascending
    point: FloatArray  # (3,) metres, working frame


def close_corners(folds: Sequence[Fold], sheets: Sequence[Sheet]) -> tuple[list[Fold], list[FoldCorner]]:
    """Move the ends of folds to where a third surface crosses them, within four cells; say which corners.

    An end at which another piece of the same fold goes on stays. A fold is not moved out of being.
    """
    moved, corners = [], list[FoldCorner]()
    fixed = {
        (fold.first, fold.second, end) for fold in folds for end in (fold.start, fold.end)
        if sum(end in (other.start, other.end) for other in folds if _same_pair(fold, other)) > 1
    }  # fmt: skip
    for fold in folds:
        ends = []
        for end in (fold.start, fold.end):
            is_fixed = (fold.first, fold.second, end) in fixed
            pair = None if is_fixed else _nearest_crossing(fold, end, sheets)
            ends.append(end if pair is None else pair[0])
            if pair is not None:
                first, second, third = sorted((fold.first, fold.second, pair[1]))
                point = fold.curve.at(np.array([pair[0]]))[0]
                corners.append(FoldCorner((first, second, third), point))
        start, end = ends
        moved.append(replace(fold, start=start, end=end) if start < end else fold)
    return moved, _distinct(corners)


def _same_pair(first: Fold, second: Fold) -> bool:
    return (first.first, first.second) == (second.first, second.second)


def _nearest_crossing(fold: Fold, end: float, sheets: Sequence[Sheet]) -> tuple[float, int] | None:
    """The parameter nearest to an end of a fold at which a third surface crosses it, and that surface."""
    reach = limits.EDGE_REACH_CELLS * fold.cell_m
    t = np.linspace(end - reach, end + reach, _STEPS + 1)
    points = fold.curve.at(t)
    best: tuple[float, int] | None = None
    for sheet in sheets:
        if sheet.number in (fold.first, fold.second):
            continue
        height = sheet.surface.distance(points)
        for k in np.flatnonzero(np.signbit(height[:-1]) != np.signbit(height[1:])):
            root = _root(fold, sheet.surface, float(t[k]), float(t[k + 1]))
            place = fold.curve.at(np.array([root]))
            if best is not None and abs(root - end) >= abs(best[0] - end):
                continue
            if _volume(fold, sheets, sheet.surface, place) < limits.LEAST_SINE:
                continue
            if sheet.is_within(sheet.surface.to_uv(place), limits.FOLD_CELLS * sheet.cell_m)[0]:
                best = (root, sheet.number)
    return best


def _volume(fold: Fold, sheets: Sequence[Sheet], third: Surface, place: FloatArray) -> float:
    """Volume that the unit normals of three surfaces span at a place (1, 3)."""
    surfaces = [sheets[number - 1].surface for number in (fold.first, fold.second)]
    normals = np.stack([surface.normal(place)[0] for surface in (*surfaces, third)])
    return float(abs(np.linalg.det(normals)))


def _root(fold: Fold, surface: Surface, low: float, high: float) -> float:
    """The parameter between two at which a fold goes through a surface, by bisection."""
    below = surface.distance(fold.curve.at(np.array([low])))[0]
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        if np.signbit(surface.distance(fold.curve.at(np.array([middle])))[0]) == np.signbit(below):
            low = middle
        else:
            high = middle
    return (low + high) / 2


def _distinct(corners: Sequence[FoldCorner]) -> list[FoldCorner]:
    """Each corner once, by its surfaces and place."""
    kept: list[FoldCorner] = []
    for new_corner in sorted(corners, key=lambda corner: corner.surfaces):
        same = (other for other in kept if other.surfaces == new_corner.surfaces)
        if not any(
            float(np.linalg.norm(new_corner.point - other.point)) < limits.PRECISION_M for other in same
        ):
            kept.append(new_corner)
    return kept


_PAIR = 2  # surfaces of a fold


@dataclass(frozen=True, slots=True, eq=False)
class FoldEdge(Value):
    """An edge that two surfaces share.

    Attributes
    ----------
    surfaces : (int, int)
        Their numbers, from 1; 0 for a face that is too slim to be a surface.
    goes_on : tuple of int
        Those that go on beyond it, as a floor does under a partition.
    points : (n, 3) float
        Polyline, metres, working frame; the curve itself is off it by 2 mm at most.
    covariance : (2, 3, 3) float
        Of its first and its last point across the fold, square metres; nothing is said along it.
    dihedral_deg : float
        Angle of the free space between the surfaces: below 180 in the corner of a room, above on a box.
    length_m : float
        Its length.
    measured_share : float
        Share of the length along which both surfaces were measured up to it.
    normals : (2, 3) float
        Unit normals of both at its middle.
    dihedral_sd_deg : float, optional
        Standard deviation of the angle, where it was measured beside the edge.
    """

    surfaces: tuple[int, int]
    goes_on: tuple[int, ...]
    points: FloatArray
    covariance: FloatArray
    dihedral_deg: float
    length_m: float
    measured_share: float
    normals: FloatArray
    dihedral_sd_deg: float | None = None

    @property
    def kind(self) -> str:
        """`ends` where both surfaces end at it, `through` where one goes on, or both."""
        return "through" if self.goes_on else "ends"

    @property
    def sd_m(self) -> float:
        """The larger standard deviation of its ends across it, where that is known worst, metres."""
        return float(np.sqrt(np.linalg.eigvalsh(self.covariance)[:, -1].max()))


@dataclass(frozen=True, slots=True, eq=False)
class CornerPoint(Value):
    """A point in which three surfaces meet: their numbers, the place (3,), its covariance (3, 3)."""

    surfaces: tuple[int, int, int]
    point: FloatArray
    covariance: FloatArray


def fold_edge(fold: Fold, sheets: Sequence[Sheet]) -> FoldEdge:
    """Return what is told of a fold."""
    t = fold.stations()
    points = fold.curve.at(t)
    members = [sheets[number - 1] for number in (fold.first, fold.second)]
    ends = points[[0, -1]]
    fine = np.linspace(fold.start, fold.end, max(2, int((fold.end - fold.start) / fold.cell_m) + 1))
    measured = np.ones(len(fine), np.bool_)
    for sheet, sides in zip(members, fold.sides, strict=True):
        uv, left = sheet.along(fold.curve.at(fine))
        mask = np.zeros(len(fine), np.bool_)
        for sign in np.array([1.0, -1.0])[sides]:
            beside = uv + sign * limits.BESIDE_CELLS * sheet.cell_m * left
            mask |= sheet.provenance_at(beside) == Provenance.MEASURED
        measured &= mask
    return FoldEdge(
        surfaces=(fold.first, fold.second),
        goes_on=fold.goes_on,
        points=points,
        covariance=np.stack([meeting_covariance(members, place) for place in ends]),
        dihedral_deg=_dihedral(fold, members),
        length_m=float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum()),
        measured_share=float(measured.mean()),
        normals=np.stack([sheet.surface.normal(points[[len(points) // 2]])[0] for sheet in members]),
    )


def corner_point(corner: FoldCorner, sheets: Sequence[Sheet]) -> CornerPoint:
    """Return what is told of a corner."""
    sheet = [sheets[number - 1] for number in corner.surfaces]
    return CornerPoint(corner.surfaces, corner.point, meeting_covariance(sheet, corner.point))


def meeting_covariance(sheets: Sequence[Sheet], place: FloatArray) -> FloatArray:
    """Covariance (3, 3) of a place (3,) in which two or three surfaces meet, square metres.

    With the unit normals n_k and the surfaces' variances s_k^2 there, taken as independent: the sum of
    s_k^2 g_k g_k', where g_k moves the place off the k-th surface by one and along the others. Along two
    surfaces' fold it is nothing. Products are taken element by element: linear algebra libraries round small
    matrices as they lie in memory.
    """
    normals = [sheet.surface.normal(place[None])[0] for sheet in sheets]
    total = np.zeros((3, 3))
    for sheet, move in zip(sheets, _moves(normals), strict=True):
        variance = float(sheet.patch.stated.standard_deviation(place[None])[0]) ** 2
        total = total + variance * (move[:, None] * move)
    return total


def rotate_covariances(covariance: FloatArray, rotation: FloatArray) -> FloatArray:
    """Return covariances (..., 3, 3) in the axes that a rotation (3, 3) leads to."""
    turn, given = np.ascontiguousarray(rotation), np.ascontiguousarray(covariance)
    half = (turn[:, None, :] * given[..., None, :, :]).sum(axis=-1)
    return np.asarray((half[..., :, None, :] * turn).sum(axis=-1), dtype=np.float64)


def _moves(normals: Sequence[FloatArray]) -> list[FloatArray]:
    """The vectors (3,) that leave one of two or three planes by one, and lie in the others and across."""
    if len(normals) == _PAIR:
        first, second = normals
        cosine = float((first * second).sum())
        return [(a - cosine * b) / (1 - cosine**2) for a, b in ((first, second), (second, first))]
    across = [cross(normals[k - 2], normals[k - 1]) for k in range(3)]
    return [vector / float((vector * normal).sum()) for vector, normal in zip(across, normals, strict=True)]


def _dihedral(fold: Fold, sheets: Sequence[Sheet]) -> float:
    """Angle of the free space at the middle of a fold, degrees."""
    middle = fold.curve.at(np.array([(fold.start + fold.end) / 2]))
    first, second = (sheet.surface.normal(middle)[0] for sheet in sheets)
    turn = float(np.degrees(np.arccos(np.clip(first @ second, -1.0, 1.0))))
    sheet, sides = (sheets[1], fold.sides[1]) if not fold.sides[1].all() else (sheets[0], fold.sides[0])
    facing = first if sheet is sheets[1] else second
    t = np.array([(fold.start + fold.end) / 2, (fold.start + fold.end) / 2 + 1e-4])
    uv, left = sheet.along(fold.curve.at(t))
    inside = sheet.surface.from_uv(uv[:1] + (1e-3 if sides[0] else -1e-3) * left[:1])
    return 180.0 - turn if float((inside - middle)[0] @ facing) > 0 else 180.0 + turn


@dataclass(frozen=True, slots=True, eq=False)
class PanelPart(Value):
    """Facets of one surface by themselves: each vertex has one place in the chart."""

    vertices: FloatArray  # (n, 3) metres, working frame
    faces: NDArray[np.int64]  # (m, 3)
    uv: FloatArray  # (n, 2) chart coordinates, metres


@dataclass(frozen=True, slots=True, eq=False)
class RemainderFacets(Value):
    """What no surface explains, as few triangles, and the pixels that tell of its vertices.

    Attributes
    ----------
    faces : (m, 3) int
        Of the vertices of the light model, some of which panels have too.
    vertex : (n,) int
        The vertices that these triangles use, ascending.
    source : (n,) int
        For each of them the nearest vertex of the pixels' mesh.
    """

    faces: NDArray[np.int64] = field(default_factory=lambda: np.zeros((0, 3), np.int64))
    vertex: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    source: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))


@dataclass(frozen=True, slots=True, eq=False)
class PanelModel(Value):
    """Completed surfaces as few facets; neighbours share the vertices of the fold in which they meet.

    Attributes
    ----------
    vertices : (n, 3) float
        Metres, working frame.
    faces : (m, 3) int
        Anticlockwise seen from the side that was measured.
    face_surface : (m,) int32
        Number of each facet's surface, from 1.
    face_provenance : (m,) int8
        The `Provenance` of each facet.
    corner_uv : (m, 3, 2) float
        Chart coordinates of the facets' corners, metres.
    folds : tuple of FoldEdge
        The edges that two surfaces share.
    corners : tuple of CornerPoint
        Where three meet.
    open_m : dict of str to float
        Length of the edges of a single facet by what lies beyond them (`BoundarySegment.kind`), metres.
    remainder : RestFacets
        What no surface explains.
    """

    vertices: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    faces: NDArray[np.int64] = field(default_factory=lambda: np.zeros((0, 3), np.int64))
    face_surface: NDArray[np.int32] = field(default_factory=lambda: np.zeros(0, np.int32))
    face_provenance: NDArray[np.int8] = field(default_factory=lambda: np.zeros(0, np.int8))
    corner_uv: FloatArray = field(default_factory=lambda: np.zeros((0, 3, 2)))
    folds: tuple[FoldEdge, ...] = ()
    corners: tuple[CornerPoint, ...] = ()
    open_m: Mapping[str, float] = field(default_factory=dict)
    remainder: RemainderFacets = field(default_factory=RemainderFacets)

    @property
    def is_measured(self) -> BoolArray:
        """Which facets (m,) were measured; the others were inferred."""
        return np.asarray(self.face_provenance == Provenance.MEASURED, dtype=np.bool_)

    def part(self, kept: BoolArray) -> PanelPart:
        """Return some facets (m,) of one surface by themselves."""
        corner, uv = self.faces[kept].ravel(), self.corner_uv[kept].reshape(-1, 2)
        fine = np.rint(uv / limits.COLLINEAR_M).astype(np.int64)
        _, first, index = np.unique(
            np.column_stack([corner, fine]), axis=0, return_index=True, return_inverse=True
        )
        return PanelPart(self.vertices[corner[first]], index.reshape(-1, 3).astype(np.int64), uv[first])
