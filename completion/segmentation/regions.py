# SPDX-License-Identifier: MIT
"""Regions: connected parts of a labelled scan, each on one surface, and the options of finding them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from completion.fitting.result import SurfaceFit
from completion.observe.observation import Observation, PixelSet
from completion.observe.packed_surfaces import unpack
from completion.observe.rays import Rays, plus, ray_at
from completion.observe.tolerance import FLATNESS_M
from scenes.checks import FloatArray, Value, check_options
from scenes.surfaces.catalogue import Cylinder, Surface
from texture.engine.compiled import compiled, inlined


@dataclass(frozen=True, kw_only=True, slots=True)
class SegmentationOptions(Value):
    """How a range image is cut into regions.

    Attributes
    ----------
    n_sigma : float
        A pixel belongs to a surface within this many standard deviations.
    flatness_m : float, optional
        How far a real surface may differ from its ideal form, beside the noise, metres; in all stages,
        unless `EvidenceOptions.flatness_m` says otherwise. When None, it is read off the scans, and pieces
        that an uneven surface broke into are joined by how uneven they are (`segmentation.relief`).
    max_angle_deg : float
        Largest angle between a tile's normal and the surface's, beside the normal's error.
    min_pixels : int
        Smaller regions are left unsegmented.
    min_arc_deg : float
        A cylinder seen over less of an arc is kept as the plane that it hardly differs from.
    max_regions : int
        Stop after so many regions.
    """

    n_sigma: float = 3.0
    flatness_m: float | None = None
    max_angle_deg: float = 25.0
    min_pixels: int = 80
    min_arc_deg: float = 20.0
    max_regions: int = 150

    def __post_init__(self) -> None:
        check_options(
            self,
            n_sigma=(0.0, np.inf),
            flatness_m=(0.0, np.inf),
            max_angle_deg=(0.0, 90.0),
            min_pixels=(3, np.inf),
            min_arc_deg=(0.0, 360.0),
            max_regions=(0, np.inf),
        )

    @property
    def least_flatness_m(self) -> float:
        """Unevenness that any surface may have, before its own is known, metres."""
        return FLATNESS_M if self.flatness_m is None else self.flatness_m


@dataclass(frozen=True, slots=True, eq=False)
class Region(Value):
    """A connected part of a scan that lies on one surface."""

    fit: SurfaceFit  # its surface, in the working frame
    pixels: PixelSet
    relief_m: float = 0.0  # how far it strays from it, rms beyond noise and sensor, metres

    @property
    def n_pixels(self) -> int:
        """How many pixels it has."""
        return len(self.pixels)


def observed_arc(cylinder: Cylinder, points: FloatArray) -> float:
    """Return the angle in radians that points (n, 3) cover around the axis: a turn less the largest gap."""
    angle = np.sort(cylinder.to_uv(points)[:, 0] / cylinder.radius)
    if len(angle) < 2:
        return 0.0
    gaps = np.diff(np.append(angle, angle[0] + 2 * np.pi))
    return float(2 * np.pi - gaps.max())


def split_parts(
    labels: NDArray[np.int32], models: FloatArray, observation: Observation, options: SegmentationOptions
) -> tuple[NDArray[np.int32], list[Surface]]:
    """Number the connected parts that are large enough and nowhere only a seam, and find each one's surface.

    Labels (rows, columns) number the packed surfaces `models` (m, 9) from 1; 0 for none. Returned are the
    part of each pixel (rows, columns), from 1, largest first, and the surface of each part, working frame.
    """
    parts, n_parts = number_parts(labels)
    count, core, model, centre = _part_sums(
        parts, labels, observation.rays, observation.scan.ranges, n_parts + 1
    )
    kept = (count >= options.min_pixels) & (core > 0)
    kept[0] = False
    order = np.flatnonzero(kept)
    order = order[np.argsort(-count[order], kind="stable")][: options.max_regions]
    number = np.zeros(len(count), np.int32)
    number[order] = np.arange(1, len(order) + 1)
    surfaces = [unpack(models[model[part] - 1], centre[part], observation.scan.origin) for part in order]
    return np.take(number, parts), surfaces


@inlined
def _root(parent: NDArray[np.int32], number: int) -> int:
    """The root of a number's tree; its branch is halved on the way."""
    while parent[number] != number:
        parent[number] = parent[parent[number]]
        number = parent[number]
    return number


@compiled
def number_parts(labels: NDArray[np.int32]) -> tuple[NDArray[np.int32], int]:
    """The parts (rows, columns) of equal label that touch along sides, numbered in reading order from 1.

    Returns also how many there are; unlabelled pixels, 0, are in none. Provisional numbers in one pass,
    those of one part joined in a forest, each root its least number (Rosenfeld & Pfaltz 1966).
    """
    rows, columns = labels.shape
    parts = np.zeros((rows, columns), np.int32)
    parent = np.zeros(rows * columns + 1, np.int32)
    n = 0
    for i in range(rows):
        for j in range(columns):
            label = labels[i, j]
            if label == 0:
                continue
            left = parts[i, j - 1] if j > 0 and labels[i, j - 1] == label else 0
            above = parts[i - 1, j] if i > 0 and labels[i - 1, j] == label else 0
            if left == 0 and above == 0:
                n += 1
                parent[n] = n
                parts[i, j] = n
            elif left == 0 or above == 0 or left == above:
                parts[i, j] = max(left, above)
            else:
                left, above = _root(parent, left), _root(parent, above)
                parts[i, j] = min(left, above)
                parent[max(left, above)] = parts[i, j]
    n_parts = 0
    for k in range(1, n + 1):  # a parent is never greater than its child
        if parent[k] == k:
            n_parts += 1
            parent[k] = n_parts
        else:
            parent[k] = parent[parent[k]]
    for i in range(rows):
        for j in range(columns):
            parts[i, j] = parent[parts[i, j]]
    return parts, n_parts


@compiled
def _part_sums(
    parts: NDArray[np.int32], labels: NDArray[np.int32], rays: Rays, ranges: FloatArray, n: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], FloatArray]:
    """Of each part: pixels, whether a pixel has it all around, its label, and the mean of every 8th point."""
    count, core = np.zeros(n, np.int64), np.zeros(n, np.int64)
    model, sampled, centre = np.zeros(n, np.int64), np.zeros(n, np.int64), np.zeros((n, 3))
    rows, columns = parts.shape
    for i in range(rows):
        for j in range(columns):
            part = parts[i, j]
            if part == 0:
                continue
            count[part] += 1
            if count[part] & 7 == 1:
                model[part] = labels[i, j]
                place = plus(rays.origin, ranges[i, j], ray_at(rays, i, j))
                for axis in range(3):
                    centre[part, axis] += place[axis]
                sampled[part] += 1
            if core[part] == 0 and 0 < i < rows - 1 and 0 < j < columns - 1:
                whole = True
                for k in range(i - 1, i + 2):
                    if parts[k, j - 1] != part or parts[k, j] != part or parts[k, j + 1] != part:
                        whole = False
                        break
                core[part] += whole
    for part in range(n):
        centre[part] /= max(sampled[part], 1)
    return count, core, model, centre


class Groups:
    """Parts 0 to n - 1 in groups, at first each in its own; a group keeps the number that it is joined to."""

    def __init__(self, n: int) -> None:
        self._number = list(range(n))
        self._members = {part: [part] for part in range(n)}

    def of(self, part: int) -> list[int]:
        """The parts in the group of a part, ascending."""
        return self._members[self._number[part]]

    def are_one(self, first: int, second: int) -> bool:
        """Tell whether two parts are in one group."""
        return self._number[first] == self._number[second]

    def join(self, first: int, second: int) -> None:
        """Put the group of the other part into that of the one."""
        here, there = self._number[first], self._number[second]
        moved = self._members.pop(there)
        for part in moved:
            self._number[part] = here
        self._members[here] = sorted(self._members[here] + moved)

    def all(self) -> list[list[int]]:
        """The parts of each group, ascending, by the groups' numbers."""
        return [self._members[number] for number in sorted(self._members)]
