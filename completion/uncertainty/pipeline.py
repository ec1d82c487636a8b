# SPDX-License-Identifier: MIT
"""Uncertainty on one page: from a surface's fit to a covariance that holds, and what sensors share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from completion.fitting.result import SurfaceFit
from completion.merging.merged_surface import MergedSurface
from completion.observe.observation import Observation
from completion.uncertainty.residual_modes import N_SHAPES, ResidualModes, find_modes, pooled_bend
from completion.uncertainty.sensor_errors import shift_by_sensors
from scenes.checks import FloatArray

_LEAST_PIXELS = 1_500  # of a surface in a scan, from which on it tells anything of smooth errors
_MOST_SCANS = 16  # of a surface, those that measured most of it, which tell its bend
_GAIN = 8.0
"""How many times as much of a smooth error lies in offset and tilt as in each shape of second order.

With it true right angles and parallels of twenty rooms are rejected at 5 % in .02 to .04 of the cases before
five sensors, of twenty other rooms in .00 to .05 (`python -m benchmarks.completion.relations calibration`).
"""
_FREEDOM = 6.0  # that the scan's bend counts for beside the three of a surface's own (Smyth 2004)


@dataclass(frozen=True, slots=True, eq=False)
class StatedFit:
    """A surface's fit, and how well it is known.

    Attributes
    ----------
    fit : SurfaceFit
        Its covariance holds the noise, and smooth errors that are the surface's own.
    freedom : float
        Degrees of freedom that the scale of that is known with; inf where errors are independent.
    shared : (k, m) float
        What errors of the sensors, which all surfaces share, do to its parameters; one deviation of each.
    """

    fit: SurfaceFit
    freedom: float
    shared: FloatArray

    @property
    def total(self) -> SurfaceFit:
        """The fit with the covariance of all errors."""
        return replace(self.fit, covariance=self.fit.covariance + self.shared @ self.shared.T)


def state_fits(
    surfaces: Sequence[MergedSurface], observations: Sequence[Observation], flatness_m: float
) -> list[StatedFit]:
    """Return the fits of surfaces with covariances that hold where neighbouring pixels err alike.

    To the variance of a fit's parameters, which knows errors as long as blocks of pixels, those are added
    that are as long as the surface and leave only residual modes: as large as in its scan, pooled over all
    surfaces, moderated by its own. Variances are pooled after Smyth (2004), Linear models and empirical Bayes
    methods; the share of a variance that was estimated gives its degrees of freedom (Satterthwaite 1946).
    Where the relief of an uneven surface says more than that, it stays as it is.

    Parameters
    ----------
    surfaces : sequence of MergedSurface
        Planes and cylinders, working frame.
    observations : sequence of Observation
        The scans.
    flatness_m : float
        How far surfaces stray from their ideal form, metres.
    """
    # 1. Modes: what each surface's residuals say of smooth errors, in the scans that saw most of it.
    modes = [_modes_of(one, observations, flatness_m) for one in surfaces]

    # 2. Pool: the bend of each scan, by those of its surfaces that are large enough to tell.
    telling = [{scan: one for scan, one in own.items() if one.n >= _LEAST_PIXELS} for own in modes]
    scans = sorted({scan for own in telling for scan in own})
    bends = {scan: pooled_bend([own[scan] for own in telling if scan in own]) for scan in scans}

    # 3. State: the covariance of each surface, by its own modes and those of its scans; and what the sensors'
    #    systematic errors, which leave no residual, do to it.
    return [
        StatedFit(*_with_smooth(one, own, bends), shared=shift_by_sensors(one, observations))
        for one, own in zip(surfaces, modes, strict=True)
    ]


def _modes_of(
    surface: MergedSurface, observations: Sequence[Observation], flatness_m: float
) -> dict[int, ResidualModes]:
    """By scan, those of a surface in the scans that measured most of it."""
    largest = sorted(surface.pixels.held, key=lambda pair: (-len(pair[1]), pair[0]))[:_MOST_SCANS]
    found = {
        scan: find_modes(surface.fit, observations[scan], held.flat, flatness_m) for scan, held in largest
    }
    return {scan: own for scan, own in sorted(found.items()) if own is not None}


def _with_smooth(
    surface: MergedSurface, modes: dict[int, ResidualModes], bends: dict[int, float]
) -> tuple[SurfaceFit, float]:
    """The fit of a surface with what its smooth errors add, each scan's by the weight of its pixels.

    And the degrees of freedom of that.
    """
    fit = surface.fit
    seen = sum(one.n for one in modes.values())
    if not seen:
        return fit, np.inf
    typical = float(np.mean(list(bends.values()))) if bends else 0.0
    information = np.sum([one.information for one in modes.values()], axis=0)
    alike = np.sum(
        [
            one.information * _GAIN * one.n * _moderated(one, bends.get(scan, typical))
            for scan, one in modes.items()
        ],
        axis=0,
    )
    inverse = np.linalg.pinv(information, rcond=1e-14, hermitian=True) * (seen / surface.n_pixels)
    smooth = inverse @ alike @ inverse * (surface.n_pixels / seen)
    relief = float(np.sum(information * fit.covariance))  # of each a trace, in independent deviations
    share, independent = float(np.sum(information * smooth)), len(information) * fit.inflation
    if relief >= share + independent or share <= 0:
        return fit, np.inf
    freedom = (_FREEDOM + N_SHAPES) * ((share + independent) / share) ** 2
    return replace(fit, covariance=inverse * fit.inflation + smooth), freedom


def _moderated(one: ResidualModes, bend: float) -> float:
    """The bend of a surface: that of its scan, and its own where it is large enough to have one."""
    if one.n < _LEAST_PIXELS:
        return bend
    return (_FREEDOM * bend + N_SHAPES * max(one.bend, 0.0)) / (_FREEDOM + N_SHAPES)
