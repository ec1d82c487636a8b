# SPDX-License-Identifier: MIT
"""Targets of further scans: surface of what a check left open, and what no scan will settle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from completion.asbuilt.findings import SAMPLE_REASONS, SAMPLE_STATES, DesignCheck, ElementFinding, FaceFinding
from nbv.inspection.obstacles import Obstacles
from nbv.run.wording import count
from nbv.visibility.requirement import SightLimits
from nbv.visibility.samples import SurfaceSamples
from nbv.visibility.visibility import visible_from_positions
from scenes.checks import BoolArray, FloatArray

OPEN = ("undecided", "hidden", "not seen")
"""Verdicts that further scans may change."""
TESTED_M2, TESTED_BEAMS, TESTED_SUPPORT = 0.05, 50, 0.3
"""Area, beams and support from which the check tests a face."""
_QUANTILE = 1.96  # of intervals of 95 %
_SAME_PLANE_M, _SAME_WAY = 0.03, 0.98  # from a face to its samples, and cosine of their normals
_MEASURED, _NOT_MET = SAMPLE_STATES.index("measured"), SAMPLE_REASONS.index("not met")


@dataclass(frozen=True, slots=True, eq=False)
class Left:
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
    owner : (f,) int
        Which of the elements each face belongs to.
    area_m2, beams : (f,) float
        What was measured of each face and counts with what is added to it.
    n_needed : (k,) int
        How many faces of each element are to be tested.
    left : tuple of Left
        Elements that no scan will settle.
    """

    elements: tuple[ElementFinding, ...]
    samples: SurfaceSamples
    face: NDArray[np.int64]
    owner: NDArray[np.int64]
    area_m2: FloatArray
    beams: FloatArray
    n_needed: NDArray[np.int64]
    left: tuple[Left, ...]

    @classmethod
    def of(cls, check: DesignCheck, obstacles: Obstacles, limits: SightLimits) -> Targets:
        """Return the targets of a check.

        An element that nobody measured needs one main face with enough area and beams for a test. One whose
        interval holds the tolerance needs another scan of that face, if that makes the interval narrow
        enough: its variance is taken to fall with the number of scans that measured the face.
        """
        elements, left, wanted = list[ElementFinding](), list[Left](), list[list[_Face]]()
        for element in check.elements:
            if element.verdict not in OPEN:
                continue
            faces = _open_faces(check, element, obstacles, limits)
            if isinstance(faces, str):
                left.append(Left(element, faces))
            else:
                elements.append(element)
                wanted.append(faces)
        flat = [face for faces in wanted for face in faces]
        counts = [len(faces) for faces in wanted]
        rows = np.concatenate([np.zeros(0, np.int64), *(face.rows for face in flat)])
        return cls(
            tuple(elements),
            samples_at(check, rows),
            np.repeat(np.arange(len(flat)), [len(face.rows) for face in flat]),
            np.repeat(np.arange(len(counts)), counts),
            np.array([face.area_m2 for face in flat], np.float64),
            np.array([face.beams for face in flat], np.float64),
            np.array([sum(face.is_doubtful for face in faces) or 1 for faces in wanted], np.int64),
            tuple(left),
        )


@dataclass(frozen=True, slots=True, eq=False)
class _Face:
    """Rows of `check.samples` on a face, what counts of its measurement, and whether its interval holds T."""

    rows: NDArray[np.int64]
    area_m2: float = 0.0
    beams: float = 0.0
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
    check: DesignCheck, element: ElementFinding, obstacles: Obstacles, limits: SightLimits
) -> list[_Face] | str:
    """Return the faces of an element that are to be looked at, or why there are none."""
    held, mine = check.samples, np.flatnonzero(check.samples.element == element.surface)
    open_ = mine[(held.state[mine] != _MEASURED) & (held.reason[mine] != _NOT_MET)]
    mains = [face for face in element.faces if face.is_main]
    tested = [face for face in mains if face.is_tested and face.deviation is not None]
    if element.verdict == "undecided":
        doubtful = [face for face in tested if not _decides(face, element.tolerance_m, check.z)]
        if doubtful:
            return _doubtful_faces(check, element, doubtful, obstacles, limits)
    untested = [face for face in mains if not face.is_tested] or mains
    found = list[_Face]()
    for face in untested:
        rows = open_[_lies_on(check, open_, face)]
        counts = face.support >= TESTED_SUPPORT and not face.is_tested
        if len(rows):
            had = (face.measured_m2, float(face.n_beams)) if counts else (0.0, 0.0)
            found.append(_Face(rows, *had))
    if not mains and len(open_):
        found = [_Face(open_)]
    if found:
        return found
    passed = float(held.area_m2[mine[held.reason[mine] == _NOT_MET]].sum())
    if passed > 0:
        return f"beams passed {passed:.2f} m2 of it and met nothing there: another scan would do the same"
    return "its main faces are measured, and more scans of them add nothing"


def _doubtful_faces(
    check: DesignCheck,
    element: ElementFinding,
    doubtful: list[FaceFinding],
    obstacles: Obstacles,
    limits: SightLimits,
) -> list[_Face] | str:
    """Return the faces whose intervals hold the tolerance, or why another scan does not change that."""
    mine = np.flatnonzero(check.samples.element == element.surface)
    eyes = np.array([pose.translation for pose in check.alignment.poses]).reshape(-1, 3)
    found = list[_Face]()
    for face in doubtful:
        rows = mine[_lies_on(check, mine, face)]
        seen = visible_from_positions(obstacles.caster, eyes, samples_at(check, rows), limits)
        n_scans = max(int((np.diff(seen.indptr) > 0).sum()), 1)
        shrink = float(np.sqrt(n_scans / (n_scans + 1)))
        if not _decides(face, element.tolerance_m, check.z, shrink):
            off, half = _off_and_half(face)
            return (
                f"it is {1e3 * off:.1f} mm off its place, {1e3 * abs(off - element.tolerance_m):.1f} mm from "
                f"its tolerance, and another scan after {count(n_scans, 'scan')} leaves "
                f"+-{1e3 * half * shrink:.1f} mm: do not scan it again for this"
            )
        if len(rows):
            found.append(_Face(rows, is_doubtful=True))
    return found or "no exposed sample lies on the face that decides"


def _off_and_half(face: FaceFinding) -> tuple[float, float]:
    """Distance of a tested face from its place, and half its 95 % interval, metres."""
    assert face.deviation is not None
    return abs(face.deviation.value), (face.deviation.high - face.deviation.low) / 2


def _decides(face: FaceFinding, tolerance_m: float, z: float, shrink: float = 1.0) -> bool:
    """Whether a face with an interval `shrink` times as wide is within the tolerance, or deviates."""
    off, half = _off_and_half(face)
    half *= shrink
    return off + half <= tolerance_m or off - half * z / _QUANTILE > tolerance_m


def _lies_on(check: DesignCheck, rows: NDArray[np.int64], face: FaceFinding) -> BoolArray:
    """Tell which of a check's samples, rows (n,) of its element, lie on a face; of a cylinder all do."""
    if face.kind == "cylinder":
        return np.ones(len(rows), np.bool_)
    off = (check.samples.points[rows] - face.centre) @ face.normal
    alike = check.samples.normals[rows] @ face.normal >= _SAME_WAY
    return np.asarray(alike & (np.abs(off) <= _SAME_PLANE_M))
