# SPDX-License-Identifier: MIT
"""Encoding of the 3-D view: a JSON header and packed arrays, gzipped, as base64; the same bytes each time.

No name stands in the page as text of its own: base64 cannot end a script or begin a comment.
"""

from __future__ import annotations

import base64
import gzip
import json
import struct
from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib import colormaps

from nbv.report.viewer.block import Lines, Marker, Viewer, best_camera, focus
from nbv.report.viewer.byte_packing import Packer, add_images, by_appearance, corner_keys, skin_entry
from nbv.report.viewer.layers import Classes, Layer, Numbers, Sightings
from scenes.checks import FloatArray
from scenes.mesh.blocks import morton_order
from scenes.run.mapping import trim

_FINEST_M = 0.00025  # step of the coordinates in large scenes; small ones have 2^16 steps
_MOST_STEPS = 2**24  # what a 32-bit float of the graphics card holds
_LEVEL = 6  # of gzip: 9 takes four times as long for 1 %
_STOPS = 17  # of a colour bar
_SIGHTING_DEG = 0.5


def encoded(viewer: Viewer) -> str:
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
        "one": viewer.one,
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
