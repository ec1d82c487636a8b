# SPDX-License-Identifier: MIT
"""Plans of the storeys of a design, each element cut and filled in the colour of its verdict."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from matplotlib.path import Path as PlotPath

from completion.asbuilt.findings import DesignCheck, Verdict
from nbv.inspection.verdict_colours import EXTRA_COLOUR, VERDICT_COLOURS
from nbv.report.blocks.coverage_tables import cut_by_surface
from nbv.report.figures.floor_plan import StoreyPlan
from nbv.report.figures.picture import Picture
from nbv.run.wording import letters
from scenes.checks import FloatArray
from scenes.mesh.design import ElementMesh

_CUT_M = 1.2  # above a floor: through doors and most windows
_APART_M = 1.8  # floors
_CELL_M = 0.05  # of extras, as the check has it
_ENDS_MEET_M = 1e-5
_LINE = 0.002  # of the plan's extent: half as wide as a line is drawn
_MOST_STATIONS = 60  # with letters on one plan
_PATTERNS: Mapping[Verdict, str] = {"hidden": "//////", "not seen": "....."}


@dataclass(frozen=True, slots=True)
class DesignStorey:
    """A storey of a design: its name, the height of its floor, and how far above it is cut, metres."""

    name: str
    floor_m: float
    cut_m: float


def design_storeys(design: ElementMesh) -> tuple[DesignStorey, ...]:
    """Return the storeys from the lowest up.

    A floor is where most elements of the storey begin that are higher than the cut, 1.2 m; where there is
    none, the lowest place of the storey, which is then cut half way up. Elements that name no storey are on
    as many as there are heights, 1.8 m apart or more, at which higher ones begin.
    """
    low, high = element_heights(design)
    storeys = []
    for name in dict.fromkeys(element.storey for element in design.elements):
        here = np.array([element.storey == name for element in design.elements]) & np.isfinite(low)
        if not here.any():
            continue
        begin = np.sort(low[here & (high - low > _CUT_M)])
        levels = [] if name else np.split(begin, np.flatnonzero(np.diff(begin) > _APART_M) + 1)
        for several in levels or [begin]:
            floor = float(np.median(several)) if len(several) else float(low[here].min())
            cut = min(_CUT_M, float(high[here].max() - floor) / 2)
            storeys.append(DesignStorey(name or f"Level {floor:.2f} m", floor, cut))
    return tuple(sorted(storeys, key=lambda storey: storey.floor_m))


def element_heights(design: ElementMesh) -> tuple[FloatArray, FloatArray]:
    """Return the least and the largest z (n,) of each element; infinite for those without faces."""
    z = design.mesh.vertices[:, 2][design.mesh.faces]
    low, high = np.full(len(design.elements), np.inf), np.full(len(design.elements), -np.inf)
    np.minimum.at(low, design.mesh.face_surface, z.min(axis=1))
    np.maximum.at(high, design.mesh.face_surface, z.max(axis=1))
    return low, high


def verdict_plans(
    check: DesignCheck,
    numbers: Mapping[int, int],
    stations: Sequence[tuple[str, FloatArray]] = (),
) -> Iterator[Picture]:
    """Yield the plan of each storey that the cut meets.

    `numbers` stand on elements by their surface ids, `stations` (name, place (3,)) are where to stand next.
    """
    verdicts = {finding.surface: finding.verdict for finding in check.elements}
    storeys = design_storeys(check.design)
    given = [(letters(k), pose.translation) for k, pose in enumerate(check.alignment.poses)][:_MOST_STATIONS]
    for number, storey in enumerate(storeys):
        segments, surface = cut_by_surface(check.design.mesh, storey.floor_m + storey.cut_m)
        if not len(segments):
            continue
        grown = _LINE * float(np.ptp(segments, axis=(0, 1)).max())
        areas = {k: _area(segments[surface == k], grown) for k in np.unique(surface).tolist()}
        above = storeys[number + 1].floor_m if number + 1 < len(storeys) else np.inf
        below = storey.floor_m if number else -np.inf
        plan = StoreyPlan(
            storey=number,
            title=storey.name,
            outline=segments,
            cut_m=storey.cut_m,
            rooms=[(str(numbers[k]), _label_place(areas[k])) for k in areas if k in numbers],
            stations=[(name, at[:2], ()) for name, at in stations if below <= at[2] < above],
            given=[(name, at[:2]) for name, at in given if below <= at[2] < above],
            fills=[
                (_extra_cells(check, storey.floor_m + storey.cut_m), EXTRA_COLOUR, ""),
                *(
                    ([path for k in areas if verdicts.get(k) == verdict for path in _paths(areas[k])], colour,
                     _PATTERNS.get(verdict, ""))
                    for verdict, colour in VERDICT_COLOURS.items()
                ),
            ],
        )  # fmt: skip
        yield plan.plot(storey.name, _caption(storey, has_next=bool(plan.stations)))


def _caption(storey: DesignStorey, *, has_next: bool) -> str:
    text = f"Cut {storey.cut_m:.2f} m above the floor at z = {storey.floor_m:.2f} m. Numbers: the cards' own."
    text += " Blue: surface of no element. Squares: scans."
    return f"{text} Dots: where to stand next." if has_next else text


def _extra_cells(check: DesignCheck, height_m: float) -> list[PlotPath]:
    """The cells of extras that a level plane meets, as squares."""
    near = [extra.points[np.abs(extra.points[:, 2] - height_m) <= _CELL_M / 2] for extra in check.extra]
    corners = _CELL_M / 2 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]])
    middles = np.concatenate([np.zeros((0, 3)), *near])[:, :2]
    return [PlotPath(middle + corners, closed=True) for middle in middles]


def _area(segments: FloatArray, grown: float) -> shapely.Geometry:
    """The area that segments (k, 2, 2) enclose, holes left out, and their own: panes are drawn as lines."""
    lines = shapely.linestrings(np.round(segments / _ENDS_MEET_M) * _ENDS_MEET_M)
    joined = shapely.node(shapely.geometrycollections(lines))
    return shapely.union(shapely.build_area(joined), shapely.buffer(joined, grown, cap_style="flat"))


def _paths(area: shapely.Geometry) -> list[PlotPath]:
    """Outlines of the polygons of an area, their holes turned the other way round."""
    polygons = [part for part in shapely.get_parts(area) if isinstance(part, shapely.Polygon)]
    return [
        PlotPath.make_compound_path(
            *(PlotPath(np.asarray(ring.coords), closed=True) for ring in (one.exterior, *one.interiors))
        )
        for one in map(shapely.normalize, polygons)
    ]


def _label_place(area: shapely.Geometry) -> FloatArray:
    """A place (2,) in the largest polygon of an area."""
    inside = shapely.point_on_surface(max(shapely.get_parts(area), key=shapely.area))
    return np.array([inside.x, inside.y])
