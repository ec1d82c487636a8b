# SPDX-License-Identifier: MIT
"""Encoding of the 3-D view: a JSON header and packed arrays, gzipped, as base64; the same bytes each time.

No name stands in the page as text of its own: base64 cannot end a script or begin a comment.

Packing: whole numbers as bytes that compress well, one behind the other.
Neighbours are alike, so that differences are small: they are folded to 0, 1, 2, ... for 0, -1, 1, ..., and
of all numbers of a column the lowest bytes come first, then the next ones, which are nearly all zero.
Indices count back from the largest so far (as Google's webgl-loader did): 0 is a new one.
"""

from __future__ import annotations

import base64
import gzip
import io
import json
import struct
from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib import colormaps
from numpy.typing import NDArray
from PIL import Image

from nbv.report.viewer.layers import (
    Classes,
    Layer,
    Lines,
    Marker,
    Numbers,
    Sightings,
    Viewer,
    best_camera,
    focus,
)
from scenes.checks import FloatArray
from scenes.mesh.blocks import morton_order
from scenes.mesh.labelled_mesh import Appearance
from scenes.run.mapping import trim

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
        codes = (
            countdown(table.ravel())[:, None] if is_index else fold_differences(table.reshape(-1, columns))
        )
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


def fold_differences(table: Integers) -> Integers:
    """Differences along the columns of (n, c), folded to non-negative numbers.

    Examples
    --------
    >>> fold_differences(np.array([[3], [2], [2], [5]])).ravel().tolist()
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
            texel_keys = np.column_stack([uv.astype(np.int64), np.repeat(skin.face_image[order], 3)])
            key = _number_pairs(key, _number(texel_keys))
        key = _number_pairs(key, _number(_colours(skin, order)))
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
        key = _number_pairs(key, column - column.min(initial=0))
    return key


def _number_pairs(first: Indices, second: Integers) -> Indices:
    """Number (n,) pairs of non-negative numbers that are alike."""
    both = first * (int(second.max(initial=0)) + 1) + second
    return np.asarray(np.unique(both, return_inverse=True)[1], dtype=np.int64)


_FINEST_M = 0.00025  # step of the coordinates in large scenes; small ones have 2^16 steps
_MOST_STEPS = 2**24  # what a 32-bit float of the graphics card holds
_LEVEL = 6  # of gzip: 9 takes four times as long for 1 %
_STOPS = 17  # of a colour bar
_SIGHTING_DEG = 0.5


def encode_view(viewer: Viewer) -> str:
    """Return all that the 3-D view shows as base64 text."""
    packer, bounds = Packer(), viewer.bounds()
    step = _step(bounds)
    camera = viewer.camera or best_camera(bounds + np.array([[-1e-6], [1e-6]]), viewer.layers)
    forward = camera.axes[2]
    header = {
        "label": viewer.label,
        "mode": viewer.mode,
        "room": viewer.is_room,
        "cut": None if viewer.cut_m is None else viewer.cut_m - float(bounds[0, 2]),
        "origin": bounds[0].tolist(),
        "size": (bounds[1] - bounds[0]).tolist(),
        "focus": (focus(viewer.layers, forward, is_room=viewer.is_room) - bounds[0]).tolist(),
        "step": step,
        "met": list(viewer.met),
        "one": viewer.noun,
        "look": _look(forward),
        "ramp": _ramp(),
        "layers": [_layer(packer, layer, bounds[0], step) for layer in viewer.layers if len(layer.faces)],
        "markers": [_marker(marker, bounds[0]) for marker in viewer.markers],
        "lines": [_lines(lines, bounds[0]) for lines in viewer.lines if len(lines.ends)],
    }
    text = json.dumps(header, ensure_ascii=True, separators=(",", ":"), allow_nan=False).encode()
    data = struct.pack("<I", len(text)) + text + packer.bytes()
    return base64.b64encode(gzip.compress(data, _LEVEL, mtime=0)).decode("ascii")


def _step(bounds: FloatArray) -> float:
    """Step of the coordinates, metres."""
    side = float(np.max(bounds[1] - bounds[0]))
    return max(min(side / 65535, _FINEST_M), side / _MOST_STEPS, 1e-9)


def _layer(packer: Packer, layer: Layer, origin: FloatArray, step: float) -> dict[str, Any]:
    """Pack a layer: faces along a Morton curve, those of one image together, corners and places as met."""
    trim()
    faces = np.asarray(layer.faces, dtype=np.int64)
    order = morton_order(layer.vertices[faces].mean(axis=1))
    image = layer.skin.face_image if layer.skin is not None and layer.skin.images else None
    if image is not None:
        order = order[np.argsort(image[order], kind="stable")]
    corner = faces[order].ravel()
    places = np.clip(np.rint((layer.vertices - origin) / step), 0, _MOST_STEPS).astype(np.int32)
    index, kept = corner_keys(places[corner], layer.skin, order)
    used, members = _places(packer, layer, order)
    return {
        "key": layer.key,
        "label": layer.label,
        "shown": layer.shown,
        "marked": layer.is_marked,
        "paint": _category(layer.paint),
        "facts": dict(layer.facts or {}),
        "faces": len(faces),
        "index": packer.add(index, is_index=True),
        "corners": packer.add(places[corner[kept]]),
        **skin_entry(packer, layer.skin, order, kept),
        "images": add_images(packer, layer.skin, order),
        "place": used,
        "channels": [_channel(packer, channel, members) for channel in layer.channels],
        "sightings": _sightings(packer, layer.sightings, members),
    }


def _places(packer: Packer, layer: Layer, order: Any) -> tuple[dict[str, Any] | None, Any]:
    """Pack the place of each face, in order, and return the places that there are; None: each its own."""
    if layer.place is None:
        return None, order
    index, members = by_appearance(np.asarray(layer.place, dtype=np.int64)[order])
    return packer.add(index, is_index=True), members


def _channel(packer: Packer, channel: Classes | Numbers, members: Any) -> dict[str, Any]:
    """Pack the values of a channel at the places `members`."""
    named = {"key": channel.key, "label": channel.label, "kind": channel.kind}
    if isinstance(channel, Classes):
        return {
            **named,
            "categories": [_category(category) for category in channel.categories],
            "values": packer.add(channel.values[members]),
            "since": None if channel.since is None else packer.add(channel.since[members]),
            "before": channel.before,
            "hides": channel.can_hide,
        }
    values = channel.values[members]
    known = np.isfinite(values)
    scale = 10.0**-channel.digits / 10  # a tenth of what is read out
    low = float(values[known].min()) if known.any() else 0.0
    steps = np.zeros(len(values), np.int64)
    steps[known] = 1 + np.rint((values[known] - low) / scale).astype(np.int64)
    return {
        **named,
        "unit": channel.unit,
        "values": packer.add(steps),
        "base": low - scale,
        "scale": scale,
        "low": channel.low,
        "high": channel.high,
        "digits": channel.digits,
        "absent": channel.absent,
        "limit": channel.limit,
        "reversed": channel.small_is_good,
    }


def _sightings(packer: Packer, sightings: Sightings | None, members: Any) -> dict[str, Any] | None:
    """Pack the sightings of the places `members`."""
    if sightings is None:
        return None
    counts = np.diff(sightings.start)[members]
    ends = np.cumsum(counts)
    at = np.arange(int(counts.sum())) - np.repeat(ends - counts, counts)
    at += np.repeat(sightings.start[:-1][members], counts)
    return {
        "counts": packer.add(counts),
        "views": packer.add(sightings.view[at]),
        "angles": packer.add(np.rint(sightings.incidence_deg[at] / _SIGHTING_DEG).astype(np.int64)),
        "step": _SIGHTING_DEG,
    }


def _category(category: Any) -> dict[str, Any]:
    return {"label": category.label, "colour": _bytes(category.colour), "pattern": category.pattern}


def _marker(marker: Marker, origin: FloatArray) -> dict[str, Any]:
    return {
        "name": marker.name,
        "at": (marker.origin - origin).tolist(),
        "axes": marker.axes.tolist(),
        "slope": None if marker.slope is None else [float(tangent) for tangent in marker.slope],
        "cone": marker.is_cone,
        "colour": None if marker.colour is None else _bytes(marker.colour),
        "step": marker.is_step,
    }


def _lines(lines: Lines, origin: FloatArray) -> dict[str, Any]:
    return {
        "key": lines.key,
        "label": lines.label,
        "ends": np.round(lines.ends - origin, 5).reshape(-1).tolist(),
        "colour": _bytes(lines.colour),
        "shown": lines.shown,
    }


def _bytes(colour: Any) -> list[int]:
    """Colour 0..1 as 0..255."""
    return [round(255 * float(part)) for part in colour]


def _look(forward: FloatArray) -> list[float]:
    """Yaw and pitch of the direction in which a camera stands that looks forward, radians."""
    x, y, z = -forward
    return [float(np.arctan2(y, x)), float(np.arcsin(np.clip(z, -1, 1)))]


def _ramp() -> list[list[int]]:
    """Stops of the colour bar: viridis, which stays in order for every kind of colour vision and in grey."""
    return [_bytes(colormaps["viridis"](k / (_STOPS - 1))[:3]) for k in range(_STOPS)]


def decoded_header(text: str) -> Mapping[str, Any]:
    """Return the header of an encoded view."""
    data = gzip.decompress(base64.b64decode(text))
    (size,) = struct.unpack_from("<I", data)
    header: dict[str, Any] = json.loads(data[4 : 4 + size])
    return header
