# SPDX-License-Identifier: MIT
"""Scan header: all of a range image but its pixels as a dict for JSON, and as comment lines."""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any

import numpy as np

from scenes.checks import FloatArray, InputError
from scenes.io.checks.documents import parse_json
from scenes.io.checks.guard import check_size
from scenes.pose import Pose
from scenes.run.atomic import to_plain
from scenes.scan.pixels import frozen_pixels, row_blocks
from scenes.scan.projection import PinholeProjection, Projection, SphericalProjection
from scenes.scan.range_image import RangeImage

FORMAT = "unseen organised scan 1"
_TAG = "unseen "
_LINE = 200  # characters; some readers cut comment lines at 255


def scan_header(scan: RangeImage) -> dict[str, Any]:
    """Return what is known of `scan` besides its pixels, ready for JSON; lengths in metres."""
    return {
        "format": FORMAT,
        "depth": "range along the ray, metres; pixel centres at integers; sensor x right, y down, z forward",
        "projection": projection_to_dict(scan.projection),
        "world_from_sensor": scan.world_from_sensor.matrix.tolist(),
        "sigma_m": scan.sigma_m,
        **({"step_m": scan.step_m} if scan.step_m else {}),
        "sensor": scan.sensor,
        "noise": scan.noise,
        "name": scan.name,
    }


def projection_to_dict(projection: Projection) -> dict[str, Any]:
    """Return `projection` ready for JSON; angles in radians.

    Raises InputError: a projection that is neither pinhole nor spherical.
    """
    if isinstance(projection, PinholeProjection):
        names = ("width", "height", "fx", "fy", "cx", "cy")
        return {"kind": "pinhole"} | {name: getattr(projection, name) for name in names}
    if isinstance(projection, SphericalProjection):
        angles = {name: getattr(projection, name).tolist() for name in ("azimuths", "elevations")}
        return {"kind": "spherical", **angles}
    raise InputError(f"cannot write a {projection.kind} projection; pinhole and spherical are known")


def projection_from_dict(values: dict[str, Any]) -> Projection:
    """Return the projection that `projection_to_dict` described."""
    if values.get("kind") == "pinhole":
        width, height = int(values["width"]), int(values["height"])
        check_size(height, width)
        return PinholeProjection(width, height, *(float(values[name]) for name in ("fx", "fy", "cx", "cy")))
    if values.get("kind") == "spherical":
        check_size(len(values["elevations"]), len(values["azimuths"]))
        return SphericalProjection(np.array(values["azimuths"]), np.array(values["elevations"]))
    raise InputError(f"unknown projection {values.get('kind')!r} in the header")


def scan_from_header(
    header: dict[str, Any],
    ranges: FloatArray,
    *,
    world_from_sensor: Pose | None = None,
    colour: Any = None,
    sensor_points: FloatArray | None = None,
    intensity: Any = None,
    truth: Any = None,
) -> RangeImage:
    """Return the scan of a header and its pixels; a pose given here replaces the header's.

    Parameters
    ----------
    header : dict
        As `scan_header` makes it.
    ranges : (rows, columns) float
        Metres along the rays, inf where nothing came back.
    world_from_sensor : Pose, optional
        Replaces the header's.
    colour, sensor_points, intensity, truth
        As in `RangeImage`.

    Raises
    ------
    InputError
        A header of another format, or pixels that do not fit it.
    """
    if header.get("format") != FORMAT:
        raise InputError(f"unknown format {header.get('format')!r}, expected {FORMAT!r}")
    held = frozen_pixels(ranges, np.float64)
    scan = RangeImage(
        held,
        projection_from_dict(header["projection"]),
        world_from_sensor or pose_from_header(header),
        colour=colour,
        sensor_points=sensor_points,
        intensity=intensity,
        truth=truth,
        warnings=range_warnings(held),
    )
    return apply_header(scan, header)


def range_warnings(ranges: FloatArray) -> tuple[str, ...]:
    """Return a warning of how many ranges or depths, of any shape, are negative; they count as no return.

    Raises InputError: most of those that are known are.
    """
    n_negative = n_known = 0
    for rows in row_blocks((*ranges.shape, 1), ranges):
        part = ranges[rows]
        n_negative += int((part < 0).sum())
        n_known += int((np.isfinite(part) & (part != 0)).sum())
    if 2 * n_negative > n_known:
        raise InputError(
            f"{n_negative} of {n_known} ranges or depths are negative: they lie behind the camera, as where "
            "z points backwards (OpenGL); turn their sign"
        )
    return (f"{n_negative} negative ranges were left out",) if n_negative else ()


def point_warnings(points: FloatArray) -> tuple[str, ...]:
    """Return a warning of how many points (..., 3) are not finite, nothing where all are."""
    finite = np.isfinite(points).all(axis=-1)
    return not_finite_warnings(int((~finite).sum()), finite.size)


def not_finite_warnings(n_bad: int, n_points: int) -> tuple[str, ...]:
    """Return a warning that `n_bad` of `n_points` points are not finite, nothing where none is."""
    return (f"{n_bad} of {n_points} points are not finite and were left out",) if n_bad else ()


def pose_from_header(header: dict[str, Any]) -> Pose:
    """Return where a header of ours says that the sensor stood."""
    return Pose(np.array(header["world_from_sensor"], dtype=np.float64))


def apply_header(scan: RangeImage, header: dict[str, Any] | None) -> RangeImage:
    """Return `scan` with what a header of ours says of sigma, sensor, noise and name."""
    if header is None:
        return scan
    sigma = header.get("sigma_m")
    return scan.with_facts(
        sigma_m=None if sigma is None else float(sigma),
        sensor=str(header.get("sensor", "")),
        noise=str(header.get("noise", "")),
        step_m=float(header.get("step_m", 0.0)),
        name=str(header.get("name", scan.name)),
    )


def to_comments(header: dict[str, Any]) -> list[str]:
    """Return `header` as comment texts of bounded length, in order; spaces in them matter."""
    text = json.dumps(to_plain(header), allow_nan=False)  # ASCII alone
    return [f"{_TAG}{text[start : start + _LINE]}|" for start in range(0, len(text), _LINE)]


def from_comments(comments: Iterable[str]) -> dict[str, Any] | None:
    """Return the header among `comments`, None where there is none."""
    parts = [c[len(_TAG) : -1] for c in comments if c.startswith(_TAG) and c.endswith("|")]
    if not parts:
        return None
    return parse_json("".join(parts), dict)


def checked_bytes(colour: Any) -> Any:
    """Return colours that are to be 0..255 as uint8, rounded; raise InputError for others."""
    values = np.asarray(colour)
    if values.size and not (values.min() >= 0 and values.max() <= 255):
        raise InputError(f"colours are to be in 0..255, got {values.min():.6g}..{values.max():.6g}")
    return np.rint(values).astype(np.uint8)
