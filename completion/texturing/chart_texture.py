# SPDX-License-Identifier: MIT
"""Chart texture: the colour of a surface's chart, what was measured of it and what was made."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from completion.evidence.chart_grid import ChartGrid
from scenes.checks import BoolArray, FloatArray

GREY = 158  # of a texel of which nothing is known
_MARGIN = 2  # texels around what is coloured that repeat its colour
_DOUBTFUL = 0.5  # mean confidence below which a fill is called garbage


@dataclass(frozen=True, slots=True, eq=False)
class ChartTexture:
    """Colour of a surface's chart.

    Attributes
    ----------
    image : (rows, columns, 3) uint8
        sRGB, grey where nothing is known; row 0 is the chart's lowest v.
    grid : ChartGrid
        Its texels.
    measured, synthesised : (rows, columns) bool
        Texels that scans coloured, and those made by sampling.
    synthesised_m : float
        Side of what was sampled as one texel, metres: a larger one than the grid's where there was too much.
    n_samples : int
        Texels of that size that were sampled from.
    window : int
        Side of the Efros-Leung window, 0 where nothing was synthesised.
    is_plain : bool
        Whether the surface has one colour, and was filled by its mean and noise.
    confidence : float
        Mean over the synthesised texels of how well their surroundings agree (`texture.Synthesis`).
    verbatim_share : float
        Share of them copied in one piece (`texture.measure_verbatim_share`).
    """

    image: NDArray[np.uint8]
    grid: ChartGrid
    measured: BoolArray
    synthesised: BoolArray
    synthesised_m: float = 0.0
    n_samples: int = 0
    window: int = 0
    is_plain: bool = False
    confidence: float = 1.0
    verbatim_share: float = 0.0

    @property
    def n_synthesised(self) -> int:
        """Texels made by sampling."""
        return int(np.count_nonzero(self.synthesised))

    @property
    def is_doubtful(self) -> bool:
        """Whether the surroundings of what was synthesised agree less than half as well as copies do."""
        return self.confidence < _DOUBTFUL

    def texels(self, uv: FloatArray) -> FloatArray:
        """Fractional rows and columns (n, 2) of chart coordinates (n, 2); integers are texel corners."""
        return np.asarray((uv - self.grid.corner)[:, ::-1] / self.grid.cell[::-1], dtype=np.float64)

    def colour_at(self, uv: FloatArray) -> NDArray[np.uint8]:
        """Colours (n, 3) of the texels that chart coordinates (n, 2) lie in, of the nearest ones outside."""
        index = np.floor(self.texels(uv)).astype(np.int64)
        row, column = np.clip(index, 0, np.array(self.grid.shape) - 1).T
        return np.asarray(self.image[row, column], dtype=np.uint8)


def spread_colour(image: NDArray[np.uint8], known: BoolArray, wraps: bool) -> NDArray[np.uint8]:
    """Repeat the colour of known texels in those beside them, so that interpolation at edges stays in it.

    Parameters
    ----------
    image : (rows, columns, 3) uint8
        sRGB.
    known : (rows, columns) bool
        Texels whose colour is known.
    wraps : bool
        Whether columns close.

    Returns
    -------
    (rows, columns, 3) uint8
        Grey where nothing is known within two texels.
    """
    sides = ((_MARGIN, _MARGIN), (_MARGIN, _MARGIN))
    done, result = np.pad(known, sides), np.pad(np.where(known[..., None], image, GREY), (*sides, (0, 0)))
    if wraps:
        for padded in (done, result):
            padded[:, :_MARGIN], padded[:, -_MARGIN:] = (
                padded[:, -2 * _MARGIN : -_MARGIN],
                padded[:, _MARGIN : 2 * _MARGIN],
            )
    for _ in range(_MARGIN):
        weight = cv2.blur(done.astype(np.float32), (3, 3), borderType=cv2.BORDER_CONSTANT)
        coloured = np.where(done[..., None], result, 0).astype(np.float32)
        mean = cv2.blur(coloured, (3, 3), borderType=cv2.BORDER_CONSTANT)
        new = ~done & (weight > 0.01)
        result[new] = np.rint(mean[new] / weight[new, None])
        done |= new
    return np.ascontiguousarray(result[_MARGIN:-_MARGIN, _MARGIN:-_MARGIN], dtype=np.uint8)
