# SPDX-License-Identifier: MIT
"""Regions: connected parts of a scan that lie on one surface, and the options of finding them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from completion.fitting.result import SurfaceFit
from completion.observe.tolerance import FLATNESS_M
from scenes.checks import BoolArray, FloatArray, check_options
from scenes.surfaces.catalogue import Cylinder


@dataclass(frozen=True, kw_only=True, slots=True)
class SegmentationOptions:
    """How a range image is cut into regions.

    Attributes
    ----------
    n_sigma : float
        A pixel belongs to a surface within this many standard deviations.
    flatness_m : float
        How far a real surface may differ from its ideal form, beside the noise, metres; in all stages,
        unless `EvidenceOptions.flatness_m` says otherwise.
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
    flatness_m: float = FLATNESS_M
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


@dataclass(frozen=True, slots=True, eq=False)
class Region:
    """A connected part of a scan that lies on one surface.

    Attributes
    ----------
    fit : SurfaceFit
        Its surface, in the working frame.
    mask : (rows, columns) bool
        Its pixels.
    """

    fit: SurfaceFit
    mask: BoolArray

    @property
    def n_pixels(self) -> int:
        """How many pixels it has."""
        return int(np.count_nonzero(self.mask))


def observed_arc(cylinder: Cylinder, points: FloatArray) -> float:
    """Return the angle in radians that points (n, 3) cover around the axis: a turn less the largest gap."""
    angle = np.sort(cylinder.to_uv(points)[:, 0] / cylinder.radius)
    if len(angle) < 2:
        return 0.0
    gaps = np.diff(np.append(angle, angle[0] + 2 * np.pi))
    return float(2 * np.pi - gaps.max())
