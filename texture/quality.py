# SPDX-License-Identifier: MIT
"""Quality of a fill: how like the texture it is, how its border shows, how much of it is one piece copied.

A fill is another piece of the texture, not the lost one, so pixelwise scores mislead: SSIM and RMSE prefer a
blurred hole to a right texture. What can be compared are distributions of patches.
"""

import numpy as np
from numpy.typing import ArrayLike

from texture.sampling.arguments import check_image, check_mask
from texture.sampling.sample import HIGHEST_LEVEL, BoolArray, FloatArray, Pixels

PATCH = 7  # pixels: side of the patches that are compared
_BAND = 32  # rows of patches that are compared at a time


def measure_distance(
    first: ArrayLike,
    second: ArrayLike,
    first_mask: ArrayLike | None = None,
    second_mask: ArrayLike | None = None,
    *,
    n_levels: int = 3,
    n_directions: int = 128,
) -> float:
    """Measure the sliced Wasserstein distance of the patches of two textures.

    All 7 x 7 patches within each texture are projected on the same random directions; the distance is the
    mean difference of the sorted projections, averaged over directions and over levels of a pyramid, each
    half as fine (Rabin et al. 2011, "Wasserstein barycenter and its application to texture mixing"; the
    measure of Karras et al. 2018, section 5). Divide by the distance between two real pieces to read it: 1
    means as like as another piece.

    Parameters
    ----------
    first, second : arrays, shape (h, w) or (h, w, c)
        uint8, or float in 0..1; the sizes may differ.
    first_mask, second_mask : arrays, shape (h, w), optional
        Non-zero where the image belongs to the texture; default: everywhere.
    n_levels, n_directions : int
        Of the pyramid, and to project on. Levels in which either has no patch are left out.

    Returns
    -------
    float
        In 8-bit levels.

    Raises
    ------
    ValueError
        When a texture holds no patch, or the numbers of channels differ.

    Examples
    --------
    >>> ramp = np.arange(400.0).reshape(20, 20) / 400
    >>> measure_distance(ramp, ramp), measure_distance(ramp, ramp / 2) > 10
    (0.0, True)
    """
    pieces = [read_levels(first, first_mask, "first"), read_levels(second, second_mask, "second")]
    if pieces[0][0].shape[2] != pieces[1][0].shape[2]:
        raise ValueError(
            f"second: expected {pieces[0][0].shape[2]} channels as first, got {pieces[1][0].shape[2]}"
        )
    rng = np.random.default_rng(0)  # the same directions whoever asks: distances can be compared
    distances = []
    for _ in range(n_levels):
        patches = [list_patches(pixels, mask) for pixels, mask in pieces]
        if not all(len(held) for held in patches):
            break
        directions = rng.standard_normal((patches[0].shape[1], n_directions))
        directions /= np.linalg.norm(directions, axis=0)
        sorted_projections = [np.sort(held @ directions, axis=0) for held in patches]
        distances.append(np.abs(np.subtract(*_match_sizes(sorted_projections))).mean())
        pieces = [_halve(pixels, mask) for pixels, mask in pieces]
    if not distances:
        raise ValueError(f"first, second: no {PATCH} x {PATCH} patch lies wholly within one of them")
    return float(np.mean(distances))


def measure_seam(image: ArrayLike, hole: ArrayLike, reference: ArrayLike | None = None) -> float:
    """Measure how much the border of a fill shows.

    Patches across the border are compared with the nearest patch of the known part, by root mean square.

    Parameters
    ----------
    image : array, shape (h, w) or (h, w, c)
        Filled.
    hole : array, shape (h, w)
        Non-zero where it was filled.
    reference : array, in the image's shape, optional
        An image without a hole there - what was cut out, or any real piece: its own value divides the result,
        which is 1 where the border shows no more than the texture itself.

    Returns
    -------
    float
        In 8-bit levels, or relative to the reference.

    Raises
    ------
    ValueError
        When no patch lies across the border, or none in the known part.
    """
    pixels, mask = read_levels(image, None, "image")
    within = check_mask(hole, mask.shape, "hole")
    crossing = list_patches(pixels, mask, at=_find_border(within))
    distances, n_known = _measure_to_nearest(crossing, pixels, ~within)
    if not len(crossing) or not n_known:
        raise ValueError(
            f"hole: {len(crossing)} patches of {PATCH} x {PATCH} lie across its border and {n_known} "
            "outside it; both are needed"
        )
    seam = float(distances.mean())
    return seam if reference is None else seam / measure_seam(reference, within)


def measure_verbatim_share(source_rows: ArrayLike, source_cols: ArrayLike, hole: ArrayLike) -> float:
    """Measure which share of a fill's patches was copied in one piece from one place; 0..1.

    Parameters
    ----------
    source_rows, source_cols : arrays, shape (h, w), int
        Where each pixel came from (`texture.Synthesis`).
    hole : array, shape (h, w)
        Non-zero where it was filled. A hole without a 7 x 7 patch has none: 0.
    """
    sources = np.stack([np.asarray(source_rows), np.asarray(source_cols)], axis=2)
    within = check_mask(hole, sources.shape[:2], "hole")
    shifts = sources - np.moveaxis(np.indices(within.shape), 0, 2)
    patches = list_patches(shifts.astype(np.float64), within).reshape(-1, PATCH**2, 2)
    return float((patches == patches[:, :1]).all(axis=(1, 2)).mean()) if len(patches) else 0.0


def list_patches(pixels: FloatArray, mask: BoolArray, at: BoolArray | None = None) -> FloatArray:
    """Return the patches that lie wholly within a mask (h, w), shape (n, 49 * c), in raster order.

    Of pixels (h, w, c) of any values; with their centres `at` some (h, w), or anywhere.
    """
    if min(mask.shape) < PATCH:
        return np.empty((0, PATCH**2 * pixels.shape[2]))
    is_whole = np.lib.stride_tricks.sliding_window_view(mask, (PATCH, PATCH)).all(axis=(2, 3))
    if at is not None:
        is_whole &= at[PATCH // 2 : -(PATCH // 2), PATCH // 2 : -(PATCH // 2)]
    views = np.lib.stride_tricks.sliding_window_view(pixels, (PATCH, PATCH), axis=(0, 1))
    whole = views[is_whole].transpose(0, 2, 3, 1)
    return np.asarray(whole.reshape(len(whole), PATCH**2 * pixels.shape[2]))


def read_levels(image: ArrayLike, mask: ArrayLike | None, name: str) -> tuple[FloatArray, BoolArray]:
    """Return an image as 8-bit levels (h, w, c), not rounded, and where it counts (h, w)."""
    pixels: Pixels = check_image(image, name)
    scale = 1.0 if pixels.dtype == np.uint8 else HIGHEST_LEVEL
    values = pixels.reshape(*pixels.shape[:2], -1).astype(np.float64) * scale
    everywhere = np.ones(values.shape[:2], dtype=np.bool_)
    return values, everywhere if mask is None else check_mask(mask, everywhere.shape, f"{name}_mask")


def _halve(pixels: FloatArray, mask: BoolArray) -> tuple[FloatArray, BoolArray]:
    """Return the next level of a pyramid: means of 2 x 2 pixels, which belong to it if all four do."""
    height, width = (size // 2 for size in mask.shape)
    blocks = np.s_[: 2 * height, : 2 * width]
    means = pixels[blocks].reshape(height, 2, width, 2, -1).mean(axis=(1, 3))
    is_whole: BoolArray = np.asarray(mask[blocks].reshape(height, 2, width, 2).all(axis=(1, 3)))
    return means, is_whole


def _match_sizes(projections: list[FloatArray]) -> list[FloatArray]:
    """Return the quantiles of sorted columns at as many levels as the longer one has."""
    n = max(len(projection) for projection in projections)
    return [projection[(np.arange(n) * len(projection)) // n] for projection in projections]


def _find_border(within: BoolArray) -> BoolArray:
    """Return the pixels of a mask that have a neighbour, up, down, left or right, outside it."""
    padded = np.pad(within, 1, mode="edge")
    inner = padded[:-2, 1:-1] & padded[2:, 1:-1] & padded[1:-1, :-2] & padded[1:-1, 2:]
    return within & ~inner


def _measure_to_nearest(patches: FloatArray, pixels: FloatArray, mask: BoolArray) -> tuple[FloatArray, int]:
    """Return how far each patch is from the nearest one within a mask, and how many these are.

    Matrix products find the nearest, a band of rows at a time; its distance is then taken directly.
    """
    middle = patches.mean(axis=0) if len(patches) else 0.0
    nearest, n_within = np.full(len(patches), np.inf), 0
    for top in range(0, max(1, len(mask) - PATCH + 1), _BAND):
        band = np.s_[top : top + _BAND + PATCH - 1]
        others = list_patches(pixels[band], mask[band])
        n_within += len(others)
        if len(others) and len(patches):
            products = (patches - middle) @ (others - middle).T
            closest = np.argmin(((others - middle) ** 2).sum(axis=1) - 2 * products, axis=1)
            distances = np.sqrt(((patches - others[closest]) ** 2).mean(axis=1))
            nearest = np.minimum(nearest, distances)
    return nearest, n_within
