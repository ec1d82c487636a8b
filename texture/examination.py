# SPDX-License-Identifier: MIT
"""Examination of a fill where nobody knows the truth: compared with real pieces of the same shape."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from texture.analysis.lattice import measure_phase_error
from texture.analysis.quality import measure_distance, measure_seam, measure_verbatim_share
from texture.result import Synthesis
from texture.sampling.arguments import check_known, check_mask
from texture.sampling.sample import BoolArray

N_PIECES = 6
CLEARLY = 4.0  # standard deviations beyond the mean of real pieces
MOSTLY = 0.5
OUT_OF_STEP = 0.2  # periods; a fill that knows nothing of the lattice is at 1/4 or 1/3


@dataclass(frozen=True, kw_only=True, slots=True)
class Examination:
    """How a fill compares with the texture around it.

    Attributes
    ----------
    distance : float
        Sliced Wasserstein distance between the fill and real pieces, in 8-bit levels; NaN when the known part
        holds no piece of the hole's shape, or the hole no patch.
    piece_distance, piece_spread : float
        The same among real pieces: mean and standard deviation.
    seam : float
        How much the border shows (`texture.analysis.quality.measure_seam`), in 8-bit levels; NaN where it has
        none.
    verbatim_share : float
        Share of patches copied in one piece from one place.
    phase_error : float
        How far the fill is out of step with a repeating texture
        (`texture.analysis.lattice.measure_phase_error`), as a fraction of the period; NaN where there is no
        lattice.
    confidence : float
        Mean over the fill of `Synthesis.confidence`.
    alarms : tuple of str
        "garbage": the fill is further from real pieces than these from each other by more than 4 standard
        deviations, or its mean confidence is below a half. "verbatim": more than half of its patches are
        copies of one piece; right for what is periodic, suspicious elsewhere. "incomplete": pixels were left
        unfilled. "out of step": the phase error exceeds a fifth of the period; a larger window may mend it.
    """

    distance: float
    piece_distance: float
    piece_spread: float
    seam: float
    verbatim_share: float
    phase_error: float
    confidence: float
    alarms: tuple[str, ...]


def examine(synthesis: Synthesis, hole: ArrayLike, known: ArrayLike | None = None) -> Examination:
    """Examine a fill by `texture.fill`.

    Parameters
    ----------
    synthesis : Synthesis
        The fill.
    hole : array, shape (h, w)
        Non-zero where it was filled.
    known : array, shape (h, w), optional
        Non-zero where the image held a value; default: everywhere outside the hole.
    """
    within = check_mask(hole, synthesis.error.shape, "hole")
    around = check_known(known, within)
    image = np.where(np.isfinite(synthesis.image), synthesis.image, 0).astype(synthesis.image.dtype)
    boxes = list_pieces(within, around)
    shape = within[boxes[0]] if boxes else within
    own, *pieces = [image[box] for box in boxes] or [image]
    among = [_distance(first, second, shape) for k, first in enumerate(pieces) for second in pieces[k + 1 :]]
    to_fill = [_distance(own, piece, shape) for piece in pieces]
    filled = within & (synthesis.source_rows >= 0)
    confidence = float(synthesis.confidence[filled].mean()) if filled.any() else 1.0
    distance = float(np.mean(to_fill)) if to_fill else float("nan")
    mean, spread = (float(np.mean(among)), float(np.std(among))) if among else (float("nan"),) * 2
    verbatim = measure_verbatim_share(synthesis.source_rows, synthesis.source_cols, within)
    phase_error = measure_phase_error(image, within, around)
    found = {
        "garbage": distance > mean + CLEARLY * max(spread, 0.1 * mean) or confidence < MOSTLY,
        "verbatim": verbatim > MOSTLY,
        "incomplete": not synthesis.is_complete,
        "out of step": phase_error > OUT_OF_STEP,
    }
    return Examination(
        distance=distance,
        piece_distance=mean,
        piece_spread=spread,
        seam=_seam(image, within),
        verbatim_share=verbatim,
        phase_error=phase_error,
        confidence=confidence,
        alarms=tuple(name for name, rings in found.items() if rings),
    )


def list_pieces(hole: BoolArray, known: BoolArray) -> list[tuple[slice, slice]]:
    """List up to six boxes, far from each other, in which all is known where the hole's own box has a hole.

    Hole and known have the image's shape (h, w). The first box is the hole's own; nothing is listed without
    a hole.
    """
    rows, columns = np.nonzero(hole)
    if not rows.size:
        return []
    own = np.s_[int(rows.min()) : int(rows.max()) + 1, int(columns.min()) : int(columns.max()) + 1]
    shape = hole[own]
    step = max(1, min(shape.shape) // 2)
    boxes = [
        np.s_[top : top + shape.shape[0], left : left + shape.shape[1]]
        for top in range(0, hole.shape[0] - shape.shape[0] + 1, step)
        for left in range(0, hole.shape[1] - shape.shape[1] + 1, step)
    ]
    pieces = [box for box in boxes if known[box][shape].all()]
    chosen = np.unique(np.linspace(0, len(pieces) - 1, min(N_PIECES, len(pieces))).astype(int))
    return [own, *(pieces[k] for k in chosen)]


def _distance(first: NDArray[np.generic], second: NDArray[np.generic], shape: BoolArray) -> float:
    try:
        return measure_distance(first, second, shape, shape)
    except ValueError:  # too thin for a patch
        return float("nan")


def _seam(image: NDArray[np.generic], hole: BoolArray) -> float:
    try:
        return measure_seam(image, hole)
    except ValueError:  # no patch across the border
        return float("nan")
