# SPDX-License-Identifier: MIT
"""Features of a part by name: holes and their patterns, slots, pockets, bosses, ribs and fillets.

Nothing is detected here: holes, fillets and sizes are those of the dimensions, the others loops of profiles.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any, Literal

import numpy as np
import shapely

from completion.parts.dimensions.dimension import Kind, PartDimension, PartDimensions
from completion.parts.dimensions.hole import OPEN, Hole
from completion.parts.division.divided_part import RelatedPart, surface_points
from completion.parts.profiles.profile import Loop, Profile
from scenes.checks import FloatArray, IntArray
from scenes.surfaces.catalogue import Cone, Cylinder

FeatureKind = Literal["hole", "pattern", "slot", "pocket", "boss", "rib", "fillet"]
_CUT = ("slot", "pocket", "boss", "rib")  # of the kinds of loops
_REACH = 2.0  # sampling distances from a loop within which a face is its wall
_MOSTLY = 0.5  # of a face's points, that must be there
_N_PLACES = 181  # along an arc


@dataclass(frozen=True, slots=True, eq=False)
class PartFeature:
    """A feature of a part.

    Attributes
    ----------
    kind : str
        "hole", "pattern" (of holes), "slot", "pocket", "boss", "rib" or "fillet" (all of one radius).
    number : int
        From 1, among those of its kind.
    size : str
        In words, millimetres: "diameter 6.60 mm, through".
    surfaces : tuple of int
        Labels of its faces, ascending.
    members : tuple of PartFeature
        The holes of a pattern.
    """

    kind: FeatureKind
    number: int
    size: str
    surfaces: tuple[int, ...]
    members: tuple[PartFeature, ...] = ()

    @property
    def name(self) -> str:
        """What it is called: "hole 3"."""
        return f"{self.kind} {self.number}"

    @property
    def title(self) -> str:
        """The same with its size."""
        return f"{self.name}: {self.size}"

    def record(self) -> dict[str, Any]:
        """Return what summaries and part.json hold of it."""
        own = {"name": self.name, "kind": self.kind, "size": self.size, "surfaces": list(self.surfaces)}
        return own | ({"members": [one.record() for one in self.members]} if self.members else {})


def features_of(
    part: RelatedPart, dimensions: PartDimensions, profiles: Sequence[Profile]
) -> tuple[PartFeature, ...]:
    """Name the features of a part.

    Parameters
    ----------
    part : RelatedPart
        As `model_part` gives it.
    dimensions : PartDimensions
        Its dimensions (`dimensions_of`).
    profiles : sequence of Profile
        What of it is swept (`profiles_of`); slots, pockets, bosses and ribs are of these.

    Returns
    -------
    tuple of PartFeature
        Patterns with their holes, other holes, then slots, pockets, bosses, ribs and fillets.
    """
    holes = [_hole(number, walls, part, dimensions) for number, walls in enumerate(_ordered(dimensions), 1)]
    patterns = list(_patterns(holes, dimensions))
    within = {hole.name for pattern in patterns for hole in pattern.members}
    swept = list(_swept(part, profiles))
    slots = {label for one in swept if one.kind == "slot" for label in one.surfaces}
    return (
        *patterns,
        *(hole for hole in holes if hole.name not in within),
        *swept,
        *_fillets(part, dimensions, slots),
    )


def features_text(features: Sequence[PartFeature]) -> str:
    """How many features there are of each kind, in words: "4 holes in 1 pattern, 1 pocket"."""
    kinds = [one.kind for one in features]
    n_holes = kinds.count("hole") + sum(len(one.members) for one in features)
    plural = {"boss": "bosses"}
    told = [f"{n_holes} hole{'s' if n_holes > 1 else ''}"] if n_holes else []
    n_patterns = kinds.count("pattern")
    within = sum(len(one.members) for one in features)
    if n_patterns:
        told[0] += f" ({within} in {n_patterns} pattern{'s' if n_patterns > 1 else ''})"
    for kind in dict.fromkeys(kinds):
        n = kinds.count(kind)
        if kind not in ("hole", "pattern"):
            told.append(f"{n} {kind if n == 1 else plural.get(kind, f'{kind}s')}")
    return ", ".join(told) or "none found"


def _ordered(dimensions: PartDimensions) -> list[tuple[Hole, ...]]:
    return sorted(dimensions.holes, key=lambda walls: min(hole.place for hole in walls))


def _hole(number: int, walls: Sequence[Hole], part: RelatedPart, dimensions: PartDimensions) -> PartFeature:
    """A hole with its steps and countersinks: the narrowest cylinder first."""
    places, texts = set[int](), list[str]()
    for hole in sorted(walls, key=lambda hole: (_radius(part, hole.place), hole.place)):
        depth = _row_of("hole depth", part.labels[hole.place], dimensions)
        texts.append(f"{'counterbore ' if texts else ''}diameter {_mm(2 * _radius(part, hole.place))}")
        if hole.note == "blind" and depth is not None:
            texts.append(f"depth {_mm(depth.value)}")
        elif hole.note and not places:
            texts.append(hole.note)
        ends = {end.place for end in hole.ends if end.kind != OPEN or _is_cone(part, end.place)}
        places |= {hole.place, *ends}
    for place in sorted(places):
        mouth, surface = (
            _row_of("countersink diameter", part.labels[place], dimensions),
            part.fits[place].surface,
        )
        if mouth is not None and isinstance(surface, Cone):
            angle = np.degrees(2 * surface.half_angle)
            texts.append(f"countersink diameter {_mm(mouth.value)}, {angle:.0f} deg")
    labels = tuple(part.labels[place] for place in sorted(places))
    return PartFeature("hole", number, ", ".join(texts), labels)


def _is_cone(part: RelatedPart, place: int) -> bool:
    return place >= 0 and isinstance(part.fits[place].surface, Cone)


def _radius(part: RelatedPart, place: int) -> float:
    surface = part.fits[place].surface
    return surface.radius if isinstance(surface, Cylinder) else 0.0


def _row_of(kind: Kind, label: int, dimensions: PartDimensions) -> PartDimension | None:
    """The dimension of a kind that is of a surface."""
    return next((row for row in dimensions.of_kind(kind) if label in row.surfaces), None)


def _mm(value_m: float) -> str:
    return f"{1e3 * value_m:.2f} mm"


def _patterns(holes: Sequence[PartFeature], dimensions: PartDimensions) -> Iterator[PartFeature]:
    """Patterns of holes at regular places, in the order of their dimensions."""
    pitches = dict[tuple[int, ...], list[PartDimension]]()
    for row in dimensions.rows:
        if row.kind in ("pitch circle diameter", "pitch"):
            pitches.setdefault(row.surfaces, []).append(row)
    number = 0
    for labels, rows in pitches.items():
        members = tuple(hole for hole in holes if set(labels) & set(hole.surfaces))
        if members:
            number += 1
            pitch = " x ".join(_mm(row.value) for row in rows)
            size = f"{len(members)} x hole {members[0].size}, {rows[0].kind} {pitch}"
            surfaces = tuple(sorted(chain.from_iterable(hole.surfaces for hole in members)))
            yield PartFeature("pattern", number, size, surfaces, members)


def _fillets(part: RelatedPart, dimensions: PartDimensions, slots: Collection[int]) -> Iterator[PartFeature]:
    """Fillets, those of one radius with all pieces of their surfaces together; ends of `slots` are none."""
    number = 0
    for row in dimensions.of_kind("fillet radius"):
        groups = {part.groups[part.labels.index(label)] for label in row.surfaces if label not in slots}
        own = [label for label, group in zip(part.labels, part.groups, strict=True) if group in groups]
        if own:
            number += 1
            many = f"{len(groups)} x " if len(groups) > 1 else ""
            yield PartFeature("fillet", number, f"{many}radius {_mm(row.value)}", tuple(own))


def _swept(part: RelatedPart, profiles: Sequence[Profile]) -> Iterator[PartFeature]:
    """Slots, pockets, bosses and ribs of extrusions, by kind; none whose walls are all of an earlier one."""
    points, label = surface_points(part)
    found, known = list[tuple[FeatureKind, str, set[int]]](), list[set[int]]()
    for profile in profiles:
        for loop in profile.loops if profile.sweep.kind == "extruded" else ():
            if loop.kind not in _CUT:
                continue
            walls = {face for one in loop.segments for face in profile.faces[one.wall]}
            own = {number for number in walls if _is_wall(loop, profile, points[label == number], part)}
            if own and not any(own <= other for other in known):
                known.append(own)
                ends = _ends(loop, profile, part, points, label)
                found.append((loop.kind, _size_text(loop, list(ends.values())), own | set(ends)))  # type: ignore[arg-type]  # one of _CUT
    for kind in _CUT:
        alike = [(size, labels) for one, size, labels in found if one == kind]
        for number, (size, labels) in enumerate(alike, start=1):
            yield PartFeature(kind, number, size, tuple(sorted(labels)))  # type: ignore[arg-type]  # one of _CUT


def _is_wall(loop: Loop, profile: Profile, points: FloatArray, part: RelatedPart) -> bool:
    """Whether most points (n, 3) of a face are on a loop and between its ends."""
    if not len(points):
        return False
    local, reach = profile.sweep.flatten(points), _REACH * part.spacing_m
    line = shapely.LineString(np.concatenate([one.places(_N_PLACES) for one in loop.segments]))
    is_on = shapely.distance(line, shapely.points(local[:, :2])) <= reach
    is_between = (local[:, 2] >= loop.low_m - reach) & (local[:, 2] <= loop.high_m + reach)
    return float(np.mean(is_on & is_between)) > _MOSTLY


def _ends(
    loop: Loop, profile: Profile, part: RelatedPart, points: FloatArray, label: IntArray
) -> dict[int, float]:
    """Heights of the planes at the ends of a loop that lie within it: a pocket's floor, a boss's top."""
    area, ends = loop.polygon.buffer(0), dict[int, float]()
    for number, fit in zip(part.labels, part.measured, strict=True):
        cap, own = profile.sweep.cap(fit), points[label == number]
        if cap is None or not len(own):
            continue
        off = min(abs(cap[0] - end) for end in (loop.low_m, loop.high_m))
        is_within = shapely.contains_xy(area, profile.sweep.flatten(own)[:, :2])
        if off <= _REACH * part.spacing_m and float(np.mean(is_within)) > _MOSTLY:
            ends[number] = cap[0]
    return ends


def _size_text(loop: Loop, ends: Sequence[float]) -> str:
    """Width and length along its longest side, or the diameter of a round one; depth or height.

    `ends` are heights of planes within it, which its own levels may be beside.
    """
    places = np.concatenate([one.places(_N_PLACES) for one in loop.segments])
    lines = [one for one in loop.segments if one.centre is None]
    if not lines and len({one.wall for one in loop.segments}) == 1:
        text = f"diameter {_mm(2 * loop.segments[0].radius)}"
    else:
        longest = max(lines, key=lambda one: one.length) if lines else loop.segments[0]
        along = longest.end - longest.start
        along = along / max(float(np.linalg.norm(along)), 1e-12) if lines else np.array([1.0, 0.0])
        length, width = np.ptp(places @ np.column_stack([along, [-along[1], along[0]]]), axis=0)
        is_slot = loop.kind == "slot"
        text = f"width {_mm(width)}, length {_mm(length)}" if is_slot else f"{_mm(length)} x {_mm(width)}"
    if loop.is_through and not ends:
        return f"{text}, through"
    levels = np.array([loop.low_m, loop.high_m])
    for height in ends:
        levels[np.argmin(np.abs(levels - height))] = height
    return f"{text}, {'depth' if loop.is_hollow else 'height'} {_mm(float(np.ptp(levels)))}"
