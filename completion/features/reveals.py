# SPDX-License-Identifier: MIT
"""Reveals: the faces of found openings that lead from the wall into it, each where its side was seen."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from completion.edits.fitted import KnownFace
from completion.features.engine.template import Status, TemplateFit
from completion.fitting.result import SurfaceFit
from completion.merging.merged_surface import MergedSurface
from completion.observe.observation import Observation, PixelSet, ScanPixels
from scenes.checks import BoolArray, FloatArray
from scenes.run.mapping import trim
from scenes.surfaces.catalogue import Plane

AROUND = ("bottom", "right", "top", "left")
"""Sides of an opening from each of its corners to the next."""

_LEAST_DEPTH_M = 0.02  # a sheet has no reveals
_ON_FACE = 3.0  # standard deviations
_TILT = float(np.radians(5.0))
_MOST_POINTS = 5000  # of a surface that may be the face already
_FEWEST = 10  # of them on it


def reveals_of(
    features: Sequence[TemplateFit],
    surfaces: Sequence[MergedSurface],
    observations: Sequence[Observation],
    owners: Sequence[NDArray[np.int32]],
    flatness_m: float,
) -> list[KnownFace]:
    """Return the reveals of found openings, side by side.

    The side of an opening gives the place of its reveal, the depth how far that goes. Where a side was not
    seen, or the depth is not known, nothing is. A doorway's foot is the floor. Reveals that are surfaces of
    their own already are left out: they are continued as such.

    Parameters
    ----------
    features : sequence of TemplateFit
        With the surface that each lies in.
    surfaces : sequence of MergedSurface
        All n, working frame.
    observations : sequence of Observation
        The scans.
    owners : sequence of (rows, columns) int
        Number, from 1, of the surface that each pixel is of; 0 for none.
    flatness_m : float
        By how much surfaces may stray from planes, metres.
    """
    outlines = [
        outline
        for number, fit in enumerate(features, start=1)
        if fit.status is Status.FOUND
        for outline in _outlines(fit, number, surfaces)
        if not any(_is_on(outline, one, observations, flatness_m) for one in surfaces)
    ]
    pixels: list[list[PixelSet]] = [[] for _ in outlines]
    for seen, owner in zip(observations, owners, strict=True) if outlines else ():
        free = np.flatnonzero(seen.valid.ravel() & (owner.ravel() == 0)).astype(np.int32)
        points, sigma = seen.points_at(free), seen.sigma_at(free)
        for held, outline in zip(pixels, outlines, strict=True):
            on = outline.holds(points, _ON_FACE * np.hypot(sigma, outline.deviation))
            held.append(PixelSet(free[on], owner.shape))
            free, points, sigma = free[~on], points[~on], sigma[~on]
        trim()
    return [
        outline.face(ScanPixels.of(held), observations)
        for held, outline in zip(pixels, outlines, strict=True)
    ]


@dataclass(frozen=True, slots=True, eq=False)
class _Outline:
    """Where a reveal lies: its plane, from one corner of the opening along a side and into the wall."""

    plane: Plane
    size: FloatArray  # (2,) metres
    deviation: float  # of the side across itself, metres
    feature: int

    def holds(self, points: FloatArray, allowed: FloatArray | float) -> BoolArray:
        """Whether points (n, 3) lie on it, to an allowed distance (n,), metres; none on its rim."""
        uv = self.plane.to_uv(points)
        inside = ((uv > self.deviation) & (uv < self.size - self.deviation)).all(axis=1)
        return np.asarray(inside & (np.abs(self.plane.distance(points)) <= allowed))

    def face(self, pixels: ScanPixels, observations: Sequence[Observation]) -> KnownFace:
        """Return it with what was measured of it."""
        tilts = 2 * self.deviation / self.size
        covariance = np.diag(np.square([self.deviation, *tilts]))
        middle = Plane(self.plane.from_uv(self.size / 2), self.plane.normal_direction, self.plane.u_direction)
        bare = MergedSurface(SurfaceFit(middle, 0.0, covariance, pixels.n_pixels), pixels, 1)
        off = self.plane.distance(bare.points(observations))
        rms = float(np.sqrt(np.mean(np.square(off)))) if len(off) else self.deviation
        fit = SurfaceFit(middle, rms, covariance, pixels.n_pixels)
        return KnownFace(MergedSurface(fit, pixels, 1), self.size, self.feature)


def _outlines(fit: TemplateFit, number: int, surfaces: Sequence[MergedSurface]) -> Iterator[_Outline]:
    """The reveals of one opening whose sides were seen."""
    depth = float(str(fit.geometry.get("depth_m", np.nan)))
    off = float(str(fit.geometry.get("depth_sd_m", 0.0)))
    if not (np.isfinite(depth) and np.isfinite(off)) or depth < max(_LEAST_DEPTH_M, _ON_FACE * off):
        return
    wall = surfaces[int(str(fit.geometry["surface"])) - 1].fit.surface
    if not isinstance(wall, Plane):
        return
    into = np.asarray(fit.geometry.get("into", -wall.normal_direction), dtype=np.float64)
    corners = np.asarray(fit.geometry["corners"], dtype=np.float64)
    sides = {side.name: side for side in fit.sides}
    for name, start, end in zip(AROUND, corners, np.roll(corners, -1, axis=0), strict=True):
        is_floor = name == "bottom" and fit.kind == "doorway"
        if not sides[name].is_seen or is_floor or not np.isfinite(sides[name].deviation):
            continue
        along = end - start
        length = float(np.linalg.norm(along))
        plane = Plane(start, np.cross(along, into), along)
        yield _Outline(plane, np.array([length, depth]), float(sides[name].deviation), number)


def _is_on(
    outline: _Outline, surface: MergedSurface, observations: Sequence[Observation], flatness_m: float
) -> bool:
    """Whether a surface is the face: parallel to it, and measured on it."""
    plane = surface.fit.surface
    if not isinstance(plane, Plane):
        return False
    if float(plane.normal_direction @ outline.plane.normal_direction) < np.cos(_TILT):
        return False
    middle = outline.plane.from_uv(outline.size / 2)
    allowed = _ON_FACE * float(np.hypot(np.hypot(surface.fit.rms, outline.deviation), flatness_m))
    if abs(float(plane.distance(middle[None])[0])) > allowed + _TILT * float(outline.size.max()) / 2:
        return False
    points = surface.points(observations, _MOST_POINTS)
    return int(np.count_nonzero(outline.holds(points, allowed))) >= _FEWEST
