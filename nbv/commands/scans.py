# SPDX-License-Identifier: MIT
"""Scans that a command was given: all of them in one world, or refused with the cure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from scenes.checks import InputError
from scenes.files.describe_scans import scan_warnings
from scenes.files.point_files import read_points
from scenes.files.scan_files import Intrinsics, Units, open_scans, read_scans, split_index
from scenes.formats.header import colour_from_bytes
from scenes.formats.scans.station import scan_from_station
from scenes.formats.trajectory import read_poses
from scenes.pose import Pose
from scenes.scan.convention import convention_doubt
from scenes.scan.range_image import RangeImage


@dataclass(frozen=True, slots=True)
class ScanRequest:
    """Scans and how to read them.

    Attributes
    ----------
    paths : tuple of str
        Files, folders, `PATH#k`.
    intrinsics : tuple of float, optional
        fx, fy, cx, cy in pixels.
    depth_scale : float, optional
        Depth values a unit.
    poses : str, optional
        A file with one pose a scan, in the order of the paths.
    units : str
        Unit of the files.
    origins : tuple of (x, y, z)
        Where the scanner stood for each path, metres; when given, files are read as mere points.
    """

    paths: tuple[str, ...]
    intrinsics: tuple[float, ...] | None = None
    depth_scale: float | None = None
    poses: str | None = None
    units: Units = "m"
    origins: tuple[tuple[float, ...], ...] = ()

    @property
    def inputs(self) -> list[str]:
        """What the manifest lists."""
        return [*self.paths, *([self.poses] if self.poses else [])]

    def options(self) -> dict[str, Any]:
        """Return the options for manifest and report; files by name."""
        return {
            "scans": [Path(path).name for path in self.paths],
            "intrinsics": self.intrinsics,
            "depth_scale": self.depth_scale,
            "poses": None if self.poses is None else Path(self.poses).name,
            "units": self.units,
            "origins": self.origins,
        }


def read_request(request: ScanRequest) -> list[RangeImage]:
    """Return all scans of a request.

    Raises
    ------
    InputError
        Unusable files; several scans whose poses are not known.
    """
    scene = next((path for path in request.paths if path.startswith("builtin:")), None)
    if scene is not None:
        raise InputError(
            f"{scene} is a scene, not a scan; take a scan of it first: "
            f"unseen scan {scene} --at X,Y,Z --look X,Y,Z -o scan.npz"
        )
    if request.origins:
        return _read_clouds(request)
    camera: Intrinsics | None = None
    if request.intrinsics is not None:
        fx, fy, cx, cy = request.intrinsics
        camera = (fx, fy, cx, cy)
    given = _poses_of_each(request)
    scans: list[RangeImage] = []
    registered = True
    for path, poses in zip(request.paths, given, strict=True):
        scans += read_scans(
            path, intrinsics=camera, depth_scale=request.depth_scale, poses=poses, units=request.units
        )
        registered &= poses is not None or open_scans(split_index(path)[0], intrinsics=camera).registered
    at_origin = all(np.allclose(scan.world_from_sensor.matrix, np.eye(4)) for scan in scans)
    if len(scans) > 1 and (not registered or at_origin):
        raise InputError(
            f"{len(scans)} scans without poses cannot be joined; give --poses FILE with one line a scan "
            "(tx ty tz qx qy qz qw, world from sensor), or complete them one by one"
        )
    return scans


def _read_clouds(request: ScanRequest) -> list[RangeImage]:
    """Return the points of each path as a scan from the place that was said."""
    if len(request.origins) != len(request.paths):
        raise InputError(
            f"{len(request.origins)} places for {len(request.paths)} scans; give --origin X,Y,Z once a scan"
        )
    if request.poses is not None:
        raise InputError(f"{request.poses}: poses are for files that tell their own rays; leave out --origin")
    scans = []
    for path, origin in zip(request.paths, request.origins, strict=True):
        cloud = read_points(path, request.units)
        try:
            colour = None if cloud.colour is None else colour_from_bytes(cloud.colour)
            scan = scan_from_station(cloud.points, origin, cloud.name, colour)
            scans.append(replace(scan, warnings=cloud.warnings))
        except InputError as error:
            raise InputError(f"{path}: {error}") from error
    return scans


def instruments_of(scans: Sequence[RangeImage]) -> list[str]:
    """Return which sensors took the scans, and the effects that were active, as far as the files say so."""
    said = (": ".join(part for part in (scan.sensor, scan.noise) if part) for scan in scans)
    return sorted({text or "not known" for text in said})


def doubts_of(scans: Sequence[RangeImage]) -> list[str]:
    """Return what is doubtful about the scans, each with its scan's name, and about their poses."""
    doubt = convention_doubt(scans)
    found = [f"{scan.name}: {text}" for scan in scans for text in scan_warnings(scan)]
    return [*found, doubt] if doubt else found


def title_of(paths: Sequence[str]) -> str:
    """Return what a report on these scans is about."""
    names = [Path(path).name for path in paths]
    return names[0] if len(names) == 1 else f"{names[0]} and {len(names) - 1} more"


def _poses_of_each(request: ScanRequest) -> Sequence[str | list[Pose] | None]:
    """Return what `read_scans` takes as the poses of each path."""
    if request.poses is None or len(request.paths) == 1:
        return [request.poses] * len(request.paths)
    found = read_poses(Path(request.poses))
    counts = []
    for path in request.paths:
        base, number = split_index(path)
        counts.append(len(open_scans(base).readers) if number is None else 1)
    if sum(counts) != len(found):
        raise InputError(f"{request.poses}: {len(found)} poses for {sum(counts)} scans; give one pose a scan")
    ends = np.cumsum(counts)
    return [found[end - count : end] for end, count in zip(ends, counts, strict=True)]
