# SPDX-License-Identifier: MIT
"""Profiles of parts that are swept once: segments, loops and relations, from points with noise."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from benchmarks.cases.profiles import SweptCase, TrueLoop, TrueSegment, sampled, swept_case
from benchmarks.run import suite
from benchmarks.store import each
from completion.parts.part import Part
from completion.parts.pipeline import divide_part, relate_part
from completion.parts.profiles.chain import Segment
from completion.parts.profiles.pipeline import profiles_of
from completion.parts.profiles.profile import Profile
from completion.relations.constraint import constrain
from completion.relations.equations import RelationFrame, place
from completion.relations.relation import Relation, RelationKind
from scenes.checks import FloatArray, InputError
from scenes.surfaces.catalogue import Cylinder, Plane, Surface

NOISES = (0.02, 0.1)
"""Millimetres, of parts of about 100 mm."""
_FIRST = {"tuning": 0, "held-out": 1000}
_SHARE = np.linspace(0.0025, 0.9975, 200)
_OVERLAP = 0.8
_TRUE, _IMPOSED = 1e-6, 1e-7  # metres and radians, within which a relation holds of true and found segments
_KINDS: tuple[RelationKind, ...] = (
    "parallel", "perpendicular", "coplanar", "coaxial", "equal_radius", "tangent", "symmetric",
)  # fmt: skip


class Score(NamedTuple):
    """What was found of a part."""

    segments: int
    right: int
    loops: int
    loops_right: int
    true: dict[str, int]
    found: dict[str, int]
    holding: int
    false: int
    told: str
    seconds: float


def score(seed: int, noise_mm: float) -> Score:
    """Divide, relate and draw the part of a seed, and compare."""
    points = sampled(swept_case(seed), noise_mm, seed)
    return scored(swept_case(seed), relate_part(points, divide_part(points)), noise_mm)


def scored(case: SweptCase, part: Part, noise_mm: float) -> Score:
    """Find the profiles of a divided part, and compare them with the true one."""
    began = time.process_time()
    profiles = profiles_of(part)
    seconds = time.process_time() - began
    best = max(
        (_compared(case, profile, noise_mm) for profile in profiles), key=lambda one: one[0], default=None
    )
    true = _true_relations(case)
    n_true = dict(Counter[str](one.kind for one in true))
    n = len(case.segments)
    if best is None:
        return Score(n, 0, len(case.loops), 0, n_true, {}, 0, 0, f"nothing swept in {part!r}", seconds)
    right, wall_of, profile = best
    found = Counter[str](one.kind for one in true if _is_held(one, wall_of, profile))
    holding, false = _false(case, wall_of, profile)
    told = f"{right} of {n} segments" + (
        "" if right == n else f" of {[len(loop.segments) for loop in profile.loops]}; {part!r}"
    )
    loops_right = sum(_is_right(case, loop, profile, noise_mm) for loop in case.loops)
    for one in false:
        told += f"; false {one.kind} {one.surfaces} p {one.p:.2g} {one.status.value}"
    return Score(
        n, right, len(case.loops), loops_right, n_true, dict(found), holding, len(false), told, seconds
    )


def _compared(case: SweptCase, profile: Profile, noise_mm: float) -> tuple[int, dict[int, int], Profile]:
    """How many true segments were found, and the wall of each of these."""
    if profile.sweep.kind != case.kind:
        return 0, {}, profile
    found = [one for loop in profile.loops for one in loop.segments if one.wall >= 0]
    wall_of: dict[int, int] = {}
    for number, true in enumerate(case.segments):
        for one in found:
            if (one.centre is None) == (true.centre is None) and _overlap(
                case, profile, true, one, noise_mm
            ) >= _OVERLAP:
                wall_of[number] = one.wall
                break
    return len(wall_of), wall_of, profile


def _overlap(case: SweptCase, profile: Profile, true: TrueSegment, one: Segment, noise_mm: float) -> float:
    """The least share of either that lies within the noise of the other."""
    mine = TrueSegment(one.start, one.end, one.centre, one.radius, one.sweep_rad).places(_SHARE)
    mine, own = _in_case(case, profile, mine), true.places(_SHARE)
    dense = (
        true.places(np.linspace(0, 1, 4000)),
        _in_case(
            case,
            profile,
            TrueSegment(one.start, one.end, one.centre, one.radius, one.sweep_rad).places(
                np.linspace(0, 1, 4000)
            ),
        ),
    )
    away = [np.min(np.linalg.norm(some[:, None] - other[None], axis=2), axis=1)
            for some, other in ((mine, dense[0]), (own, dense[1]))]  # fmt: skip
    return float(min((far <= noise_mm).mean() for far in away))


def _in_case(case: SweptCase, profile: Profile, places: FloatArray) -> FloatArray:
    """Places (n, 2) of a profile, metres, in the true one, millimetres."""
    world = profile.sweep.profile_from_world.inverse().apply(np.column_stack([places, np.zeros(len(places))]))
    local = case.world.inverse().apply(world) * 1e3
    return np.asarray(
        local[:, :2] if case.kind == "extruded" else np.column_stack([local[:, 0], np.hypot(*local.T[1:])])
    )


def _is_right(case: SweptCase, loop: TrueLoop, profile: Profile, noise_mm: float) -> bool:
    """Whether a loop of its kind was found at its place, between its heights."""
    for one in profile.loops:
        if one.kind != loop.kind or abs(len(one.segments) - len(loop.segments)) > (case.kind == "revolved"):
            continue
        if case.kind == "revolved":
            return True
        middle = _in_case(case, profile, np.array([one.polygon.centroid.coords[0]]))
        off = np.linalg.norm(middle[0] - np.array(loop.polygon.centroid.coords[0]))
        heights = profile.sweep.profile_from_world.apply(
            case.world.apply(np.array([[0, 0, loop.low], [0, 0, loop.high]]) * 1e-3)
        )
        ends = np.sort(heights[:, 2]) - [one.low_m, one.high_m]
        is_through = loop.kind in ("hole", "slot", "pocket") and loop.low == 0.0
        if off < 1 and np.abs(ends).max() <= noise_mm * 1e-3 and is_through == one.is_through:
            return True
    return False


def _surface(one: TrueSegment) -> Surface:
    """A true segment as its line or circle, metres."""
    if one.centre is not None:
        return Cylinder(np.append(one.centre, 0) * 1e-3, (0, 0, 1), one.radius * 1e-3)
    way = (one.end - one.start) / np.linalg.norm(one.end - one.start)
    return Plane(np.append(one.start, 0) * 1e-3, (-way[1], way[0], 0), np.append(way, 0))


def _misfit(relation: Relation, surfaces: Sequence[Surface]) -> float:
    at = {
        k: place(surfaces[k], np.zeros(3 if isinstance(surfaces[k], Plane) else 5)) for k in relation.surfaces
    }
    try:
        return float(np.abs(constrain(relation, at, RelationFrame(at)).value).max())
    except InputError:
        return np.inf


def _true_relations(case: SweptCase) -> list[Relation]:
    """All pairs that a relation holds of; of the mirror its first pair with each other.

    Lines along and across an axis of revolution are so by themselves.
    """
    surfaces = [_surface(one) for one in case.segments]
    found, offset = list[Relation](), 0
    for one, two in combinations(range(len(surfaces)), 2):
        lines = [isinstance(surfaces[k], Plane) for k in (one, two)]
        kinds: tuple[RelationKind, ...] = ()
        if all(lines):
            kinds = ("parallel", "perpendicular", "coplanar")
            ways = [case.segments[k].end - case.segments[k].start for k in (one, two)]
            if case.kind == "revolved" and all(abs(way).min() < 1e-9 * abs(way).max() for way in ways):
                kinds = ("coplanar",)
        elif not any(lines):
            kinds = ("coaxial", "equal_radius")
        found += [
            r for kind in kinds if _misfit(r := Relation(kind=kind, surfaces=(one, two)), surfaces) < _TRUE
        ]
    for loop in case.loops:
        n = len(loop.segments)
        for k in range(n if n > 2 else 0):
            pair = offset + k, offset + (k + 1) % n
            if not all(isinstance(surfaces[number], Plane) for number in pair):
                relation = Relation(kind="tangent", surfaces=pair)
                found += [relation] if _misfit(relation, surfaces) < _TRUE else []
        offset += n
    hub = case.pairs[:1]
    return found + [Relation(kind="symmetric", surfaces=(*hub[0], *pair)) for pair in case.pairs[1:]]


def _is_held(relation: Relation, wall_of: dict[int, int], profile: Profile) -> bool:
    """Whether a true relation holds of what was found."""
    if not all(number in wall_of for number in relation.surfaces):
        return False
    walls = tuple(wall_of[number] for number in relation.surfaces)
    if len(set(walls)) < len(walls):
        return relation.kind != "symmetric"
    moved = Relation(kind=relation.kind, surfaces=walls)
    return _misfit(moved, [fit.surface for fit in profile.walls]) < _IMPOSED


def _false(case: SweptCase, wall_of: dict[int, int], profile: Profile) -> tuple[int, list[Relation]]:
    """How many relations hold between walls that were found right, and those of them that are not true."""
    number_of = {wall: number for number, wall in wall_of.items()}
    surfaces = [_surface(one) for one in case.segments]
    n, false = 0, list[Relation]()
    for one in profile.relations():
        if all(wall in number_of for wall in one.surfaces):
            n += 1
            true = Relation(
                kind=one.kind, surfaces=tuple(number_of[wall] for wall in one.surfaces), value=one.value
            )
            if len(set(true.surfaces)) == len(true.surfaces) and _misfit(true, surfaces) > _TRUE:
                false.append(one)
    return n, false


@suite("profiles", smallest="--parts 2 --noise 0.02")
def profiles(only: str = "tuning", parts: int = 40, noise: list[float] | None = None) -> Iterator[str]:
    """Extrusions and revolutions of 6 to 20 segments: segments, loops and relations right, relations false.

    A segment is right if one of its kind lies within the noise of it along 80 % of both. --only: tuning or
    held-out; --noise: millimetres, of parts of about 100 mm.
    """
    first = _FIRST[only]
    for level in noise or NOISES:
        total, seconds = Counter[str](), list[float]()
        for seed, one in zip(
            range(first, first + parts), each(score, list(range(first, first + parts)), level), strict=True
        ):
            yield f"{level:g} mm, part {seed}: {one.told}"
            kind = "extruded" if seed % 2 == 0 else "revolved"
            for name, number in (
                ("n", one.segments),
                ("right", one.right),
                ("loops", one.loops),
                ("loops right", one.loops_right),
            ):
                total[name] += number
                total[f"{name} {kind}"] += number
            total["holding"] += one.holding
            total["false"] += one.false
            for name in _KINDS:
                total[f"true {name}"] += one.true.get(name, 0)
                total[f"found {name}"] += one.found.get(name, 0)
            seconds.append(one.seconds)
        n_true, n_found = (sum(total[f"{word} {name}"] for name in _KINDS) for word in ("true", "found"))
        yield (
            f"\n{level:g} mm, {parts} parts ({only}): "
            f"segments right {total['right'] / total['n']:.3f} of {total['n']} ("
            + ", ".join(
                f"{kind} {total[f'right {kind}'] / max(total[f'n {kind}'], 1):.3f}"
                for kind in ("extruded", "revolved")
            )
            + f"), loops right {total['loops right'] / total['loops']:.3f} of {total['loops']}"
        )
        false = total["false"] / max(total["holding"], 1)
        yield f"relations right {n_found / max(n_true, 1):.3f} of {n_true};"
        yield f"false {false:.2%} of {total['holding']}"
        yield ", ".join(
            f"{name} {total[f'found {name}']} of {total[f'true {name}']}"
            for name in _KINDS
            if total[f"true {name}"]
        )
        yield f"CPU s a part for profiles: mean {np.mean(seconds):.2f}, most {max(seconds):.2f}\n"
