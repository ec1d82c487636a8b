# SPDX-License-Identifier: MIT
"""Uncertainty on one page: from fits to covariances that hold, what surfaces share included."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from completion.fitting.result import SurfaceFit
from completion.merging.merged_surface import MergedSurface
from completion.observe.observation import Observation
from completion.uncertainty.image_field import ImageField, fit_field, mean_field
from completion.uncertainty.residual_modes import ResidualModes, find_modes
from completion.uncertainty.sensor_errors import shift_by_sensors
from completion.uncertainty.shared_errors import SharedErrors
from scenes.checks import FloatArray

_LEAST_PIXELS = 1_500  # of a surface in a scan, from which on it tells anything of smooth errors
_MOST_SCANS = 8  # of a surface, those that measured most of it, which tell what smooth errors do to it
_MOST_FIELDS = 32  # scans whose own smooth errors are estimated: those that measured most


@dataclass(frozen=True, slots=True, eq=False)
class StatedFits:
    """How well n surfaces are known, jointly.

    Attributes
    ----------
    fits : tuple of SurfaceFit
        Their covariances hold the noise, and what errors alike in blocks of pixels add.
    smooth : SharedErrors
        Smooth and systematic errors of the scans, which surfaces share.
    freedom : tuple of float
        Degrees of freedom (n,) that the scale of each covariance is known with; inf where errors are
        independent.
    """

    fits: tuple[SurfaceFit, ...]
    smooth: SharedErrors
    freedom: tuple[float, ...]

    def total(self, number: int) -> SurfaceFit:
        """Return a surface's fit with the covariance of all errors."""
        fit = self.fits[number]
        return replace(fit, covariance=fit.covariance + self.smooth.covariance_of([number]))


def state_fits(
    surfaces: Sequence[MergedSurface], observations: Sequence[Observation], flatness_m: float
) -> StatedFits:
    """Return how well surfaces are known, where neighbouring pixels err alike.

    To the variance of each fit, which knows errors as long as blocks of pixels, those are added that are as
    long as the surface or longer. They come of a smooth random field over each scan's image, as large and as
    long as residuals beyond the fits show it, and of the sensors' systematic errors, which leave no residual.
    Both move neighbouring surfaces alike. The share of a variance that was estimated gives its degrees of
    freedom (Satterthwaite 1946).

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

    # 2. Fields: the smooth errors of each scan, by all its surfaces.
    fields = _fields_of(modes)
    typical = mean_field(list(fields.values()))

    # 3. Spread: what these do to each surface, scan by scan, so that surfaces of a scan share them.
    sizes = tuple(len(one.fit.covariance) for one in surfaces)
    shifts = []
    for scan in sorted({scan for own in modes for scan in own}):
        field = fields.get(scan, typical)
        shifts.append({k: _shift(own, scan, field) for k, own in enumerate(modes) if scan in own})
    estimated = SharedErrors(sizes, tuple(shifts))

    # 4. Systematic errors of the sensors, which leave no residual.
    by_sensors = {k: shift_by_sensors(one, observations) for k, one in enumerate(surfaces)}

    freedom = [
        _freedom(one.fit, estimated.covariance_of([k]), [fields.get(scan, typical) for scan in modes[k]])
        for k, one in enumerate(surfaces)
    ]
    smooth = SharedErrors(sizes, (*shifts, by_sensors))
    return StatedFits(tuple(one.fit for one in surfaces), smooth, tuple(freedom))


def _modes_of(
    surface: MergedSurface, observations: Sequence[Observation], flatness_m: float
) -> dict[int, ResidualModes]:
    """By scan, those of a surface in the scans that measured most of it."""
    largest = sorted(surface.pixels.held, key=lambda pair: (-len(pair[1]), pair[0]))[:_MOST_SCANS]
    found = {
        scan: find_modes(surface.fit, observations[scan], held.flat, flatness_m) for scan, held in largest
    }
    return {scan: own for scan, own in sorted(found.items()) if own is not None}


def _fields_of(modes: Sequence[dict[int, ResidualModes]]) -> dict[int, ImageField]:
    """The field of each scan, by its surfaces that are large enough to tell; of those that measured most."""
    telling: dict[int, list[ResidualModes]] = {}
    for own in modes:
        for scan, one in own.items():
            if one.n >= _LEAST_PIXELS:
                telling.setdefault(scan, []).append(one)
    size = {scan: sum(one.n for one in some) for scan, some in telling.items()}
    chosen = sorted(telling, key=lambda scan: (-size[scan], scan))[:_MOST_FIELDS]
    return {scan: fit_field(telling[scan]) for scan in sorted(chosen)}


def _shift(modes: dict[int, ResidualModes], scan: int, field: ImageField) -> FloatArray:
    """What the field of a scan does to a surface's parameters (k, b), which other scans hold as well."""
    information = np.sum([one.information for one in modes.values()], axis=0)
    return np.asarray(np.linalg.pinv(information, rcond=1e-14, hermitian=True) @ field.shifts(modes[scan]))


def _freedom(fit: SurfaceFit, smooth: FloatArray, fields: Sequence[ImageField]) -> float:
    """Degrees of freedom of a covariance, of which the `smooth` part was estimated."""
    share = np.linalg.lstsq(fit.covariance + smooth, smooth, rcond=None)[0]
    part = float(np.trace(share)) / len(share)
    if not fields or part <= 0:
        return np.inf
    return float(min(one.freedom for one in fields)) / part**2
