# SPDX-License-Identifier: MIT
"""Drop-out: echoes that are too weak, too oblique, or mirrored away."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scenes.checks import BoolArray, FloatArray, check_options


@dataclass(frozen=True, slots=True, kw_only=True)
class Dropout:
    """Which echoes are lost.

    A glossy surface sends a beam that meets it at incidence theta into the direction 2 theta off the way
    back. With probability `specular_loss` (1 - max(0, cos 2 theta)^`specular_exponent`) nothing comes back:
    never when the surface faces the sensor, with `specular_loss` when it is turned by 45 deg or more. The
    exponent is that of Phong's lobe.

    Parameters
    ----------
    min_intensity : float
        Weaker echoes are lost; see `nbv.scanning.effects.intensity` for the scale.
    max_incidence_deg : float
        Echoes at larger incidence are lost, degrees.
    specular_loss : float
        Share of echoes that glossiness may cost, 0..1.
    specular_exponent : float
        How narrow the mirror's lobe is.

    Raises
    ------
    InputError
        Values outside these bounds.
    """

    min_intensity: float = 0.0
    max_incidence_deg: float = 90.0
    specular_loss: float = 0.0
    specular_exponent: float = 20.0

    def __post_init__(self) -> None:
        check_options(self, min_intensity=(0.0, np.inf), max_incidence_deg=(0.0, 90.0))
        check_options(self, specular_loss=(0.0, 1.0), specular_exponent=(0.0, np.inf))

    def kept(
        self, intensity: NDArray[np.float32], incidence: FloatArray, rng: np.random.Generator
    ) -> BoolArray:
        """Tell which echoes are kept; `incidence` in radians, one uniform number drawn for every pixel."""
        with np.errstate(invalid="ignore"):
            kept = (intensity >= self.min_intensity) & ~(incidence > np.radians(self.max_incidence_deg))
            if self.specular_loss > 0:
                lobe = np.maximum(np.cos(2 * incidence), 0.0) ** self.specular_exponent
                kept &= ~(rng.random(incidence.shape) < self.specular_loss * (1 - lobe))
        return np.asarray(kept, dtype=np.bool_)
