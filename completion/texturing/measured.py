# SPDX-License-Identifier: MIT
"""Measured colour: each texel from the pixel that sees it best, and whether it may be sampled."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from completion.extension.patch import Patch
from completion.observe.observation import Observation
from completion.texturing.raster import TexelRaster, footprint
from scenes.checks import BoolArray, FloatArray

_COARSEST = 2.0  # texels: longest side of a pixel whose colour shows a texture as fine as the chart's
_FEWEST = 0.25  # share of a surface's own texels that are sampled, however coarse
_CHUNK = 30_000  # places that cv2.remap takes in one row


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredColour:
    """What the scans say of a raster's colour.

    Attributes
    ----------
    image : (rows, columns, 3) uint8
        sRGB, 0 where nothing is known.
    known : (rows, columns) bool
        Where a scan with colour measured the surface.
    pure : (rows, columns) bool
        Known texels whose colour is this surface's alone: pixels around theirs are its own, too.
    fine : (rows, columns) bool
        Those of the pure ones that were seen finely enough to be samples.
    """

    image: NDArray[np.uint8]
    known: BoolArray
    pure: BoolArray
    fine: BoolArray


def measure_colour(patch: Patch, raster: TexelRaster, observations: Sequence[Observation]) -> MeasuredColour:
    """Bring the colour of all scans into a raster, each texel from the scan that sees it largest.

    Texels seen more obliquely or from farther than the raster is fine (pixels longer than two texels) are no
    samples, except the finest quarter where hardly any others are there.
    """
    image = np.zeros((*raster.shape, 3), np.uint8)
    known, pure = (np.zeros(raster.shape, dtype=np.bool_) for _ in range(2))
    length = np.full(raster.shape, np.inf)
    observed, scan_of = raster.of_cells(patch.observed), raster.of_cells(patch.evidence.scan)
    for index, (observation, mask) in enumerate(zip(observations, patch.source.masks, strict=True)):
        here = observed & (scan_of == index)
        if observation.scan.colour is None or not here.any():
            continue
        points = raster.centres(here)
        position = observation.scan.pixels(points)
        inside = np.isfinite(position).all(axis=1)
        here[here] = inside
        points, position = points[inside], position[inside]
        counts = mask.copy()
        counts.ravel()[patch.evidence.pixel[patch.observed & (patch.evidence.scan == index)]] = True
        image[here] = _interpolate(
            observation.scan.colour, counts, position, raster.of_cells(patch.evidence.pixel)[here]
        )
        known |= here
        within = ndimage.binary_erosion(mask, np.ones((3, 3)))
        nearest = np.rint(position).astype(np.int64)
        pure[here] = within[nearest[:, 0], nearest[:, 1]]
        length[here] = footprint(observation, points, patch.grid.surface.normal(points))[1]
    pure = pure if pure.any() else known & raster.of_cells(patch.evidence.own)
    return MeasuredColour(image, known, pure, pure & (length <= _longest(length[pure], raster)))


def _longest(length: FloatArray, raster: TexelRaster) -> float:
    """The longest side of a pixel, metres, that makes a sample."""
    limit = _COARSEST * raster.texel_m
    return max(limit, float(np.quantile(length, _FEWEST))) if length.size else limit


def _interpolate(
    colour: NDArray[np.float32], counts: BoolArray, position: FloatArray, fallback: NDArray[np.int64]
) -> NDArray[np.uint8]:
    """Bilinear colours (n, 3), 0..255, at fractional rows and columns (n, 2), of the pixels that count.

    Where none does, that of the flat pixel `fallback` (n,).
    """
    pixels = np.where(counts[..., None], colour, 0).astype(np.float32)
    total, weight = _remap(pixels, position), _remap(counts.astype(np.float32), position)
    found = colour.reshape(-1, 3)[fallback]
    enough = weight > 1e-3
    found[enough] = total[enough] / weight[enough, None]
    return np.asarray(np.rint(np.clip(found, 0, 1) * 255), dtype=np.uint8)


def _remap(image: NDArray[np.float32], position: FloatArray) -> NDArray[np.float32]:
    """Bilinear values (n,) or (n, channels) at fractional rows and columns (n, 2) inside the image."""
    parts = np.array_split(position.astype(np.float32), max(1, -(-len(position) // _CHUNK)))
    found = [
        cv2.remap(
            image, part[None, :, 1], part[None, :, 0], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )[0]
        for part in parts
    ]
    return np.asarray(np.concatenate(found), dtype=np.float32)
