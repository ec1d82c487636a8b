# SPDX-License-Identifier: MIT
"""Every argument that cannot be used is refused, with its name, the cause and the cure."""

from typing import Any

import numpy as np
import pytest

from texture import fill, grow

IMAGE = np.zeros((6, 8), dtype=np.uint8)
MASK = np.eye(6, 8)
USABLE_FOR_FILL: dict[str, Any] = {"image": IMAGE, "mask": MASK, "window": 3, "rng": 0}
USABLE_FOR_GROW: dict[str, Any] = {"sample": IMAGE, "shape": (4, 4), "window": 3, "rng": 0}


def replaced(value: float) -> np.ndarray[Any, Any]:
    image = np.full((6, 8), 0.5)
    image[3, 2] = value
    return image


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"image": np.zeros(5, np.uint8)}, r"image: expected shape \(h, w\) or .* got \(5,\)"),
        ({"image": np.zeros((6, 8, 5), np.uint8)}, r"c = 1\.\.4, got \(6, 8, 5\)"),
        ({"image": np.zeros((0, 8), np.uint8)}, r"image: expected shape .* got \(0, 8\)"),
        ({"image": np.zeros((6, 8), np.int64)}, "image: expected uint8, or float .* got int64; convert"),
        ({"image": np.zeros((6, 8), bool)}, "got bool"),
        (
            {"image": replaced(np.nan)},
            "1 of 48 pixels are known but not finite .*row 3, column 2.*; mask them",
        ),
        ({"image": replaced(np.inf)}, "not finite"),
        ({"image": replaced(1.5)}, r"float values in 0\.\.1, got 0\.\.1\.5; divide"),
        ({"image": replaced(-0.2)}, r"float values in 0\.\.1, got -0\.2\.\.0\.5"),
        ({"mask": np.zeros((8, 6))}, r"mask: expected the image's shape \(6, 8\), got \(8, 6\)"),
        ({"mask": np.ones((6, 8))}, "image: none of the 48 pixels is known, .*; leave some"),
        ({"mask": np.full((6, 8), np.nan)}, "mask: 48 of 48 values are NaN, neither zero nor not"),
        ({"known": np.zeros((6, 8))}, "image: none of the 48 pixels is known"),
        ({"known": np.ones((6, 7))}, r"known: expected the image's shape \(6, 8\), got \(6, 7\)"),
        ({"sample_mask": np.ones((6, 7))}, "sample_mask: expected the image's shape"),
        (
            {"sample_mask": np.ones((6, 8))},
            "sample_mask: 6 of its 48 pixels hold no known value; pass `sample_mask &",
        ),
        ({"sample_mask": np.zeros((6, 8))}, "sample_mask: selects no pixel"),
        ({"window": 8}, r"window: expected an odd whole number 3\.\.99 \(pixels\), got 8"),
        ({"window": 1}, "got 1"),
        ({"window": 101}, "got 101"),
        ({"window": 5.0}, r"got 5\.0"),
        ({"order": "random"}, r"order: expected one of \('paper', 'window'\), got 'random'"),
        ({"engine": "gpu"}, r"engine: expected one of \('numba', 'reference'\), got 'gpu'"),
        ({"wrap": True}, "wrap: expected two booleans .* got True"),
        ({"wrap": (True, False, True)}, "wrap: expected two booleans"),
        ({"wrap": (0, 1)}, "wrap: expected two booleans"),
    ],
)
def test_fill_refuses(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        fill(**(USABLE_FOR_FILL | arguments))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"sample": np.zeros((2, 3, 4, 5))}, "sample: expected shape"),
        ({"sample": replaced(np.nan)}, "not finite"),
        ({"shape": 5}, r"shape: expected two positive whole numbers \(rows, columns\), got 5"),
        ({"shape": (5, 0)}, r"shape: .* got \(5, 0\)"),
        ({"shape": (5, 2.5)}, "shape: expected two"),
        ({"shape": (5, 5, 3)}, "shape: expected two"),
        ({"sample_mask": np.zeros((6, 8))}, "sample_mask: selects no pixel"),
        ({"sample_mask": np.zeros((3, 8))}, "sample_mask: expected the image's shape"),
        ({"window": 4}, "window: expected an odd"),
        ({"wrap": None}, "wrap: expected two booleans"),
        ({"order": ""}, "order: expected one of"),
        ({"engine": None}, "engine: expected one of"),
    ],
)
def test_grow_refuses(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        grow(**(USABLE_FOR_GROW | arguments))


def test_what_is_not_read_may_hold_anything() -> None:
    unread = np.full((6, 8), 0.5)
    unread[MASK > 0] = np.nan
    assert (fill(unread, MASK, window=3, rng=0).image == 0.5).all()
    sample = replaced(np.inf)
    assert (grow(sample, (3, 3), window=3, sample_mask=np.isfinite(sample), rng=0).image == 0.5).all()


def test_rounding_beyond_one_is_accepted() -> None:
    image = np.full((6, 8), np.nextafter(np.float32(1), np.float32(2)))
    assert (fill(image, MASK, window=3, rng=0).image == image).all()


def test_numpy_numbers_are_numbers() -> None:
    shape = (np.int64(3), np.int32(4))
    assert grow(IMAGE, shape, window=np.int16(3), rng=0).image.shape == (3, 4)  # type: ignore[arg-type]
    assert fill(IMAGE, MASK, window=3, wrap=(np.True_, np.False_), rng=0).window == 3  # type: ignore[arg-type]
    assert fill(IMAGE, MASK, window=3, wrap=[True, False], rng=0).window == 3  # type: ignore[arg-type]
