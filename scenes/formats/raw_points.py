# SPDX-License-Identifier: MIT
"""Raw points: what a file of points holds, in the file's own unit and order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scenes.checks import ColourArray, FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class RawPoints:
    """Points as a file holds them.

    Attributes
    ----------
    points : (n, 3) float
        In the world, NaN where the file says so.
    normals : (n, 3) float, optional
        As in the file.
    origins : (3,) or (n, 3) float, optional
        Where the scanner stood, once or for each point; None where the file does not tell.
    colour : (n, 3) uint8, optional
        sRGB.
    warnings : tuple of str
        What was left out or assumed.
    """

    points: FloatArray
    normals: FloatArray | None = None
    origins: FloatArray | None = None
    colour: ColourArray | None = None
    warnings: tuple[str, ...] = ()


def joined(parts: Sequence[RawPoints]) -> RawPoints:
    """Return the points of several scans one after the other; what not all of them know is left out."""
    points = np.concatenate([np.zeros((0, 3)), *(part.points for part in parts)])
    stood = [np.broadcast_to(part.origins, part.points.shape) for part in parts if part.origins is not None]
    colour = [part.colour for part in parts if part.colour is not None]
    return RawPoints(
        points,
        None,
        np.concatenate(stood) if stood and len(stood) == len(parts) else None,
        np.concatenate(colour) if colour and len(colour) == len(parts) else None,
    )
