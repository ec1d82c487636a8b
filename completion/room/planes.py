# SPDX-License-Identifier: MIT
"""Planes as the room sees them: how large each is, where it lies, how well its place and tilt are known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from completion.fitting.result import allow_for_warp
from completion.merging.merged_surface import MergedSurface
from completion.observe.observation import Observation
from completion.room import limits
from scenes.checks import BoolArray, FloatArray, IntArray, Value
from scenes.surfaces.catalogue import Plane

_GOLDEN = (5**0.5 - 1) / 2  # steps by it come nowhere near each other (Weyl 1916)
_N_POINTS = 800  # of a plane that are looked at


@dataclass(frozen=True, slots=True, eq=False)
class RoomPlane(Value):
    """A plane of the room, working frame.

    Attributes
    ----------
    surface : MergedSurface
        The surface; its normal points to the sensor.
    plane : Plane
        Its plane.
    points : (n, 3) float
        A sample of its points, metres.
    middle : (3,) float
        The middle of them.
    area_m2 : float
        Of what was measured of it, by the pixels' solid angles.
    tilt_sd : float
        Standard deviation of its normal, with its warp, radians; at most `limits.WIDEST_DEG`.
    sd_m : float
        Standard deviation of its place along the normal in the middle of its points, metres.
    bias_m : float
        What its points share: the sensor's bias there, and how far real surfaces stray from planes, metres.
    sigma_m : float
        What single points stray by, metres.
    """

    surface: MergedSurface
    plane: Plane
    points: FloatArray
    middle: FloatArray
    area_m2: float
    tilt_sd: float
    sd_m: float
    bias_m: float
    sigma_m: float

    @classmethod
    def of(
        cls, surface: MergedSurface, observations: Sequence[Observation], flatness_m: float
    ) -> RoomPlane | None:
        """Look at a surface; None where it is no plane."""
        plane = surface.fit.surface
        if not isinstance(plane, Plane):
            return None
        area, squares, points, sigmas = 0.0, 0.0, [np.zeros((0, 3))], [np.zeros(0)]
        for seen, pixels in surface.sampled_by(observations, _N_POINTS):
            points.append(seen.points_at(pixels))
            sigmas.append(seen.sigma_at(pixels))
            ranges = seen.scan.ranges.ravel()[pixels]
            cosine = np.abs(seen.rays_at(pixels) @ plane.normal_direction).clip(0.05)
            area += float(((ranges * seen.scan.projection.pixel_angle) ** 2 / cosine).sum())
            squares += float((seen.noise.bias(ranges) ** 2).sum())
        sample = np.concatenate(points)
        if not len(sample):
            return None
        bias = float(np.hypot(np.sqrt(squares / len(sample)), flatness_m))
        slopes = allow_for_warp(surface.fit, sample, bias).covariance[1:, 1:]
        tilt = float(np.sqrt(max(float(np.linalg.eigvalsh(slopes)[-1]), 0.0)))
        middle = sample.mean(axis=0)
        place_sd = surface.fit.standard_deviation(middle[None])[0]
        return cls(
            surface=surface,
            plane=plane,
            points=sample,
            middle=middle,
            area_m2=area * surface.n_pixels / len(sample),
            tilt_sd=min(tilt, float(np.radians(limits.WIDEST_DEG))),
            sd_m=float(np.hypot(place_sd, bias)),
            bias_m=bias,
            sigma_m=float(np.concatenate(sigmas).mean()),
        )

    @property
    def normal(self) -> FloatArray:
        """Unit normal (3,) towards the sensor."""
        return self.plane.normal_direction


Role = Literal["floor", "ceiling", "wall", ""]
LevelRole = Literal["floor", "ceiling", "base", ""]


@dataclass(frozen=True, slots=True, eq=False)
class Beams(Value):
    """Some beams of all scans.

    Attributes
    ----------
    origin, point : (n, 3) float
        From where to where each goes.
    sigma : (n,) float
        What each point strays by, metres.
    apart : (n,) float
        Angle to the next beam of these, radians.
    """

    origin: FloatArray
    point: FloatArray
    sigma: FloatArray
    apart: FloatArray

    @classmethod
    def of(cls, observations: Sequence[Observation], most: int = limits.N_BEAMS) -> Beams:
        """Take those of every so many rows and columns, that there are about `most`."""
        n = sum(int(np.count_nonzero(seen.valid)) for seen in observations)
        step = max(1, round(float(np.sqrt(n / most))))
        pixels = [_every(seen.valid, step) for seen in observations]
        pairs = list(zip(observations, pixels, strict=True))
        origins = [np.broadcast_to(seen.scan.origin, (len(sample), 3)) for seen, sample in pairs]
        points = [seen.points_at(sample) for seen, sample in pairs]
        sigma = [seen.sigma_at(sample) for seen, sample in pairs]
        apart = [np.full(len(sample), step * seen.scan.projection.pixel_angle) for seen, sample in pairs]
        return cls(*(np.concatenate(values) for values in (origins, points, sigma, apart)))

    def only(self, kept: BoolArray) -> Beams:
        """Return those that are kept (n,)."""
        return Beams(self.origin[kept], self.point[kept], self.sigma[kept], self.apart[kept])

    def by_height(self, up: FloatArray, apart_m: float) -> list[Beams]:
        """Return the beams by storeys, lowest first: scanners whose heights no gap parts are in one.

        `up` (3,) is the direction that is up, `apart_m` the least gap, metres.
        """
        eye = self.origin @ up
        heights = np.unique(eye)
        storey = np.searchsorted(heights[1:][np.diff(heights) > apart_m], eye, side="right")
        return [self.only(storey == k) for k in range(int(storey.max(initial=-1)) + 1)]


def _every(valid: BoolArray, step: int) -> IntArray:
    """Valid pixels of every so many rows and columns, flat; by turns in all columns, which are directions."""
    chosen = np.zeros_like(valid)
    for number, row in enumerate(range(step // 2, len(valid), step)):
        chosen[row, int(step * (_GOLDEN * number % 1.0)) :: step] = True
    return np.flatnonzero(chosen & valid)


def level_roles(planes: Sequence[RoomPlane], beams: Beams, up: FloatArray, eye: float) -> list[LevelRole]:
    """Return "floor", "ceiling" or "base" of level planes beyond which hardly anything was measured; else "".

    What is not far below the sensors is a floor where no table is as large, with what is as high; otherwise
    it may be a table, and is the base of what stands on it. `up` (3,) is up in the working frame, `eye` how
    high the scanners stood along it, metres.
    """
    sides = np.array([np.sign(plane.normal @ up) for plane in planes])
    heights = np.array([plane.middle @ up for plane in planes])
    areas = np.array([plane.area_m2 for plane in planes])
    roles: list[LevelRole] = []
    for plane, side, height in zip(planes, sides, heights, strict=True):
        apart = float(side * (eye - height))
        if plane.area_m2 < limits.LEAST_FLOOR_M2 or not _is_outermost(plane, side, beams, up) or apart <= 0:
            roles.append("")
        elif side < 0:
            roles.append("ceiling" if apart > limits.CEILING_ABOVE_M else "")
        else:
            as_high = (sides == side) & (np.abs(heights - height) <= limits.SLAB_M)
            is_wide = areas[as_high].sum() >= limits.WIDE_M2
            roles.append("floor" if apart > limits.FLOOR_BELOW_M or is_wide else "base")
    return roles


def _is_outermost(plane: RoomPlane, side: float, beams: Beams, up: FloatArray) -> bool:
    """Whether hardly any point lies beyond a level plane, which may lean, against its `side`."""
    offset = beams.point - plane.middle
    height = offset @ up
    away = np.linalg.norm(offset - height[:, None] * up, axis=1)
    slack = limits.OFF_LEVEL_M + 3 * np.hypot(beams.sigma, plane.bias_m)
    slack += np.tan(np.radians(limits.LEAN_DEG)) * away
    return bool((side * height < -slack).mean() < limits.BEYOND_FLOOR)
