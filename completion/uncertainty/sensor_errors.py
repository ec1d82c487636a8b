# SPDX-License-Identifier: MIT
"""Systematics: how far a sensor's own errors, alike over its whole image, shift and tilt what is fitted.

What bends or tilts a surface as a whole leaves no residual: it is in the fit, and no fit can tell. How a
sensor bends its image is known by its kind (`completion.observe.sensor_modes`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from completion.merging.merged_surface import MergedSurface
from completion.observe.observation import Observation
from completion.observe.sensor_modes import displacements
from scenes.checks import FloatArray
from scenes.run.mapping import trim

Modes = Callable[[Observation, FloatArray], FloatArray]
"""How far each of m errors moves points (n, 3) that a scan measured: (m, n, 3), metres."""

_N_BEAMS = 2000  # of a surface that tell what its fit takes on


def shift_by_sensors(
    merged: MergedSurface, observations: Sequence[Observation], modes: Modes = displacements
) -> FloatArray:
    """Return what systematic errors do to a surface's fit: (k, m), its parameters' change by each mode.

    Each error is a mode: a displacement of all measured points, as far as one standard deviation takes it.
    What the fit makes of it is by least squares over the surface's own beams, the same mode in all scans.
    """
    size = len(merged.fit.covariance)
    moment, pull = np.zeros((size, size)), np.zeros((size, len(modes(observations[0], np.zeros((0, 3))))))
    for seen, pixels in merged.sampled_by(observations, _N_BEAMS):
        points = seen.points_at(pixels)
        gradient = merged.fit.gradient(points)
        weight = 1.0 / np.maximum(np.square(seen.sigma_at(pixels)), 1e-12)
        along = np.einsum("mij,ij->im", modes(seen, points), merged.fit.surface.normal(points))
        both = gradient.T * weight
        moment += both @ gradient
        pull += both @ along
        trim()
    return np.asarray(np.linalg.pinv(moment, rcond=1e-12, hermitian=True) @ pull)
