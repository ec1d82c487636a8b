# SPDX-License-Identifier: MIT
"""Sensors whose errors are alike over the image: noise, smooth fields, bends, warps over everything."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from scenes.checks import FloatArray
from scenes.scan.range_image import RangeImage

DISPARITY_PER_M = 2e-3
"""Error of the depth at 1 m by a smooth error of the disparity, metres: 18 mm at 3 m."""

_NOISE_PER_M = 1.425e-3  # of a Kinect's depth at 1 m (Khoshelham & Elberink 2012)
_LENGTH = 0.12  # of the image's longer side: a smooth field's correlation


@dataclass(frozen=True, slots=True)
class SensorErrors:
    """What a sensor adds to true ranges.

    Attributes
    ----------
    name : str
        For tables.
    noise : callable
        Standard deviation of independent errors of ranges (n,), metres.
    smooth : callable
        Factor of the smooth field at ranges (n,), metres.
    field : callable
        A smooth field (rows, columns) of unit mean square, by a generator and the image's shape.
    is_camera : bool
        Whether only cameras err so, not scanners.
    """

    name: str
    noise: Callable[[FloatArray], FloatArray]
    smooth: Callable[[FloatArray], FloatArray]
    field: Callable[[np.random.Generator, tuple[int, int]], FloatArray]
    is_camera: bool = False

    def applied(self, scan: RangeImage, seed: int) -> RangeImage:
        """Return a scan without errors with these; it is for who uses it to find out how large they are."""
        rng = np.random.default_rng([20268, seed])
        held = scan.ranges[scan.valid]
        field = self.field(rng, scan.shape)[scan.valid]
        ranges = scan.ranges.copy()
        ranges[scan.valid] = held + self.smooth(held) * field + self.noise(held) * rng.normal(size=len(held))
        return replace(scan, ranges=np.maximum(ranges, 0.05), sigma_m=None)


def random_field(rng: np.random.Generator, shape: tuple[int, int]) -> FloatArray:
    """A Gaussian field (rows, columns) of unit mean square, as long as a seventh of the image."""
    margin = max(shape)
    white = rng.normal(size=(shape[0] + margin, shape[1] + margin))
    field = ndimage.gaussian_filter(white, _LENGTH * max(shape), mode="wrap", truncate=3.0)
    field /= np.sqrt(np.mean(np.square(field)))
    return np.asarray(field[: shape[0], : shape[1]])


def polynomial_field(rng: np.random.Generator, shape: tuple[int, int]) -> FloatArray:
    """A polynomial of third order over the image (rows, columns), of unit mean square there."""
    y, x = (np.linspace(-1, 1, n) for n in shape)
    basis = [np.outer(y**a, x**b) for a in range(4) for b in range(4 - a) if a + b]
    field = sum(rng.normal() * (one - one.mean()) / one.std() for one in basis)
    return np.asarray(field / np.sqrt(np.mean(np.square(field))))


def no_field(_rng: np.random.Generator, shape: tuple[int, int]) -> FloatArray:
    """None."""
    return np.zeros(shape)


def _always(size: float) -> Callable[[FloatArray], FloatArray]:
    return lambda ranges: np.full_like(ranges, size)


def _by_square(size: float) -> Callable[[FloatArray], FloatArray]:
    return lambda ranges: size * np.square(ranges)


def _camera(name: str, field: Callable[[np.random.Generator, tuple[int, int]], FloatArray]) -> SensorErrors:
    noise, smooth = _by_square(_NOISE_PER_M), _by_square(DISPARITY_PER_M)
    return SensorErrors(name, noise, smooth, field, is_camera=True)


SENSORS: tuple[SensorErrors, ...] = (
    SensorErrors("2 mm", _always(2e-3), _always(0.0), no_field),
    SensorErrors("10 mm", _always(1e-2), _always(0.0), no_field),
    SensorErrors("2 mm, 1.5 mm smooth", _always(2e-3), _always(1.5e-3), random_field),
    _camera("depth camera, smooth", random_field),
    _camera("depth camera, polynomial", polynomial_field),
)
