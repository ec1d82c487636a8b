# SPDX-License-Identifier: MIT
"""Other ways to fill a hole in an image, each a function of image, hole and seed."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy import fft

Image8: TypeAlias = NDArray[np.uint8]
Fill: TypeAlias = Callable[[Image8, NDArray[np.bool_], int, int], Image8]  # image, hole, window, seed

N_TIMED = 20  # templates


class Peer(NamedTuple):
    """A method by name; without `fill`, `reason` says why."""

    name: str
    fill: Fill | None
    reason: str = ""


def list_peers() -> list[Peer]:
    """List what can fill a hole here, and what cannot and why."""
    loaders = {
        "PyPatchMatch": _load_pypatchmatch,
        "patchmatch-cython": _load_patchmatch_cython,
        "resynthesizer": _load_resynthesizer,
    }
    peers = [Peer("OpenCV Telea", _fill_by_telea)]
    for name, load in loaders.items():
        try:
            peers.append(Peer(name, load()))
        except (ImportError, OSError) as error:
            peers.append(Peer(name, None, f"not installed here: {error}"))
    return peers


def _fill_by_telea(image: Image8, hole: NDArray[np.bool_], _window: int, _seed: int) -> Image8:
    return np.asarray(cv2.inpaint(image, hole.astype(np.uint8), 3, cv2.INPAINT_TELEA), dtype=np.uint8)


def _load_pypatchmatch() -> Fill:
    from patchmatch import patch_match

    if not patch_match.patchmatch_available:
        raise ImportError("its native library does not load")

    def fill(image: Image8, hole: NDArray[np.bool_], window: int, seed: int) -> Image8:
        patch_match.set_random_seed(seed)
        colour = np.repeat(image[..., None], 3, axis=2)
        made = patch_match.inpaint(colour, hole.astype(np.uint8) * 255, patch_size=window)
        return np.asarray(made)[..., 0]

    return fill


def _load_patchmatch_cython() -> Fill:
    from patchmatch_cython import CythonSolver, inpaint_pyramid

    def fill(image: Image8, hole: NDArray[np.bool_], window: int, seed: int) -> Image8:
        colour = np.repeat(image[..., None], 3, axis=2)
        made = inpaint_pyramid(colour, hole, patch_size=window, seed=seed, solver_class=CythonSolver)
        return np.asarray(made, dtype=np.uint8)[..., 0]

    return fill


def _load_resynthesizer() -> Fill:
    from resynthesizer import resynthesize

    def fill(image: Image8, hole: NDArray[np.bool_], _window: int, _seed: int) -> Image8:
        made = resynthesize(
            Image.fromarray(image).convert("RGB"), Image.fromarray(hole.astype(np.uint8) * 255)
        )
        return np.asarray(made.convert("RGB"))[..., 0]

    return fill


def time_products(window: int, n_templates: int, n_positions: int) -> float:
    """Return the seconds of the float32 matrix products of a brute-force masked search."""
    rng = np.random.default_rng(0)
    templates = rng.random((256, 2 * window**2), dtype=np.float32)
    positions = rng.random((2 * window**2, 8192), dtype=np.float32)
    seconds = min(_time(lambda: templates @ positions) for _ in range(9))
    return seconds * n_templates / 256 * n_positions / 8192


def time_match_template(image: Image8, window: int, n_templates: int) -> float:
    """Return the seconds of OpenCV's masked matchTemplate for so many templates."""
    cv2.setNumThreads(1)
    pixels = image.astype(np.float32)
    weights = np.ones((window, window), dtype=np.float32)

    def match() -> None:
        for k in range(N_TIMED):
            cv2.matchTemplate(pixels, pixels[k : k + window, k : k + window], cv2.TM_SQDIFF, mask=weights)

    return _time(match) / N_TIMED * n_templates


def time_transforms(image: Image8, window: int, n_templates: int) -> float:
    """Return the seconds of masked distances by Fourier transforms for so many templates."""
    size = [fft.next_fast_len(side, real=True) for side in image.shape]
    pixels = image.astype(np.float32)
    values, squares = fft.rfft2(pixels, size), fft.rfft2(pixels**2, size)
    weights = np.ones((window, window), dtype=np.float32)

    def match() -> None:
        for k in range(N_TIMED):
            template = pixels[k : k + window, k : k + window]
            kernels = fft.rfft2(np.stack([weights, weights * template]), size)
            fft.irfft2(np.conj(kernels[0]) * squares - 2 * np.conj(kernels[1]) * values, size)

    return _time(match) / N_TIMED * n_templates


def _time(work: Callable[[], object]) -> float:
    start = time.process_time()
    work()
    return time.process_time() - start
