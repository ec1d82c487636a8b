# SPDX-License-Identifier: MIT
"""Packing: whole numbers as bytes that compress well, one behind the other.

Neighbours are alike, so that differences are small: they are folded to 0, 1, 2, ... for 0, -1, 1, ..., and
of all numbers of a column the lowest bytes come first, then the next ones, which are nearly all zero.
Indices count back from the largest so far (as Google's webgl-loader did): 0 is a new one.
"""

from __future__ import annotations

import io
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from scenes.mesh.labelled_mesh import Appearance

Integers = NDArray[Any]


class Packer:
    """Collects arrays; `add` returns where each lies, for the header."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []
        self._size = 0

    def add(self, values: Integers, *, is_index: bool = False) -> dict[str, Any]:
        """Append whole numbers (n,) or (n, c), none larger than 2^30, and return their entry.

        Indices must be numbered in the order of their first appearance.
        """
        table = np.asarray(values, dtype=np.int64)
        columns = 1 if table.ndim == 1 else table.shape[1]
        codes = countdown(table.ravel())[:, None] if is_index else folded(table.reshape(-1, columns))
        width = max(1, -(-int(codes.max(initial=0)).bit_length() // 8))
        planes = [
            (codes[:, k] >> (8 * b)).astype(np.uint8) for k in range(codes.shape[1]) for b in range(width)
        ]
        entry = {"at": self._size, "n": len(codes), "columns": columns, "width": width, "index": is_index}
        self.add_bytes(b"".join(plane.tobytes() for plane in planes))
        return entry

    def add_bytes(self, data: bytes) -> dict[str, Any]:
        """Append bytes as they are, and return their entry."""
        entry = {"at": self._size, "n": len(data)}
        self._parts.append(data)
        self._size += len(data)
        return entry

    def bytes(self) -> bytes:
        """Return all that was added."""
        return b"".join(self._parts)


def folded(table: Integers) -> Integers:
    """Differences along the columns of (n, c), folded to non-negative numbers.

    Examples
    --------
    >>> folded(np.array([[3], [2], [2], [5]])).ravel().tolist()
    [6, 1, 0, 6]
    """
    steps = np.diff(table, axis=0, prepend=0)
    return (steps << 1) ^ (steps >> 63)


def countdown(index: Integers) -> Integers:
    """How far each index (n,) lies below the next new one.

    Examples
    --------
    >>> countdown(np.array([0, 1, 2, 2, 1, 3])).tolist()
    [0, 0, 0, 1, 2, 0]
    """
    seen = np.maximum.accumulate(np.concatenate([[-1], index]))[:-1]
    return seen + 1 - index


def by_appearance(index: Integers) -> tuple[Integers, Integers]:
    """Number indices (n,) by their first appearance: the new ones (n,), and the old one of each new one.

    Examples
    --------
    >>> new, old = by_appearance(np.array([7, 3, 7, 0]))
    >>> new.tolist(), old.tolist()
    ([0, 1, 0, 2], [7, 3, 0])
    """
    values, first, inverse = np.unique(index, return_index=True, return_inverse=True)
    order = np.argsort(first, kind="stable")
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order))
    return rank[inverse], values[order]


_MOST_PIXELS = 3_000_000  # of all images together
_QUALITY, _METHOD = 82, 4  # of WebP
_FRACTION = 65535  # steps of texture coordinates

Indices = NDArray[np.int64]


def corner_keys(places: Integers, skin: Appearance | None, order: Indices) -> tuple[Indices, Indices]:
    """Join corners that are alike in place, colour and texture.

    `places` (3 * m, 3) are of the corners of all faces in their `order` (m,), the skin of these before.
    Returns the number (3 * m,) of each corner by first appearance, and the first corner (n,) that has each
    number.
    """
    key = _number(places)
    if skin is not None:
        if skin.images and skin.corner_uv is not None and skin.face_image is not None:
            uv = np.rint(skin.corner_uv[order].reshape(-1, 2).astype(np.float64) * _FRACTION)
            own = np.column_stack([uv.astype(np.int64), np.repeat(skin.face_image[order], 3)])
            key = _paired(key, _number(own))
        key = _paired(key, _number(_colours(skin, order)))
    index, old = by_appearance(key)
    first = np.full(int(key.max(initial=-1)) + 1, len(key), np.int64)
    np.minimum.at(first, key, np.arange(len(key)))
    return index, first[old]


def skin_entry(packer: Packer, skin: Appearance | None, order: Indices, kept: Indices) -> dict[str, Any]:
    """Pack colours and texture coordinates of the corners `kept`; None where there is nothing to say."""
    if skin is None:
        return {"colours": None, "uv": None}
    colours = _colours(skin, order)[kept]
    entry: dict[str, Any] = {"colours": packer.add(colours), "uv": None}
    if skin.images and skin.corner_uv is not None:
        uv = skin.corner_uv[order].reshape(-1, 2)[kept].astype(np.float64)
        low, high = uv.min(axis=0), uv.max(axis=0)
        scale = np.maximum(high - low, 1e-9) / _FRACTION
        steps = packer.add(np.rint((uv - low) / scale).astype(np.int64))
        entry["uv"] = {**steps, "low": low.tolist(), "scale": scale.tolist()}
    return entry


def add_images(packer: Packer, skin: Appearance | None, order: Indices) -> list[dict[str, Any]]:
    """Pack the images that faces use, as WebP, with how many faces (in order, those without first) do."""
    if skin is None or not skin.images or skin.face_image is None:
        return []
    uses = np.bincount(skin.face_image[order] + 1, minlength=len(skin.images) + 1)
    pixels = sum(image.shape[0] * image.shape[1] for image, n in zip(skin.images, uses[1:], strict=True) if n)
    shrink = min(1.0, float(np.sqrt(_MOST_PIXELS / max(pixels, 1))))
    entries: list[dict[str, Any]] = [{"faces": int(uses[0]), "image": None}]
    for image, n in zip(skin.images, uses[1:], strict=True):
        if n:
            entries.append({"faces": int(n), "image": packer.add_bytes(_webp(image, shrink))})
    return entries


def _webp(image: NDArray[np.uint8], shrink: float) -> bytes:
    """Return an image, made smaller, as WebP."""
    picture = Image.fromarray(image)
    if shrink < 1:
        size = tuple(max(1, round(side * shrink)) for side in picture.size)
        picture = picture.resize((size[0], size[1]), Image.Resampling.LANCZOS)
    data = io.BytesIO()
    picture.save(data, "WEBP", quality=_QUALITY, method=_METHOD)
    return data.getvalue()


def _colours(skin: Appearance, order: Indices) -> Integers:
    """Colours (3 * m, 3) of all corners in order, 0..255."""
    colours = np.rint(np.clip(skin.corner_colour[order], 0, 1) * 255).astype(np.uint8)
    return colours.reshape(-1, 3)


def _number(rows: Integers) -> Indices:
    """Number (n,) equal rows alike."""
    key = np.zeros(len(rows), np.int64)
    for column in rows.T:
        key = _paired(key, column - column.min(initial=0))
    return key


def _paired(one: Indices, other: Integers) -> Indices:
    """Number (n,) pairs of non-negative numbers that are alike."""
    both = one * (int(other.max(initial=0)) + 1) + other
    return np.asarray(np.unique(both, return_inverse=True)[1], dtype=np.int64)
