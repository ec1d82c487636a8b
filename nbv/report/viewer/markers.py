# SPDX-License-Identifier: MIT
"""Markers and lines of the 3-D view: stations, the ways between them, openings, regions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nbv.plan.tour import Tour
from nbv.report.figures.picture import UNKNOWN
from nbv.report.viewer.layers import Colour, Lines, Marker
from nbv.run.wording import letters
from nbv.scanning.sensor import PinholeSensor, Sensor
from nbv.visibility.zones import Box, Zones
from scenes.checks import FloatArray
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection, Projection, SphericalProjection
from scenes.scan.range_image import RangeImage

_OPENING, _WAY = (0.10, 0.55, 0.45), (0.70, 0.42, 0.0)
_AROUND = np.radians(150.0)  # a field of view from here on is drawn as a ring
_BOX_EDGES = [(a, b) for a in range(8) for b in range(a + 1, 8) if (a ^ b) in (1, 2, 4)]


Look = Projection | Sensor
"""What tells a field of view: a sensor, or of a scan the geometry of its pixels."""


def projection_of(look: Look) -> Projection:
    """Return the geometry of the pixels."""
    return look.projection if isinstance(look, Sensor) else look


def is_cone(look: Look) -> bool:
    """Tell whether a field of view is a cone, not a pyramid."""
    return isinstance(look, PinholeSensor) and look.aperture == "circular"


def look_of_scan(scan: RangeImage, sensor: Sensor | None) -> Look:
    """Return what tells the field of view of a scan: `sensor` where that took it, else its pixels."""
    if sensor is None or sensor.projection.shape != scan.shape:
        return scan.projection
    return sensor if scan.sensor == sensor.name else scan.projection


def slope_of(look: Look) -> tuple[float, float] | None:
    """Tangents of half the field of view across and down; None for one that looks around."""
    if isinstance(look, PinholeSensor) and look.aperture == "circular":
        tangent = float(np.tan(np.radians(look.fov_deg) / 2))
        return tangent, tangent
    projection = projection_of(look)
    if isinstance(projection, PinholeProjection):
        return projection.width / (2 * projection.fx), abs(projection.height / (2 * projection.fy))
    if isinstance(projection, SphericalProjection):
        spans = [float(np.ptp(angles)) for angles in (projection.azimuths, projection.elevations)]
        if max(spans) < _AROUND:
            return float(np.tan(spans[0] / 2)), float(np.tan(spans[1] / 2))
    return None


def view_markers(
    poses: Sequence[Pose], looks: Sequence[Look], colours: Sequence[Colour | None] = ()
) -> tuple[Marker, ...]:
    """Views, numbered from 1."""
    colours = list(colours) or [None] * len(poses)
    return tuple(
        _marker(str(number), pose, look, colour)
        for number, (pose, look, colour) in enumerate(zip(poses, looks, colours, strict=True), 1)
    )


def given_markers(
    poses: Sequence[Pose], looks: Sequence[Look], *, are_steps: bool = False
) -> tuple[Marker, ...]:
    """Scans that had been there before, with letters as on the floor plan."""
    return tuple(
        _marker(letters(number), pose, look, UNKNOWN, is_step=are_steps)
        for number, (pose, look) in enumerate(zip(poses, looks, strict=True))
    )


def _marker(name: str, pose: Pose, look: Look, colour: Colour | None, *, is_step: bool = True) -> Marker:
    return Marker(
        name=name,
        origin=pose.translation,
        axes=pose.rotation.T,
        slope=slope_of(look),
        is_cone=is_cone(look),
        colour=colour,
        is_step=is_step,
    )


def opening_lines(outlines: Sequence[FloatArray]) -> tuple[Lines, ...]:
    """Return the closed outlines, each (n, 3), of windows and doors."""
    return _lines("openings", "openings", [polygon_sides(outline) for outline in outlines], _OPENING)


def tour_lines(tour: Tour | None) -> tuple[Lines, ...]:
    """The ways between stations."""
    legs = [] if tour is None else [np.stack([leg.path[:-1], leg.path[1:]], axis=1) for leg in tour.legs]
    return _lines("tour", "tour", [leg for leg in legs if len(leg)], _WAY)


def zone_lines(zones: Zones) -> tuple[Lines, ...]:
    """Edges of the region, and of what is to be kept out of."""
    region = [] if zones.region is None else [box_edges(zones.region)]
    kept_out = [box_edges(box) for box in zones.keep_out]
    return _lines("region", "region", region, UNKNOWN) + _lines(
        "keep-out", "keep out", kept_out, (0.6, 0.2, 0.3)
    )


def polygon_sides(outline: FloatArray) -> FloatArray:
    """Sides (n, 2, 3) of the polygon with corners (n, 3)."""
    return np.stack([outline, np.roll(outline, -1, axis=0)], axis=1)


def box_edges(box: Box) -> FloatArray:
    """Edges (12, 2, 3) of a box."""
    ends = np.stack([box.low, box.high])
    corner = np.array([[ends[k >> axis & 1, axis] for axis in range(3)] for k in range(8)])
    edges: FloatArray = corner[np.array(_BOX_EDGES)]
    return edges


def _lines(key: str, label: str, parts: Sequence[FloatArray], colour: Colour) -> tuple[Lines, ...]:
    return (Lines(key, label, np.concatenate(parts), colour),) if len(parts) else ()
