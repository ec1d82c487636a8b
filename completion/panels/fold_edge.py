# SPDX-License-Identifier: MIT
"""Fold edges and corners as results: where they are, how well that is known, and what is measured of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from completion.extension.patch import Provenance
from completion.panels.corner import Corner
from completion.panels.fold import Fold
from completion.panels.sheet import Sheet
from scenes.checks import FloatArray
from scenes.surfaces.surface import cross

_PAIR = 2  # surfaces of a fold
_BESIDE = 1.5  # cells beside a fold at which a surface was measured up to it


@dataclass(frozen=True, slots=True, eq=False)
class FoldEdge:
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
class CornerPoint:
    """A point in which three surfaces meet: their numbers, the place (3,), its covariance (3, 3)."""

    surfaces: tuple[int, int, int]
    point: FloatArray
    covariance: FloatArray


def fold_edge(fold: Fold, sheets: Sequence[Sheet]) -> FoldEdge:
    """Return what is told of a fold."""
    t = fold.stations()
    points = fold.curve.at(t)
    own = [sheets[number - 1] for number in (fold.first, fold.second)]
    ends = points[[0, -1]]
    fine = np.linspace(fold.start, fold.end, max(2, int((fold.end - fold.start) / fold.cell_m) + 1))
    measured = np.ones(len(fine), np.bool_)
    for sheet, sides in zip(own, fold.sides, strict=True):
        uv, left = sheet.along(fold.curve.at(fine))
        found = np.zeros(len(fine), np.bool_)
        for sign in np.array([1.0, -1.0])[sides]:
            beside = uv + sign * _BESIDE * sheet.cell_m * left
            found |= sheet.provenance_at(beside) == Provenance.MEASURED
        measured &= found
    return FoldEdge(
        surfaces=(fold.first, fold.second),
        goes_on=fold.goes_on,
        points=points,
        covariance=np.stack([meeting_covariance(own, place) for place in ends]),
        dihedral_deg=_dihedral(fold, own),
        length_m=float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum()),
        measured_share=float(measured.mean()),
        normals=np.stack([sheet.surface.normal(points[[len(points) // 2]])[0] for sheet in own]),
    )


def corner_point(corner: Corner, sheets: Sequence[Sheet]) -> CornerPoint:
    """Return what is told of a corner."""
    own = [sheets[number - 1] for number in corner.surfaces]
    return CornerPoint(corner.surfaces, corner.point, meeting_covariance(own, corner.point))


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


def turned(covariance: FloatArray, rotation: FloatArray) -> FloatArray:
    """Return covariances (..., 3, 3) in the axes that a rotation (3, 3) leads to."""
    turn, given = np.ascontiguousarray(rotation), np.ascontiguousarray(covariance)
    half = (turn[:, None, :] * given[..., None, :, :]).sum(axis=-1)
    return np.asarray((half[..., :, None, :] * turn).sum(axis=-1), dtype=np.float64)


def _moves(normals: Sequence[FloatArray]) -> list[FloatArray]:
    """The vectors (3,) that leave one of two or three planes by one, and lie in the others and across."""
    if len(normals) == _PAIR:
        one, other = normals
        cosine = float((one * other).sum())
        return [(a - cosine * b) / (1 - cosine**2) for a, b in ((one, other), (other, one))]
    across = [cross(normals[k - 2], normals[k - 1]) for k in range(3)]
    return [vector / float((vector * normal).sum()) for vector, normal in zip(across, normals, strict=True)]


def _dihedral(fold: Fold, own: Sequence[Sheet]) -> float:
    """Angle of the free space at the middle of a fold, degrees."""
    middle = fold.curve.at(np.array([(fold.start + fold.end) / 2]))
    one, other = (sheet.surface.normal(middle)[0] for sheet in own)
    turn = float(np.degrees(np.arccos(np.clip(one @ other, -1.0, 1.0))))
    sheet, sides = (own[1], fold.sides[1]) if not fold.sides[1].all() else (own[0], fold.sides[0])
    facing = one if sheet is own[1] else other
    t = np.array([(fold.start + fold.end) / 2, (fold.start + fold.end) / 2 + 1e-4])
    uv, left = sheet.along(fold.curve.at(t))
    inside = sheet.surface.from_uv(uv[:1] + (1e-3 if sides[0] else -1e-3) * left[:1])
    return 180.0 - turn if float((inside - middle)[0] @ facing) > 0 else 180.0 + turn
