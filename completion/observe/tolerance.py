# SPDX-License-Identifier: MIT
"""Tolerance: how far a range may stray from a surface and agree with it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scenes.checks import FloatArray, check_options


@dataclass(frozen=True, kw_only=True, slots=True)
class EvidenceOptions:
    """Tolerances along the ray, and how finely places are told apart.

    Attributes
    ----------
    n_sigma : float
        Standard deviations within which a range agrees with the surface.
    flatness_m : float
        How far a real surface may stray from its ideal form, metres.
    registration_m : float
        Error of the poses when there are several scans, metres.
    max_tolerance_m : float
        Where the tolerance is larger, only the surface's own pixels make it visible, and no beam is a veto.
    max_cells : int
        In how many cells at most a surface's chart is weighed; of large ones the cells are larger then.
    """

    n_sigma: float = 4.0
    flatness_m: float = 0.001
    registration_m: float = 0.0
    max_tolerance_m: float = 0.1
    max_cells: int = 200_000

    def __post_init__(self) -> None:
        lengths = ("n_sigma", "flatness_m", "registration_m", "max_tolerance_m")
        check_options(self, **dict.fromkeys(lengths, (0.0, np.inf)), max_cells=(1, np.inf))


def ray_tolerance(
    sigma: FloatArray, spread: FloatArray, cosine: FloatArray, options: EvidenceOptions
) -> FloatArray:
    """How far a range may stray from a surface and agree with it, metres along the ray."""
    across = np.hypot(spread, options.flatness_m) / np.maximum(cosine, 1e-3)
    registration = options.registration_m / np.maximum(cosine, 1e-3)
    return np.asarray(options.n_sigma * np.hypot(sigma, across) + registration, dtype=np.float64)
