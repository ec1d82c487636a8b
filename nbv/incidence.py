# SPDX-License-Identifier: MIT
"""Incidence: the angle, surface and presence of what rays met, by compiled code."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from scenes.checks import FloatArray


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def describe_hits(
    face: NDArray[np.int32],
    cosine: FloatArray,
    face_surface: NDArray[np.int32],
    surface: NDArray[np.int32],
    incidence: FloatArray,
) -> None:
    """Write the surface id, -1 for none, and the incidence in radians, NaN for none, of each hit (n,)."""
    for i in range(face.size):
        if face[i] < 0:
            surface[i], incidence[i] = -1, np.nan
        else:
            surface[i], incidence[i] = face_surface[face[i]], np.arccos(min(cosine[i], 1.0))
