# SPDX-License-Identifier: MIT
"""Card of a scan: what a notebook shows of a range image."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from scenes.card.card import Card
from scenes.card.thumbnail import thumbnails
from scenes.scan.projection import PinholeProjection, SphericalProjection

if TYPE_CHECKING:
    from scenes.scan.range_image import RangeImage


def card_of_scan(scan: RangeImage) -> Card:
    """Return size, returns, ranges, place, noise and truth of a scan, with a picture of its ranges."""
    known = scan.ranges[scan.valid]
    rows, columns = scan.shape
    x, y, z = scan.origin
    figures = [
        ("pixels", f"{rows} rows, {columns} columns; {_field_of_view(scan)}"),
        ("returns", f"{known.size} of {scan.ranges.size} ({100 * known.size / scan.ranges.size:.1f} %)"),
        ("range", f"{known.min():.3f} to {known.max():.3f} m" if known.size else "nothing came back"),
        ("sensor stands at", f"{x:.3f}, {y:.3f}, {z:.3f} m"),
        ("range noise", _noise(scan.sigma_m)),
    ]
    figures += [("sensor", scan.sensor)] if scan.sensor else []
    figures += [("effects", scan.noise)] if scan.noise else []
    figures += [("truth", "known: simulated")] if scan.truth is not None else []
    return Card("Range image", scan.name, figures, pictures=thumbnails(scan))


def _noise(sigma_m: float | None) -> str:
    if sigma_m is None:
        return "not known"
    return f"sd {1000 * sigma_m:.3g} mm" if sigma_m > 0 else "none"


def _field_of_view(scan: RangeImage) -> str:
    """How wide and how high the scan looks, in words."""
    shape = scan.projection
    if isinstance(shape, PinholeProjection):
        spans = 2 * np.degrees(np.arctan([shape.width / 2 / abs(shape.fx), shape.height / 2 / abs(shape.fy)]))
    elif isinstance(shape, SphericalProjection):
        spans = np.degrees([np.ptp(shape.azimuths), np.ptp(shape.elevations)])
    else:
        return shape.kind
    return f"{shape.kind}, {spans[0]:.0f} x {spans[1]:.0f} deg"
