# SPDX-License-Identifier: MIT
"""Settled surfaces: those that are known so well that relations can be told of them."""

from __future__ import annotations

import numpy as np

from completion.fitting.result import SurfaceFit

_MOST_TILT = float(np.radians(10.0))  # standard deviation of a direction, both ways together
_MOST_SHARE = 0.1  # of a radius that may be doubtful


def is_settled(fit: SurfaceFit) -> bool:
    """Whether a surface is known so well that its equations are linear within what is doubtful of it."""
    told = fit.parameter_deviations()
    if max(told.get("direction", 0.0), told.get("normal", 0.0)) >= _MOST_TILT:
        return False
    radii = [name for name in ("radius", "tube_radius") if name in told]
    return all(told[name] < _MOST_SHARE * float(getattr(fit.surface, name)) for name in radii)
