# SPDX-License-Identifier: MIT
"""Tolerance: how far a range may differ from a surface and agree with it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from completion.observe.user_options import UserOptions
from scenes.checks import FloatArray, Value, check_options

SMALLEST_CELL_M, LARGEST_CELL_M = 1e-4, 1.0
FLATNESS_M = 0.001
"""How far a real surface differs from its ideal form where nothing else is said, metres."""
POSE_BOUND = 2.0
"""Standard deviations within which a pose is taken to be known."""
REGISTRATION_M = UserOptions().registration_m
"""How far the poses of several scans may be off where nothing else is said, metres."""


@dataclass(frozen=True, kw_only=True, slots=True)
class EvidenceOptions(Value):
    """Tolerances along the ray, and how finely places are told apart.

    Attributes
    ----------
    n_sigma : float
        Standard deviations within which a range agrees with the surface.
    flatness_m : float, optional
        How far a real surface may differ from its ideal form, metres. None takes
        `SegmentationOptions.flatness_m`; a number holds for evidence, merging and audit alone.
    registration_m : float, optional
        Error of the poses, metres. None takes the `registration_m` of `CompletionOptions` where there are
        several scans, or that given to `verify`; a number here prevails over both.
    max_tolerance_m : float
        Where the tolerance is larger, only the surface's own pixels make it visible, and no beam is a veto.
    max_cells : int
        In how many cells at most a surface's chart is weighed; of large ones the cells are larger then. A
        cylinder has at least 48 cells around.
    cell_m : float, optional
        Side of a cell, 0.0001 to 1 m. None takes that of the surface's pixels. A surface that would have more
        than 1,000,000 such cells gets larger ones.
    """

    n_sigma: float = 4.0
    flatness_m: float | None = None
    registration_m: float | None = None
    max_tolerance_m: float = 0.1
    max_cells: int = 200_000
    cell_m: float | None = None

    def __post_init__(self) -> None:
        lengths = ("n_sigma", "flatness_m", "registration_m", "max_tolerance_m")
        bounds = dict.fromkeys(lengths, (0.0, np.inf))
        check_options(self, **bounds, max_cells=(1, np.inf), cell_m=(SMALLEST_CELL_M, LARGEST_CELL_M))

    def tolerance(self, *, flatness_m: float = FLATNESS_M, registration_m: float = 0.0) -> Tolerance:
        """Return the tolerance, with these lengths in metres where the options leave them open."""
        return Tolerance(
            n_sigma=self.n_sigma,
            flatness_m=flatness_m if self.flatness_m is None else self.flatness_m,
            registration_m=registration_m if self.registration_m is None else self.registration_m,
            max_m=self.max_tolerance_m,
        )


@dataclass(frozen=True, kw_only=True, slots=True)
class Tolerance(Value):
    """How far a range may differ from a surface and agree with it."""

    n_sigma: float  # standard deviations
    flatness_m: float  # difference of a real surface from its ideal form, metres
    registration_m: float  # error of the poses, metres
    max_m: float  # tolerance above which a range says nothing, metres

    def of_pose(self, error_m: float) -> Tolerance:
        """Return the tolerance of a scan whose pose may be off by at least so much, metres."""
        return self if error_m <= self.registration_m else replace(self, registration_m=error_m)

    def along_ray(self, sigma: FloatArray, sd: FloatArray, cosine: FloatArray) -> FloatArray:
        """Return k sqrt(sigma^2 + (sd^2 + flatness^2) / cos^2) + registration / cos, metres along the ray.

        All (n,): `sigma`, the standard deviation of each range, `sd`, the predicted one of the surface along
        its normal, both in metres, and the cosine of the incidence angle, without sign.
        """
        cosine = np.maximum(cosine, 1e-3)
        across = np.hypot(sd, self.flatness_m) / cosine
        return np.asarray(
            self.n_sigma * np.hypot(sigma, across) + self.registration_m / cosine, dtype=np.float64
        )
