# SPDX-License-Identifier: MIT
"""The result: an image, and for each pixel where it came from and how well its source agreed.

`examine` judges a fill where nobody knows the truth: beside real pieces of the image of the same shape.
"""

import base64
import io
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from texture.engine.passes import Tally
from texture.lattice import measure_phase_error
from texture.quality import measure_distance, measure_seam, measure_verbatim_share
from texture.sampling.arguments import check_known, check_mask
from texture.sampling.canvas import Canvas
from texture.sampling.limits import CLEARLY, MOSTLY, OUT_OF_STEP
from texture.sampling.sample import HIGHEST_LEVEL, BoolArray, Pixels, Sample
from texture.window import WindowCheck

_MOST = 240  # pixels, the longer side of a picture


@dataclass(frozen=True, slots=True, eq=False)
class Synthesis:
    """A filled or grown image, and where each of its pixels came from.

    Parameters
    ----------
    image : array, shape (h, w) or (h, w, c)
        Of the input's dtype; each filled pixel is a copy of its source.
    source_rows, source_cols : array, shape (h, w), int32
        Which pixel of the sample image each pixel is a copy of. In `fill` the sample image is the input, and
        known pixels point at themselves; -1 where a pixel is neither known nor filled.
    error : array, shape (h, w), float32
        How much the chosen candidate's surroundings differ from the pixel's: Gaussian-weighted mean of
        squared differences, pixels in 0..1, mean over channels. 0 where nothing was filled; 1 at seeds, for
        which nothing vouches.
    confidence : array, shape (h, w), float32
        1 - error / (2 variance of the sample), not below 0: 1 where the surroundings agree as if copied, 0
        where they agree no better than unrelated ones do, and at seeds. 1 at known pixels, 0 at unknown ones.
    n_relaxed : int
        How often the largest accepted error (0.3) was multiplied by 1.1, because a pass filled nothing.
    n_seeds : int
        How many seeds were planted: 1 in `grow`; in `fill` one for each hole that touches no known pixel.
    window : int
        Side of the comparison window, pixels.
    window_distances : dict of int to float
        What the self-check measured for each window when none was given (`texture.window`).
    is_complete : bool
        Whether all was filled; a time budget may end a synthesis before. What is unfilled then has no source.
    """

    image: Pixels
    source_rows: NDArray[np.int32]
    source_cols: NDArray[np.int32]
    error: NDArray[np.float32]
    confidence: NDArray[np.float32]
    n_relaxed: int
    n_seeds: int
    window: int
    window_distances: dict[int, float]
    is_complete: bool

    def __post_init__(self) -> None:
        for name in ("image", "source_rows", "source_cols", "error", "confidence"):
            array = np.array(getattr(self, name))
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    @property
    def is_filled(self) -> NDArray[np.bool_]:
        """Which pixels (h, w) have another one as their source."""
        height, width = self.source_rows.shape
        itself = (self.source_rows == np.arange(height)[:, None]) & (self.source_cols == np.arange(width))
        return np.asarray((self.source_rows >= 0) & ~itself)

    def describe(self) -> str:
        """Return in a sentence how many pixels were copied, and how well they agree."""
        filled = self.is_filled
        agreement = f"{100 * float(self.confidence[filled].mean()):.0f} %" if filled.any() else "n/a"
        late = "" if self.is_complete else "; not complete: the time was up"
        copied = f"{np.count_nonzero(filled)} pixels copied, window {self.window} px"
        return f"{copied}, mean confidence {agreement}{late}"

    def __repr__(self) -> str:
        height, width = self.source_rows.shape
        return f"Synthesis({height} x {width} pixels, {self.describe()})"

    def _repr_html_(self) -> str:
        """What a notebook shows: the image, and where its pixels came from."""
        return self.to_html(self.image)

    def to_html(self, image: Pixels) -> str:
        """Return a card for notebooks: `image` (h, w) or (h, w, c), and where its pixels came from.

        Known pixels, which point at themselves, are see-through in the second picture; the others are redder
        the lower, and greener the further right, their source lies. No style sheet, no script.
        """
        height, width = self.source_rows.shape
        sources = np.zeros((height, width, 4), np.uint8)
        for channel, place in enumerate((self.source_rows, self.source_cols)):
            sources[..., channel] = np.rint(255 * place.clip(0) / max(int(place.max(initial=0)), 1))
        sources[..., 2], sources[..., 3] = 128, np.where(self.is_filled, 255, 0)
        pictures = _figure(image, "image") + _figure(sources, "where its pixels came from")
        return (
            '<div class="unseen-card" style="font:13px/1.45 system-ui,sans-serif;color:inherit;'
            "display:inline-block;max-width:760px;padding:10px 14px;margin:4px 0;border-radius:8px;"
            'border:1px solid color-mix(in srgb,currentColor 25%,transparent)">'
            f'<div style="font-weight:600;margin-bottom:6px">Texture, {height} x {width} pixels</div>'
            f'<div style="display:flex;flex-wrap:wrap;gap:10px 22px">{pictures}</div>'
            f'<div style="opacity:.7;margin-top:6px">{self.describe()}</div></div>'
        )


def _figure(pixels: NDArray[Any], caption: str) -> str:
    """Return every k-th pixel as a figure."""
    from PIL import Image  # only notebooks need it

    step = max(1, -(-max(pixels.shape[:2]) // _MOST))
    small = pixels[::step, ::step]
    if small.dtype != np.uint8:
        small = np.rint(255 * np.clip(np.nan_to_num(small.astype(np.float64)), 0, 1)).astype(np.uint8)
    data = io.BytesIO()
    Image.fromarray(small[..., 0] if small.ndim == 3 and small.shape[2] == 1 else small).save(data, "PNG")
    uri = "data:image/png;base64," + base64.b64encode(data.getvalue()).decode("ascii")
    return (
        f'<figure style="margin:0"><img src="{uri}" alt="{caption}" width="{max(small.shape[1], 160)}" '
        'style="max-width:100%"/><figcaption style="opacity:.7;font-size:85%">'
        f"{caption}</figcaption></figure>"
    )


def collect(
    canvas: Canvas, sample: Sample, pixels: Pixels, background: Pixels, tally: Tally, check: WindowCheck
) -> Synthesis:
    """Copy each pixel of a finished canvas from its source, in the sample's own type.

    Pixels (h, w) or (h, w, c) are the image that the canvas's sources index; the background, in the canvas's
    shape and the pixels' dtype, shows where a pixel has no source.
    """
    height, width = canvas.unfilled.shape
    sources = canvas.sources[:height, :width]
    has_source = sources >= 0
    image = background.copy()
    image[has_source] = pixels.reshape(-1, *pixels.shape[2:])[sources[has_source]]
    rows, columns = np.divmod(sources, pixels.shape[1])
    return Synthesis(
        image=image,
        source_rows=np.where(has_source, rows, -1).astype(np.int32),
        source_cols=np.where(has_source, columns, -1).astype(np.int32),
        error=canvas.errors,
        confidence=np.where(has_source, _rate(canvas.errors, sample), 0),
        n_relaxed=tally.n_relaxed,
        n_seeds=tally.n_seeds,
        window=check.window,
        window_distances=check.distances,
        is_complete=tally.is_complete,
    )


def _rate(errors: NDArray[np.float32], sample: Sample) -> NDArray[np.float32]:
    """Return the confidence that errors leave: two unrelated pixels differ by twice the variance."""
    unrelated = 2 * _variance(sample)
    left = 1 - errors / unrelated if unrelated > 0 else np.where(errors > 0, 0.0, 1.0)
    return np.clip(left, 0, 1).astype(np.float32)


def _variance(sample: Sample) -> float:
    """Mean variance of the channels of what may be copied, levels from 0 to 1; 0 where there is nothing.

    Row by row, in the order in which numpy sums columns: memory for one row, and the same number.
    """
    n_channels, n = sample.levels.shape[2], int(np.count_nonzero(sample.usable))
    if n_channels == 1:  # which numpy sums in another order
        return float((sample.levels[sample.usable] / HIGHEST_LEVEL).var()) if n else 0.0
    sums = [np.zeros((1, n_channels)) for _ in range(2)]
    for power, total in enumerate(sums):
        mean = sums[0] / max(n, 1) * power
        for levels, usable in zip(sample.levels, sample.usable, strict=True):
            parts = (levels[usable] / HIGHEST_LEVEL - mean) ** (power + 1)
            total[:] = np.add.reduce(np.concatenate([total, parts]), axis=0)
    return float((sums[1] / max(n, 1)).mean())


N_PIECES = 6


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
        How much the border shows (`texture.quality.measure_seam`), in 8-bit levels; NaN where it has
        none.
    verbatim_share : float
        Share of patches copied in one piece from one place.
    phase_error : float
        How far the fill is out of step with a repeating texture
        (`texture.lattice.measure_phase_error`), as a fraction of the period; NaN where there is no
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

    def __repr__(self) -> str:
        pieces = f"{self.piece_distance:.3g} with sd {self.piece_spread:.3g} among pieces"
        return (
            f"Examination(distance {self.distance:.3g}, {pieces}, seam {self.seam:.3g},\n"
            f"    verbatim {self.verbatim_share:.3g}, out of step {self.phase_error:.3g}, "
            f"confidence {self.confidence:.3g}, alarms: {', '.join(self.alarms) or 'none'})"
        )


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
    image_whole, *pieces = [image[box] for box in boxes] or [image]
    among = [_distance(first, second, shape) for k, first in enumerate(pieces) for second in pieces[k + 1 :]]
    to_fill = [_distance(image_whole, piece, shape) for piece in pieces]
    filled = within & (synthesis.source_rows >= 0)
    confidence = float(synthesis.confidence[filled].mean()) if filled.any() else 1.0
    distance = float(np.mean(to_fill)) if to_fill else float("nan")
    mean, spread = (float(np.mean(among)), float(np.std(among))) if among else (float("nan"),) * 2
    verbatim = measure_verbatim_share(synthesis.source_rows, synthesis.source_cols, within)
    phase_error = measure_phase_error(image, within, around)
    flags = {
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
        alarms=tuple(name for name, rings in flags.items() if rings),
    )


def list_pieces(hole: BoolArray, known: BoolArray) -> list[tuple[slice, slice]]:
    """List up to six boxes, far from each other, in which all is known where the hole's own box has a hole.

    Hole and known have the image's shape (h, w). The first box is the hole's own; nothing is listed without
    a hole.
    """
    rows, columns = np.nonzero(hole)
    if not rows.size:
        return []
    members = np.s_[int(rows.min()) : int(rows.max()) + 1, int(columns.min()) : int(columns.max()) + 1]
    shape = hole[members]
    step = max(1, min(shape.shape) // 2)
    boxes = [
        np.s_[top : top + shape.shape[0], left : left + shape.shape[1]]
        for top in range(0, hole.shape[0] - shape.shape[0] + 1, step)
        for left in range(0, hole.shape[1] - shape.shape[1] + 1, step)
    ]
    pieces = [box for box in boxes if known[box][shape].all()]
    chosen = np.unique(np.linspace(0, len(pieces) - 1, min(N_PIECES, len(pieces))).astype(int))
    return [members, *(pieces[k] for k in chosen)]


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
