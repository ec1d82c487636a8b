# SPDX-License-Identifier: MIT
"""Targets of further scans: surface of what a check left open, and what no scan will settle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from completion.asbuilt import limits
from completion.asbuilt.findings import (
    HALF_95,
    SAMPLE_REASONS,
    SAMPLE_STATES,
    DesignCheck,
    ElementFinding,
    FaceFinding,
    Samples,
    rounded,
)
from nbv.inspection.obstacles import Obstacles
from nbv.run.wording import count
from nbv.visibility.requirement import SightLimits
from nbv.visibility.samples import SurfaceSamples
from nbv.visibility.visibility import visible_from_positions
from scenes.checks import BoolArray, FloatArray, Value

OPEN = ("undecided", "hidden", "not seen")
"""Verdicts that further scans may change."""
PROMISED_M2, PROMISED_BEAMS, PROMISED_SHARE = 2 * limits.LEAST_MEASURED_M2, 2 * limits.FEWEST_BEAMS, 0.1
"""Area, beams and share of a main face that a station is to see to settle it: twice what a test takes, since
samples are 10 cm apart, and not a corner alone, from which the deviation of the whole is too uncertain."""
SURE_COSINE, SURE_M = 0.26, 0.3
"""Of incidence (75 degrees), and metres in space that no scan saw of a line of sight to what something hides,
within which a station is sure to measure a sample: behind the front of a thing is its body, as a rule."""
_WIDE = 2.0  # times the median half interval: more area narrows such an interval, not only more scans
_SAME_PLANE_M, _SAME_WAY = 0.03, 0.98  # between samples of a plane, and cosine of their normals
_CURVED = 0.3  # share of an element's area in its main planes, below which all of it is one face
_MEASURED, _HIDDEN, _NOT_MET = (
    SAMPLE_STATES.index("measured"),
    *map(SAMPLE_REASONS.index, ("hidden", "not met")),
)


@dataclass(frozen=True, slots=True, eq=False)
class Left(Value):
    """An element that stays open, and why."""

    element: ElementFinding
    reason: str


@dataclass(frozen=True, slots=True, eq=False)
class Targets:
    """What to look at.

    Attributes
    ----------
    elements : tuple of ElementFinding
        k elements that further scans may settle.
    samples : SurfaceSamples
        Of their main faces, n.
    face : (n,) int
        Number of the face of each.
    is_hidden : (n,) bool
        Which of them something hides that stands there.
    owner : (f,) int
        Which of the elements each face belongs to.
    needed_m2 : (f,) float
        Area of each that a station must see.
    n_needed : (k,) int
        How many faces of each element are to be tested.
    left : tuple of Left
        Elements that no scan will settle.
    """

    elements: tuple[ElementFinding, ...]
    samples: SurfaceSamples
    face: NDArray[np.int64]
    is_hidden: BoolArray
    owner: NDArray[np.int64]
    needed_m2: FloatArray
    n_needed: NDArray[np.int64]
    left: tuple[Left, ...]

    @classmethod
    def of(cls, check: DesignCheck, obstacles: Obstacles, sight: SightLimits) -> Targets:
        """Return the targets of a check.

        An element that nobody measured needs one main face with enough area and beams for a test, and so does
        one whose interval is wide because little of it was measured. One whose interval holds the tolerance
        needs another scan of that face, if that makes the interval narrow enough: its variance is taken to
        fall with the number of scans that measured the face.
        """
        halves = [
            _off_and_half(face)[1]
            for element in check.elements
            for face in element.faces
            if face.is_main and face.is_tested
        ]
        typical = float(np.median(halves)) if halves else np.inf
        elements, left, wanted = list[ElementFinding](), list[Left](), list[list[_Face]]()
        for element in check.elements:
            if element.verdict not in OPEN:
                continue
            faces = _open_faces(check, element, obstacles, sight, _WIDE * typical)
            if isinstance(faces, str):
                left.append(Left(element, faces))
            else:
                elements.append(element)
                wanted.append(faces)
        flat = [face for faces in wanted for face in faces]
        counts = [len(faces) for faces in wanted]
        rows = np.concatenate([np.zeros(0, np.int64), *(face.rows for face in flat)])
        return cls(
            elements=tuple(elements),
            samples=samples_at(check, rows),
            face=np.repeat(np.arange(len(flat)), [len(face.rows) for face in flat]),
            is_hidden=check.samples.reason[rows] == _HIDDEN,
            owner=np.repeat(np.arange(len(counts)), counts),
            needed_m2=np.array([face.needed_m2 for face in flat], np.float64),
            n_needed=np.array([sum(face.is_doubtful for face in faces) or 1 for faces in wanted], np.int64),
            left=tuple(left),
        )


@dataclass(frozen=True, slots=True, eq=False)
class _Face:
    """Rows of `check.samples` on a face, the area that a station must see, and whether its interval holds T.

    All faces of an element whose intervals hold T must be seen again.
    """

    rows: NDArray[np.int64]
    needed_m2: float
    is_doubtful: bool = False


def samples_at(check: DesignCheck, rows: NDArray[np.int64]) -> SurfaceSamples:
    """Return rows (n,) of a check's samples."""
    held = check.samples
    return SurfaceSamples(
        points=held.points[rows].reshape(-1, 3),
        normals=held.normals[rows].reshape(-1, 3),
        areas=held.area_m2[rows],
        face=np.zeros(len(rows), np.int32),
        surface=held.element[rows],
    )


def _open_faces(
    check: DesignCheck, element: ElementFinding, obstacles: Obstacles, sight: SightLimits, wide_m: float
) -> list[_Face] | str:
    """Return the faces of an element that are to be looked at, or why there are none."""
    held, mine = check.samples, np.flatnonzero(check.samples.element == element.surface)
    if element.related_extra:
        return element.sentence  # an open door
    if element.same_as:
        return f"it lies on {element.same_as}, which is looked at"
    mains = [f for f in element.faces if f.is_main and 2 * f.n_beams >= limits.FEWEST_BEAMS]
    sure = [face for face in mains if face.is_tested and _off_and_half(face)[1] <= wide_m]
    if element.verdict == "undecided":
        doubtful = [face for face in sure if not _decides(face, element.tolerance_m, check.z)]
        if doubtful:
            return _doubtful_faces(check, element, doubtful, obstacles, sight)
    planes = _main_planes(held, mine)
    left = [rows for rows in planes if not any(_lie_on(held, rows[:1], face).all() for face in sure)]
    found, passed = list[_Face](), 0.0
    for rows in left or planes:
        own = [face for face in mains if _lie_on(held, rows[:1], face).all()]
        passed += float(held.area_m2[rows[held.reason[rows] == _NOT_MET]].sum())
        passed += sum(face.area_m2 - face.measured_m2 for face in own if face.support < limits.LEAST_SUPPORT)
        area = float(held.area_m2[rows].sum())
        needed = max(PROMISED_M2, PROMISED_SHARE * area, *(f.measured_m2 for f in own if f.is_tested))
        rows = rows[held.reason[rows] != _NOT_MET]
        unseen = rows[held.state[rows] != _MEASURED]
        if left and not len(unseen):  # measured, but too sparsely
            unseen = rows
        is_met = all(face.support >= limits.LEAST_SUPPORT for face in own)
        is_wide = any(face.is_tested for face in own)
        if is_met and held.area_m2[unseen].sum() >= needed:
            found.append(_Face(unseen, needed, is_doubtful=is_wide))
        elif is_wide and element.verdict == "undecided":
            return f"{sum(f.measured_m2 for f in own):.2f} m2 of a face are measured, and too little is left"
    if found:
        return found
    if passed > 0:
        return f"beams passed {passed:.2f} m2 of it and met nothing there: another scan would do the same"
    return "too little of its main faces is left to be measured"


def _main_planes(held: Samples, mine: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Return the samples of an element, rows (n,), by main plane; all of them together of a curved one."""
    left, planes, areas = mine, list[NDArray[np.int64]](), list[float]()
    while len(left):
        alike = held.normals[left] @ held.normals[left[0]] >= _SAME_WAY
        off = (held.points[left] - held.points[left[0]]) @ held.normals[left[0]]
        alike &= np.abs(off) <= _SAME_PLANE_M
        planes.append(left[alike])
        areas.append(float(held.area_m2[left[alike]].sum()))
        left = left[~alike]
    mains = [k for k, area in enumerate(areas) if area >= limits.MAIN_SHARE * max(areas)]
    is_curved = sum(areas[k] for k in mains) < _CURVED * sum(areas)
    return [mine] if is_curved else [planes[k] for k in mains]


def _doubtful_faces(
    check: DesignCheck,
    element: ElementFinding,
    doubtful: list[FaceFinding],
    obstacles: Obstacles,
    sight: SightLimits,
) -> list[_Face] | str:
    """Return the faces whose intervals hold the tolerance, or why another scan does not change that."""
    mine = np.flatnonzero(check.samples.element == element.surface)
    eyes = np.array([pose.translation for pose in check.alignment.poses]).reshape(-1, 3)
    found = list[_Face]()
    for face in doubtful:
        rows = mine[_lie_on(check.samples, mine, face)]
        seen = visible_from_positions(obstacles.caster, eyes, samples_at(check, rows), sight)
        n_scans = max(int((np.diff(seen.indptr) > 0).sum()), 1)
        shrink = float(np.sqrt(n_scans / (n_scans + 1)))
        if not _decides(face, element.tolerance_m, check.z, shrink):
            off, half = _off_and_half(face)
            far, to_limit, left = rounded((off, abs(off - element.tolerance_m), half * shrink), half)
            return (
                f"it is {far} mm off its place, {to_limit} mm from its tolerance, and another scan after "
                f"{count(n_scans, 'scan')} leaves +-{left} mm: do not scan it again for this"
            )
        if len(rows):
            found.append(_Face(rows, PROMISED_M2, is_doubtful=True))
    return found or "no exposed sample lies on the face that decides"


def _off_and_half(face: FaceFinding) -> tuple[float, float]:
    """Distance of a tested face from its place, and half its 95 % interval, metres."""
    if face.deviation is None:
        return np.inf, np.inf
    return abs(face.deviation.value), (face.deviation.high - face.deviation.low) / 2


def _decides(face: FaceFinding, tolerance_m: float, z: float, shrink: float = 1.0) -> bool:
    """Whether a face with an interval `shrink` times as wide is within the tolerance, or deviates."""
    off, half = _off_and_half(face)
    half *= shrink
    return off + half <= tolerance_m or off - half * z / HALF_95 > tolerance_m


def _lie_on(held: Samples, rows: NDArray[np.int64], face: FaceFinding) -> BoolArray:
    """Tell which samples, rows (n,) of one element, lie on a face of it; on a cylinder all do."""
    if face.kind == "cylinder":
        return np.ones(len(rows), np.bool_)
    off = (held.points[rows] - face.centre) @ face.normal
    return np.asarray((held.normals[rows] @ face.normal >= _SAME_WAY) & (np.abs(off) <= _SAME_PLANE_M))
