# SPDX-License-Identifier: MIT
"""Clouds: points as files hold them, and a scan's returns as points, each with its pixel, and back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenes.checks import ColourArray, FloatArray, InputError
from scenes.formats.header import (
    colour_bytes,
    colour_from_bytes,
    described,
    point_warnings,
    pose_from_header,
    projection_from_dict,
    scan_header,
)
from scenes.formats.scans.grid_fit import organised_scan
from scenes.scan.range_image import RangeImage

NO_RAYS = (
    "holds points without a pixel grid or sensor position, so no ray can be traced; say where the scanner "
    "stood (--origin X,Y,Z), or export the scan as structured .e57, .ptx, or organised .pcd"
)


@dataclass(frozen=True, slots=True, eq=False)
class RawPoints:
    """Points as a file holds them.

    Attributes
    ----------
    points : (n, 3) float
        In the world, NaN where the file says so.
    normals : (n, 3) float, optional
        As in the file.
    origins : (3,) or (n, 3) float, optional
        Where the scanner stood, once or for each point; None where the file does not tell.
    colour : (n, 3) uint8, optional
        sRGB.
    warnings : tuple of str
        What was left out or assumed.
    """

    points: FloatArray
    normals: FloatArray | None = None
    origins: FloatArray | None = None
    colour: ColourArray | None = None
    warnings: tuple[str, ...] = ()


def joined(parts: Sequence[RawPoints]) -> RawPoints:
    """Return the points of several scans one after the other; what not all of them know is left out."""
    points = np.concatenate([np.zeros((0, 3)), *(part.points for part in parts)])
    stood = [np.broadcast_to(part.origins, part.points.shape) for part in parts if part.origins is not None]
    colour = [part.colour for part in parts if part.colour is not None]
    return RawPoints(
        points,
        None,
        np.concatenate(stood) if stood and len(stood) == len(parts) else None,
        np.concatenate(colour) if colour and len(colour) == len(parts) else None,
    )


@dataclass(frozen=True, slots=True, eq=False)
class Cloud:
    """The returns of a scan, row by row.

    Attributes
    ----------
    points : (n, 3) float
        World coordinates, metres.
    row, column : (n,) int64
        The pixel of each.
    header : mapping
        What else is known of the scan; see `scenes.formats.header`.
    colour : (n, 3) uint8, optional
        sRGB.
    intensity : (n,) float32, optional
        On the instrument's scale.
    """

    points: FloatArray
    row: NDArray[np.int64]
    column: NDArray[np.int64]
    header: Mapping[str, Any]
    colour: ColourArray | None = None
    intensity: NDArray[np.float32] | None = None


def cloud_of(scan: RangeImage) -> Cloud:
    """Return the returns of a scan.

    Raises InputError: there is none: a file of points cannot hold an empty grid.
    """
    if not scan.valid.any():
        raise InputError(f"scan {scan.name!r} has no return; a file of points would be empty, use .npz")
    row, column = np.nonzero(scan.valid)
    colour = colour_bytes(scan)
    return Cloud(
        points=scan.points()[scan.valid],
        row=row,
        column=column,
        header=scan_header(scan),
        colour=None if colour is None else colour[scan.valid],
        intensity=None if scan.intensity is None else scan.intensity[scan.valid],
    )


def scan_of(cloud: Cloud) -> RangeImage:
    """Return the scan that a cloud was made of.

    Raises InputError: pixels outside the image that the header describes, or two points in one.
    """
    header = dict(cloud.header)
    projection, pose = projection_from_dict(header["projection"]), pose_from_header(header)
    rows, columns = projection.shape
    if rows * columns > 1000 * len(cloud.points) + 1_000_000:
        raise InputError(
            f"{len(cloud.points)} points in a grid of {rows} x {columns}: is its header damaged?"
        )
    pixel = cloud.row * columns + cloud.column
    inside = (cloud.row >= 0) & (cloud.row < rows) & (cloud.column >= 0) & (cloud.column < columns)
    if not inside.all() or len(np.unique(pixel)) < len(pixel):
        raise InputError(
            f"its points do not each have a pixel of their own in {rows} x {columns}: was the file edited? "
            "say where the scanner stood (--origin X,Y,Z)"
        )
    points = np.full((rows, columns, 3), np.nan)
    points[cloud.row, cloud.column] = pose.inverse().apply(cloud.points)
    colour = light = None
    if cloud.colour is not None:
        colour = np.zeros((rows, columns, 3), np.float32)
        colour[cloud.row, cloud.column] = colour_from_bytes(cloud.colour)
    if cloud.intensity is not None:
        light = np.zeros((rows, columns), np.float32)
        light[cloud.row, cloud.column] = cloud.intensity
    scan = organised_scan(
        points, projection, world_from_sensor=pose, colour=colour, name="scan", intensity=light
    )
    return replace(described(scan, header), warnings=point_warnings(cloud.points))
