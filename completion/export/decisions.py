# SPDX-License-Identifier: MIT
"""Decisions: from a building to a sheet of numbers that people order by, and which of them to rely on.

Radii, lengths and distances of pipes and columns stand here; `room_dimensions` has those of rooms.
"""

from __future__ import annotations

import csv
import io
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from typing import Any, Literal

import numpy as np

from completion.export.building.limits import (
    ENDS_IT,
    LEAST_ARC,
    LEAST_EXISTENCE,
    LEAST_MEASURED,
    MAJORITY,
    NEAR_CELLS,
    NEARLY_ALL,
)
from completion.export.building.model import BuildingModel, CylinderElement, PlaneElement
from completion.export.building.parts import BuildingParts
from completion.export.dimension import (
    UNKNOWN,
    Dimension,
    Kind,
    Support,
    half_interval,
)
from completion.export.room_dimensions import opening_sizes, room_heights, room_sizes, thicknesses, widths_of
from completion.uncertainty.joint_errors import JointErrors
from scenes.checks import FloatArray, Value
from scenes.run.libraries import table_of

_AROUND, _WITHIN, _BEYOND = 1.3, 0.6, 1.5  # radii from an axis: beside a cylinder, in its lid, beyond that


def cylinder_sizes(building: BuildingParts) -> tuple[Dimension, ...]:
    """Return radius and length of round columns and of pipes, and how far neighbouring columns are apart.

    Those are pipes and columns of which a quarter of a turn was measured: cushions and pots are round, too.

    A cylinder ends on the first plane that it comes to beyond what was measured of it, or where beams went by
    its own end. A hidden end may be anywhere between where the cylinder was measured and what encloses the
    room. There is no length where nothing ends it, or a plate does that was seen from its other side, as a
    table's leg is ended. Columns are upright; their distance is
    taken between their axes, level, halfway up.
    """
    model = building.model
    columns = [
        column.cylinder
        for column in building.columns
        if column.cylinder is not None and _is_round(column.cylinder)
    ]
    pipes = [pipe for pipe in building.pipes if _is_round(pipe)]
    sizes = [dimension for column in columns for dimension in _own(column, model, "column")]
    sizes += [dimension for pipe in pipes for dimension in _own(pipe, model, "pipe")]
    middles = [column.ends.mean(axis=0) for column in columns]
    for k, m in combinations(range(len(columns)), 2):
        ends = np.stack([middles[k], middles[m]])
        ends[:, 2] = ends[:, 2].mean()
        ends = np.stack([_on_axis(columns[k], ends[0]), _on_axis(columns[m], ends[1])])
        apart = np.linalg.norm(ends[1] - ends[0])
        between = [n for n in range(len(columns)) if n not in (k, m)]
        if all(np.linalg.norm(middles[n][:2] - ends.mean(axis=0)[:2]) >= apart / 2 for n in between):
            sizes.append(_column_spacing((columns[k], columns[m]), ends, model.errors))
    return tuple(sizes)


def _is_round(cylinder: CylinderElement) -> bool:
    """Whether enough of its turn was measured to tell that it is round."""
    seen = cylinder.patch.observed.any(axis=0)
    arc = float(seen.sum() * cylinder.patch.grid.cell[0]) / cylinder.radius_m
    return arc >= LEAST_ARC


def _own(cylinder: CylinderElement, model: BuildingModel, what: Literal["column", "pipe"]) -> list[Dimension]:
    """Radius and length of a cylinder."""
    is_column = what == "column"
    middle, along = cylinder.ends.mean(axis=0), _direction(cylinder)
    sides = [middle + cylinder.radius_m * way for way in _across(along)]
    around = tuple(Support(cylinder, side, -1.0 / len(sides)) for side in sides)
    half = half_interval(around, model.errors)
    radius = Dimension(
        kind="column radius" if is_column else "pipe radius",
        value=cylinder.radius_m,
        low=cylinder.radius_m - half,
        high=cylinder.radius_m + half,
        supports=around,
        ends=np.stack([middle, sides[0]]),
        measured_share=1.0,
        existence=1.0,
    )
    caps = [end for end in (_end(cylinder, which, model) for which in (0, 1)) if end is not None]
    if len(caps) < 2:
        return [radius]
    ends = np.stack([caps[0].place, caps[1].place])
    value, planes = float(np.linalg.norm(ends[1] - ends[0])), [*caps[0].on, *caps[1].on]
    step = float(cylinder.patch.grid.cell[1])
    half = half_interval(planes, model.errors, more_sd=step * np.sqrt((2 - len(planes)) / 12))
    length = Dimension(
        kind="column height" if is_column else "pipe length",
        value=value,
        low=max(value - half - caps[0].inwards_m - caps[1].inwards_m, 0.0),
        high=value + half + caps[0].outwards_m + caps[1].outwards_m,
        supports=(Support(cylinder, ends[0], 0.0), *planes),
        ends=ends,
        measured_share=float(np.mean([cap.inwards_m + cap.outwards_m == 0 for cap in caps])),
        existence=1.0,
    )
    return [radius, length]


@dataclass(frozen=True, slots=True, eq=False)
class _End:
    """Where an axis ends.

    Attributes
    ----------
    place : (3,) float
        Where it ends; its last cells reach over it by one where beams go by. World coordinates, metres.
    on : tuple of Support
        The plane that it ends on; none where beams went by its own end.
    inwards_m, outwards_m : float
        How far it may be off where that is hidden: back to where the cylinder was measured, on to what
        encloses the room; 0 where it was measured up to the plane.
    """

    place: FloatArray
    on: tuple[Support, ...]
    inwards_m: float = 0.0
    outwards_m: float = 0.0


def _end(cylinder: CylinderElement, which: int, model: BuildingModel) -> _End | None:
    """Where the axis ends; None where that is hidden, or behind a plate seen from its other side."""
    outwards = _direction(cylinder) * (2 * which - 1)
    start, last = (_measured_end(cylinder, which, share) for share in (NEARLY_ALL, 1.0))
    met = sorted(_meetings(start, outwards, model), key=lambda pair: pair[0])
    reach = next((off for off, plane in met if plane.kind != "plane"), None)
    cell = float(cylinder.patch.grid.cell[1])
    near = NEAR_CELLS * cell + float((last - start) @ outwards)
    for off, plane in met[:1]:
        at, slope = start + off * outwards, float(plane.normal @ outwards)
        if off > near or not _is_solid(plane, at, cylinder):
            continue
        if slope > 0 and _is_plate(plane, at, cylinder):
            return None
        return _End(at, (Support(plane, at, -1.0 / slope),))
    if _is_free(cylinder, which):
        return _End(last - cell * outwards, ())
    if reach is None:
        return None
    believed = float(np.clip((cylinder.ends[which] - start) @ outwards, 0.0, met[0][0]))
    gap = float(np.maximum(believed - (last - start) @ outwards, 0.0))
    return _End(start + believed * outwards, (), gap + 2 * cell, max(reach - believed, 0.0))


def _is_solid(plane: PlaneElement, place: FloatArray, cylinder: CylinderElement) -> bool:
    """Whether a plane ends a cylinder at a place (3,): what encloses the room does, and what was measured.

    It was measured around the cylinder, or where it faces outwards, within, as the lid of a drum is.
    """
    facing = float(plane.normal @ (place - cylinder.ends.mean(axis=0))) > 0
    far = cylinder.radius_m * (_WITHIN if facing else _AROUND)
    around = [place + far * way for way in _across(_direction(cylinder))]
    return plane.kind != "plane" or sum(plane.provenance(near) == 0 for near in around) > len(around) / 2


def _is_plate(plane: PlaneElement, place: FloatArray, cylinder: CylinderElement) -> bool:
    """Whether a plane that faces outwards goes on around the cylinder, so that it is no lid."""
    around = [place + _BEYOND * cylinder.radius_m * way for way in _across(_direction(cylinder))]
    return any(plane.provenance(near) >= 0 for near in around)


def _meetings(
    start: FloatArray, outwards: FloatArray, model: BuildingModel
) -> Iterator[tuple[float, PlaneElement]]:
    """The planes that an axis comes to, and how far they are from a place (3,) on it."""
    for plane in model.planes:
        slope = float(plane.normal @ outwards)
        if abs(slope) < ENDS_IT:
            continue
        off = float((plane.point - start) @ plane.normal) / slope
        if off >= 0 and plane.covers(start + off * outwards):
            yield off, plane


def _measured_end(cylinder: CylinderElement, which: int, share: float = 1.0) -> FloatArray:
    """The place (3,) on the axis up to which a share of the measured cells lie."""
    grid, surface = cylinder.patch.grid, cylinder.surface
    rows = np.nonzero(cylinder.patch.observed)[0]
    row = np.quantile(rows, share) + 1 if which else np.quantile(rows, 1 - share)
    along = grid.corner[1] + grid.cell[1] * row
    return np.asarray(cylinder.world.apply((surface.point + along * surface.direction)[None])[0])


def _is_free(cylinder: CylinderElement, which: int) -> bool:
    """Whether beams went through where the cylinder would go on, beyond most of its last measured cells."""
    observed, went = cylinder.patch.observed, cylinder.patch.evidence.open
    rows = np.flatnonzero(observed.any(axis=1))
    last, step = (rows[-1], 1) if which else (rows[0], -1)
    beyond = [row for row in (last + step, last + 2 * step, last + 3 * step) if 0 <= row < len(observed)]
    if not beyond:
        return False
    passed = np.asarray(went[beyond].any(axis=0))
    return float(np.mean(passed[observed[last]])) > MAJORITY


def _column_spacing(
    columns: tuple[CylinderElement, CylinderElement], ends: FloatArray, errors: JointErrors
) -> Dimension:
    """How far two axes are apart at two places (2, 3) on them."""
    along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    supports = []
    for column, end, way in zip(columns, ends, (along, -along), strict=True):
        for sign in (1.0, -1.0):  # an axis moves as half of what both sides of its cylinder do
            place = end + sign * column.radius_m * way
            supports.append(Support(column, place, 0.5 * sign))
    value, half = float(np.linalg.norm(ends[1] - ends[0])), half_interval(supports, errors)
    return Dimension(
        kind="column spacing",
        value=value,
        low=value - half,
        high=value + half,
        supports=tuple(supports),
        ends=ends,
        measured_share=1.0,
        existence=1.0,
    )


def _direction(cylinder: CylinderElement) -> FloatArray:
    return np.asarray((cylinder.ends[1] - cylinder.ends[0]) / cylinder.length_m)


def _across(along: FloatArray) -> list[FloatArray]:
    """Four directions across a unit vector (3,), a quarter turn from each to the next."""
    first = np.cross(along, np.eye(3)[int(np.argmin(np.abs(along)))])
    first /= np.linalg.norm(first)
    second = np.cross(along, first)
    return [first, second, -first, -second]


def _on_axis(cylinder: CylinderElement, place: FloatArray) -> FloatArray:
    """The place (3,) on a column's axis at the height of another."""
    along = _direction(cylinder)
    return np.asarray(cylinder.ends[0] + (place[2] - cylinder.ends[0][2]) / along[2] * along)


def thing_sizes(model: BuildingModel) -> Iterator[Dimension]:
    """Yield width, depth and height of closed things, where something bounds them."""
    kinds: tuple[Kind, ...] = ("thing width", "thing depth", "thing height")
    for thing in model.things:
        for k, kind in enumerate(kinds):
            extent = (thing.extents.width, thing.extents.depth, thing.extents.height)[k]
            if extent.most is not None:
                yield Dimension(
                    kind=kind,
                    value=extent.estimate,
                    low=extent.least,
                    high=extent.most,
                    supports=(),
                    ends=thing.corners_of(k),
                    measured_share=float(extent.is_seen),
                    existence=1.0,
                    thing=thing.number,
                )


Advice = Literal["rely", "check", "do not build"]

TOLERANCE_M = 0.010
"""Half an interval up to which dimensions are relied on where nobody says how exact they must be, metres."""


def advice(dimension: Dimension, tolerance_m: float = TOLERANCE_M) -> Advice:
    """Return whether to rely on a dimension, to check it on site, or not to build by it.

    "do not build" where an end of it is there with a probability below 0.8. "rely" where half its 95 %
    interval is within the tolerance and at least half of what it rests on was measured. Else "check". The
    tolerance of an area is what its perimeter makes of it, each side off by half; that of a volume, what its
    surface does.
    """
    if dimension.existence < LEAST_EXISTENCE:
        return "do not build"
    is_exact = dimension.half <= tolerance_m * dimension.across_m
    return "rely" if is_exact and dimension.measured_share >= LEAST_MEASURED else "check"


def told_rule(tolerance_m: float) -> str:
    """The rule in plain words."""
    return (
        f"Rely: half the 95 % interval is at most {1000 * tolerance_m:g} mm, and at least half of what the "
        "dimension rests on was measured. Do not build: an end of it is there with a probability below 0.8. "
        "Check on site: all others. An area may be off by what the tolerance makes of its sides, half of it "
        "on each, and a volume by what it makes of its faces."
    )


COLUMNS = ("dimension", "kind", "value_m", "low_m", "high_m", "measured_share", "advice", "unit")


@dataclass(frozen=True, slots=True, eq=False)
class DecisionSheet(Value):
    """Dimensions with advice.

    Attributes
    ----------
    dimensions : tuple of Dimension
        By kind, the greatest first.
    tolerance_m : float
        Half an interval up to which they are relied on, metres.
    """

    dimensions: tuple[Dimension, ...]
    tolerance_m: float

    @property
    def advice(self) -> tuple[Advice, ...]:
        """What is said of each."""
        return tuple(advice(dimension, self.tolerance_m) for dimension in self.dimensions)

    @property
    def told_doubt(self) -> str:
        """What is said where intervals are not known, as of a mesh; nothing else."""
        return "" if all(np.isfinite(dimension.half) for dimension in self.dimensions) else UNKNOWN

    def counts(self) -> dict[str, int]:
        """How many of them there are of each word."""
        literal = Counter(self.advice)
        return {word: literal[word] for word in ("rely", "check", "do not build")}

    def to_pandas(self) -> Any:
        """Return what `decisions.csv` holds as a `pandas.DataFrame`; raises InputError without pandas."""
        return table_of(self.to_csv())

    def to_csv(self) -> str:
        """What `decisions.csv` holds: lengths in metres, areas in m2, volumes in m3, as `unit` says.

        An interval that is not known ends at inf.
        """
        text = io.StringIO()
        rows = csv.writer(text, lineterminator="\n")
        rows.writerow(COLUMNS)
        for dimension, word in zip(self.dimensions, self.advice, strict=True):
            numbers = [f"{number:.4f}" for number in (dimension.value, dimension.low, dimension.high)]
            rows.writerow(
                [
                    dimension.name,
                    dimension.kind,
                    *numbers,
                    f"{dimension.measured_share:.2f}",
                    word,
                    dimension.unit,
                ]
            )
        return text.getvalue()


def decision_sheet(building: BuildingParts, tolerance_m: float = TOLERANCE_M) -> DecisionSheet:
    """Return what people order by, each with the interval in which it lies and a word on relying on it.

    Parameters
    ----------
    building : BuildingParts
        What was completed.
    tolerance_m : float
        Half an interval up to which a dimension may be relied on, metres.
    """
    model = building.model

    # 1. Rooms: widths between walls, heights between floors and ceilings; areas and volumes of closed ones.
    heights = [height for storey in building.storeys for height in room_heights(storey, model.errors)]
    rooms = (*widths_of(building), *heights, *room_sizes(building))

    # 2. Walls and slabs that were seen from both sides.
    bodies = thicknesses(building)

    # 3. Openings in walls.
    openings = opening_sizes(building)

    # 4. Columns and pipes.
    cylinders = cylinder_sizes(building)

    # 5. Things that stand there, closed.
    things = thing_sizes(model)
    return DecisionSheet((*rooms, *bodies, *openings, *cylinders, *things), tolerance_m)
