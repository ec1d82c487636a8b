# SPDX-License-Identifier: MIT
"""Panels on one page: from completed surfaces to facets that meet in their fold edges.

Slim faces are what was measured beside a surface's straight edge, too slim to be a surface by itself. The
sides of a board, a leg or a frame are a few pixels wide. Their plane has one free angle, for it goes through
an edge that is known from the surface beside it (features in poor data, Fisher 2004, section 3).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from completion.boundary.edges import BoundaryEdge, ChartLine
from completion.export.panels import limits
from completion.export.panels.arrangement import arrange
from completion.export.panels.fold import find_folds, fold_curves
from completion.export.panels.model import FoldEdge, PanelModel, close_corners, corner_point, fold_edge
from completion.export.panels.outline import NearOutline, OutlineCells
from completion.export.panels.sheet import Sheet
from completion.export.panels.welding import edges_of, weld
from scenes.checks import FloatArray, IntArray
from scenes.surfaces.catalogue import Plane
from scenes.surfaces.surface import cross

NO_SURFACE = 0
_VOTES = 36  # directions around an edge
_STEP_M = 0.005  # between places of folds that are known


@dataclass(frozen=True, slots=True, eq=False)
class _EdgeSection:
    """Points near a run of an edge: how far along it, out of its surface and along the normal, metres."""

    origin: FloatArray  # (3,) on the edge
    axes: FloatArray  # (3, 3) along the edge, outward in the surface, its normal
    local: FloatArray  # (n, 3) along, outward, above

    @classmethod
    def of(cls, surface: Plane, line: ChartLine, sign: float, points: FloatArray) -> _EdgeSection:
        """Return that of points (n, 3) at a line of a chart, on whose side `sign` the surface lies."""
        places = np.stack([line.point, line.point + line.direction, line.point - sign * line.normal])
        origin, further, beyond = surface.from_uv(places)
        axes = np.stack([further - origin, beyond - origin, surface.normal_direction])
        return cls(origin, axes, (points - origin) @ axes.T)

    def at(self, along: FloatArray, outward: float) -> FloatArray:
        """Points (n, 3) so far along (n,) and out."""
        return np.asarray(self.origin + along[:, None] * self.axes[0] + outward * self.axes[1])


@dataclass(frozen=True, slots=True, eq=False)
class SlimFace:
    """A slim face beside a surface's edge.

    Attributes
    ----------
    sheet : Sheet
        The surface.
    ends : (2, 3) float
        Of the fold between them, metres.
    plane : Plane
        The face; its normal looks away from what is solid.
    degrees, sd_deg : float
        Its direction at the fold, from out of the surface to the surface's normal, and how well it is known.
    points : (n, 3) float
        Those measured on it.
    """

    sheet: Sheet
    ends: FloatArray
    plane: Plane
    degrees: float
    sd_deg: float
    points: FloatArray


def slim_folds(sheets: Sequence[Sheet], unexplained: FloatArray, known: Sequence[FoldEdge]) -> list[FoldEdge]:
    """Return the folds at which planes meet faces that are no surface, whose number is then 0.

    `unexplained` (n, 3) are the points that no surface explains, working frame, metres; folds that are
    `known` are not found again. A face holds where seven tenths of the points beside the edge lie on one
    plane through it, at least 20 degrees from the surface's own, and its angle is known to 5 degrees.
    """
    if not len(unexplained):
        return []
    tree = cKDTree(unexplained)
    places = [_along(fold.points, _STEP_M) for fold in known]
    taken = cKDTree(np.concatenate(places)) if places else None
    folds = []
    for face in (face for sheet in sheets for face in _faces(sheet, unexplained, tree)):
        edges = [_at_its_edge(face), *_at_its_far_side(face, sheets)]
        for fold in edges:
            middles = _along(fold.points, face.sheet.cell_m)
            if (
                taken is None
                or (taken.query(middles)[0] < limits.FOLD_REACH_CELLS * face.sheet.cell_m).mean() <= 0.5
            ):
                folds.append(fold)
    return folds


def _faces(sheet: Sheet, unexplained: FloatArray, tree: cKDTree) -> Iterator[SlimFace]:
    """The slim faces beside the straight edges of a plane."""
    surface, cell = sheet.surface, sheet.cell_m
    if not isinstance(surface, Plane):
        return
    for edge in sheet.patch.edges:
        line = edge.curve
        if not isinstance(line, ChartLine):
            continue
        for (low, high), sign in zip(edge.runs.tolist(), edge.sides.tolist(), strict=True):
            if high - low < limits.SLIM_LENGTH_CELLS * cell:
                continue
            places = surface.from_uv(line.at(np.arange(low, high + cell, cell)))
            near = tree.query_ball_point(places, (limits.SLIM_REACH_CELLS + 1) * cell)
            index = sorted({k for group in near for k in group})
            if len(index) >= limits.SLIM_POINTS:
                section = _EdgeSection.of(surface, line, sign, unexplained[index])
                yield from _along_run(sheet, edge, section, (low, high))


def _along_run(
    sheet: Sheet, edge: BoundaryEdge, section: _EdgeSection, run: tuple[float, float]
) -> Iterator[SlimFace]:
    """The slim faces along one run of an edge: where there are points beside it, and they lie on a plane."""
    cell, (along, outward, above) = sheet.cell_m, section.local.T
    reach = np.hypot(outward, above)
    held = np.flatnonzero((along >= run[0]) & (along <= run[1]) & (reach <= limits.SLIM_REACH_CELLS * cell))
    for stretch in _stretches(held, along, limits.SLIM_BRIDGED_CELLS * cell):
        low, high = float(along[stretch].min()), float(along[stretch].max())
        line = _line_through(
            section.local[stretch, 1:], cell, max(edge.deviation, sheet.patch.source.fit.rms)
        )
        if (
            high - low < limits.SLIM_LENGTH_CELLS * cell
            or line is None
            or np.quantile(reach[stretch], 0.1) > limits.EDGE_REACH_CELLS * cell
        ):
            continue
        radians = np.radians(line.degrees)
        across = np.sin(radians) * section.axes[1] - np.cos(radians) * section.axes[2]
        ends = section.at(np.array([low, high]), line.shift_m)
        solid = section.at(np.array([low]), line.shift_m - cell)[0] - ends[0]
        normal = -across if float(across @ solid) > 0 else across
        points = section.origin + section.local[stretch[line.kept]] @ section.axes
        yield SlimFace(
            sheet=sheet,
            ends=ends,
            plane=Plane(ends[0], normal),
            degrees=line.degrees,
            sd_deg=line.sd_deg,
            points=points,
        )


def _stretches(held: IntArray, along: FloatArray, gap_m: float) -> list[IntArray]:
    """Some points (n,) by the stretches of an edge along which they lie without a gap of so many metres."""
    ordered = held[np.argsort(along[held], kind="stable")]
    return np.split(ordered, np.flatnonzero(np.diff(along[ordered]) > gap_m) + 1) if len(held) else []


@dataclass(frozen=True, slots=True, eq=False)
class _SectionLine:
    """A line in a section across an edge."""

    shift_m: float  # where it cuts the surface, outward
    degrees: float  # its direction, from outward to the normal
    sd_deg: float
    kept: FloatArray  # (n,) which points lie on it


def _line_through(points: FloatArray, cell: float, deviation: float) -> _SectionLine | None:
    """The line of points (n, 2) of a section, outward and above; None where there is none."""
    far = np.hypot(*points.T) > cell
    if np.count_nonzero(far) < limits.SLIM_POINTS:
        return None
    turn = (np.arctan2(points[far, 1], points[far, 0]) + np.pi) / (2 * np.pi) * _VOTES
    votes = np.bincount(turn.astype(np.int64) % _VOTES, minlength=_VOTES)
    towards = (
        int((votes + np.roll(votes, 1) + np.roll(votes, -1)).argmax()) + 0.5
    ) / _VOTES * 2 * np.pi - np.pi
    direction, middle = np.array([np.cos(towards), np.sin(towards)]), np.zeros(2)
    slack, kept = limits.SLIM_FLAT_CELLS * cell + 3 * deviation, far
    for _ in range(4):
        off = (points - middle) @ np.array([-direction[1], direction[0]])
        kept = (np.abs(off) <= slack) & (points @ direction > -cell)
        if np.count_nonzero(kept) < limits.SLIM_POINTS:
            return None
        middle = points[kept].mean(axis=0)
        along = np.linalg.svd(points[kept] - middle, full_matrices=False)[2][0]
        direction = along if along @ direction >= 0 else -along
    reached = points[kept] @ direction
    steep = abs(float(direction[1]))
    if (
        kept.mean() < limits.SLIM_SHARE
        or np.ptp(reached) < limits.SLIM_WIDTH_CELLS * cell
        or steep < np.sin(np.radians(limits.SLIM_LEAST_DEG))
    ):
        return None
    off = (points[kept] - middle) @ np.array([-direction[1], direction[0]])
    spread = np.sqrt(np.square(off).mean() + np.square(cell / 12))
    sd = float(np.degrees(spread / (np.sqrt(len(reached)) * np.std(reached))))
    shift = float(middle[0] - middle[1] * direction[0] / direction[1])
    if sd > limits.SLIM_SD_DEG or abs(shift) > 2 * cell:
        return None
    return _SectionLine(shift, float(np.degrees(np.arctan2(direction[1], direction[0]))), sd, kept)


def _at_its_edge(face: SlimFace) -> FoldEdge:
    """The fold between a surface and a slim face beside it."""
    normal = face.sheet.patch.grid.surface.normal(face.ends[:1])[0]
    return _fold(face, face.sheet, face.ends, 180.0 - face.degrees, normal)


def _at_its_far_side(face: SlimFace, sheets: Sequence[Sheet]) -> Iterator[FoldEdge]:
    """The folds between a slim face and other planes that its far side reaches."""
    cell, tree = face.sheet.cell_m, cKDTree(face.points)
    along = face.ends[1] - face.ends[0]
    for other in sheets:
        if other is face.sheet or not isinstance(other.surface, Plane):
            continue
        if np.abs(other.surface.distance(face.points)).min() > limits.SLIM_MEETS_CELLS * cell:
            continue
        for curve in fold_curves(face.plane, other.surface):
            low, high = curve.span(np.stack([face.points.min(axis=0) - cell, face.points.max(axis=0) + cell]))
            t = np.arange(low, high, cell)
            if len(t) < limits.SLIM_LENGTH_CELLS:
                continue
            places = curve.at(t)
            near = (tree.query(places)[0] < limits.SLIM_MEETS_CELLS * cell) & other.is_within(
                other.surface.to_uv(places), 2 * cell
            )
            near = ndimage.binary_closing(
                np.pad(near, limits.SLIM_BRIDGED_CELLS), np.ones(limits.SLIM_BRIDGED_CELLS)
            )[limits.SLIM_BRIDGED_CELLS : -limits.SLIM_BRIDGED_CELLS]
            held = np.flatnonzero(near)
            direction = places[1] - places[0]
            is_along = abs(float(direction @ along)) > 0.9 * np.linalg.norm(direction) * np.linalg.norm(along)
            if (
                len(held) < limits.SLIM_LENGTH_CELLS
                or not is_along
                or len(held) < 0.8 * (held[-1] - held[0] + 1)
            ):
                continue
            facing = float(other.surface.normal_direction @ face.plane.normal_direction)
            turn = float(np.degrees(np.arccos(np.clip(facing, -1, 1))))
            inside = float(other.surface.distance(face.points.mean(axis=0, keepdims=True))[0]) > 0
            dihedral = 180.0 - turn if inside else 180.0 + turn
            yield _fold(face, other, places[held[[0, -1]]], dihedral, other.surface.normal_direction)


def _fold(face: SlimFace, sheet: Sheet, ends: FloatArray, dihedral: float, normal: FloatArray) -> FoldEdge:
    """The fold (2, 3) between a surface and a slim face."""
    outward = cross(normal, (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0]))
    spread = np.square(sheet.patch.stated.standard_deviation(ends))
    wide = face.sheet.cell_m**2 / 12  # where in the surface the pixels end
    return FoldEdge(
        surfaces=(sheet.number, NO_SURFACE),
        goes_on=(),
        points=ends,
        covariance=spread[:, None, None] * np.outer(normal, normal) + wide * np.outer(outward, outward),
        dihedral_deg=dihedral,
        length_m=float(np.linalg.norm(ends[1] - ends[0])),
        measured_share=1.0,
        normals=np.stack([normal, face.plane.normal_direction]),
        dihedral_sd_deg=face.sd_deg,
    )


def _along(points: FloatArray, step_m: float) -> FloatArray:
    """Places (n, 3) about a step apart along a polyline (k, 3)."""
    stretches = [points[:1]]
    for begin, end in pairwise(points):
        count = max(1, int(np.linalg.norm(end - begin) / step_m))
        stretches.append(begin + np.arange(1, count + 1)[:, None] / count * (end - begin))
    return np.concatenate(stretches)


def build_panels(
    sheets: Sequence[Sheet], outline: Callable[[int], OutlineCells], unexplained: FloatArray
) -> PanelModel:
    """Build the light model of completed surfaces (fold-seeded triangulation, McCormick & Fisher 2002).

    Folds are not looked for in a mesh: they are the intersections of surfaces that are known already, and the
    mesh is made to have them.

    Parameters
    ----------
    sheets : sequence of Sheet
        The surfaces as areas of their charts, in the order of their numbers.
    outline : callable
        What is known of the outline of the surface of a number, from 0.
    unexplained : (n, 3) float
        Measured points that belong to no surface, metres.
    """
    # 1. Fold: find the stretches of curves that two surfaces reach, and on which sides of them they go on.
    folds_met = find_folds(sheets)

    # 2. Close: a fold that ends near a third surface ends at it, so that corners are points.
    folds, corners = close_corners(folds_met, sheets)

    # 3. Arrange: fill each surface up to its folds, cut off what lies beyond, and divide its chart by its
    #    outline, the borders between measured and inferred, its folds, and the facets of cylinders.
    charts = [
        arrange(sheet, [fold for fold in folds if sheet.number in (fold.first, fold.second)])
        for sheet in sheets
    ]

    # 4. Weld: give both surfaces of a fold the same nodes, triangulate without further points, and join.
    facets = weld(charts)

    # 5. Find the folds at which faces begin that are too slim to be surfaces, as the sides of a board.
    edges = [fold_edge(fold, sheets) for fold in folds]
    edges += slim_folds(sheets, unexplained, edges)

    # 6. Tell: how well folds and corners are known, and what lies beyond the edges that are left open.
    return replace(
        facets,
        folds=tuple(edges),
        corners=tuple(corner_point(corner, sheets) for corner in corners),
        open_m=_open_edges(facets, sheets, outline),
    )


def _open_edges(
    facets: PanelModel, sheets: Sequence[Sheet], outline: Callable[[int], OutlineCells]
) -> dict[str, float]:
    """Length of the edges of a single facet by what the outline's nearest cell says of them, metres."""
    edges, count, owner = edges_of(facets.faces)
    is_open = count == 1
    edges, owner = edges[is_open], owner[is_open]
    length = np.linalg.norm(facets.vertices[edges[:, 1]] - facets.vertices[edges[:, 0]], axis=1)
    middle = facets.vertices[edges].mean(axis=1)
    total: dict[str, float] = {}
    for number in np.unique(facets.face_surface[owner]).tolist():
        is_member = facets.face_surface[owner] == number
        grid = sheets[number - 1].patch.grid
        kinds = NearOutline.of(grid, outline(number - 1)).kinds(grid.surface.to_uv(middle[is_member]))
        for kind in np.unique(kinds).tolist():
            total[kind] = total.get(kind, 0.0) + float(length[is_member][kinds == kind].sum())
    return dict(sorted(total.items()))
