# SPDX-License-Identifier: MIT
"""Scans of several files in one world, with their poses; of a mesh, what scanners would have seen."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenes.checks import InputError, check_point
from scenes.inclination import SignedAxis
from scenes.io.describe import scan_warnings
from scenes.io.formats.format import METRES_PER_UNIT, Units, check_units
from scenes.io.formats.station import scan_from_station
from scenes.io.meshes.mesh_file import is_mesh
from scenes.io.point_files import read_points
from scenes.io.poses.trajectory import read_named_poses, read_poses
from scenes.io.scan_files import ScanSource, open_scans, spill_for, split_index
from scenes.io.scene_files import load_scene
from scenes.io.walk import open_walk
from scenes.limits import LEAST_PIXELS, MOSTLY_SEEN, TINY_M
from scenes.mesh.orientation import Axis, world_from_file_up
from scenes.pose import Pose
from scenes.scan.convention import convention_doubt
from scenes.scan.doubts import merge_warnings
from scenes.scan.projection import SphericalProjection
from scenes.scan.range_image import MESH_SENSOR, POINTS_SENSOR, RangeImage
from scenes.world.scene import Scene

_WIDTH, _HEIGHT = 1800, 900  # pixels all round, a fifth of a degree


def scan_mesh(
    path: str | os.PathLike[str], origins: Sequence[Sequence[float]], units: Units = "m", up: str = "auto"
) -> list[RangeImage]:
    """Return a scan of a mesh from each place: all round, 1,800 x 900 pixels, without noise of its own.

    A mesh does not say which beams made it. These are those that a scanner would have had: what a maker
    closed by a guess counts as measured, and what looks into the open through a hole is not known.

    Parameters
    ----------
    path : str or path
        The mesh, in any format that `load_scene` reads; its axes stay as they are.
    origins : sequence of (3,) float
        Where scanners stand, in the file's coordinates and units.
    units : str
        Of the file.
    up : str
        Its axis that is up, where that is known to be x, y or z.

    Raises
    ------
    InputError
        An unusable mesh; a place that is not finite, or from where hardly any of it is seen.
    """
    upwards: Axis | None = "x" if up == "x" else "y" if up == "y" else "z" if up == "z" else None
    scene = load_scene(path, up=upwards, units=units)
    from_file = world_from_file_up(scene.file_up)
    projection = SphericalProjection.regular(_WIDTH, _HEIGHT, 360.0, (-90.0, 90.0))
    sentence = (
        f"{Path(path).name} is a mesh, cast at by {_WIDTH} x {_HEIGHT} rays from each place given: what its "
        "maker closed counts as measured, and no measured beam vetoes what is inferred"
    )
    scans, is_seen = [], np.zeros(len(scene.mesh.faces), np.bool_)
    for number, origin in enumerate(origins, start=1):
        stands = METRES_PER_UNIT[units] * check_point(f"place {number}", origin)
        place = from_file.apply(stands[None])[0]
        scan, faces = _seen_from(scene, Pose.looking_at(place, place + [1.0, 0.0, 0.0]), projection)
        is_seen[faces] = True
        n_met = int(scan.valid.sum())
        if n_met < LEAST_PIXELS:
            raise InputError(
                f"{path}: from {', '.join(f'{value:g}' for value in origin)} only {n_met} of "
                f"{scan.ranges.size} rays meet the mesh; give places inside of rooms, and the file's --units"
            )
        scan = scan.transform(from_file.inverse())
        name = scene.name if len(origins) == 1 else f"{scene.name} {number}"
        scans.append(replace(scan, name=name))
    areas = scene.mesh.face_areas()
    share = float(areas[is_seen].sum() / areas.sum())
    if share < MOSTLY_SEEN:
        sentence += f"; {share:.0%} of its area is seen: give --origin for each room"
    return [scans[0].add_warnings([*scene.warnings, sentence]), *scans[1:]]


def _seen_from(
    scene: Scene, pose: Pose, projection: SphericalProjection
) -> tuple[RangeImage, NDArray[np.int32]]:
    """The scan from a pose, and the faces that its rays meet."""
    rays = pose.rotate(projection.directions().reshape(-1, 3)).reshape(*projection.shape, 3)
    hits = scene.ray_caster().first_hit(pose.translation[None], rays)
    ranges = np.where(np.isfinite(hits.ranges), hits.ranges, np.inf)
    scan = RangeImage(ranges.reshape(projection.shape), projection, pose, sensor=MESH_SENSOR)
    return scan, np.unique(hits.face[hits.hit])


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
        Where the scanner stood for each path, in its own units; when given, files are read as mere points,
        and a mesh is seen from all these places.
    up : str
        The axis of the files that is up, "x" to "-z", or "auto": estimated. Nothing is turned by it.
    trajectory : str, optional
        A file of times and places of the moving scanner that measured the points of each path.
    """

    paths: tuple[str, ...]
    intrinsics: tuple[float, ...] | None = None
    depth_scale: float | None = None
    poses: str | None = None
    units: Units = "m"
    origins: tuple[tuple[float, ...], ...] = ()
    up: SignedAxis = "z"
    trajectory: str | None = None

    @property
    def inputs(self) -> list[str]:
        """What the manifest lists."""
        return [*self.paths, *(file for file in (self.poses, self.trajectory) if file)]

    @property
    def title(self) -> str:
        """What a report on these scans is about."""
        names = [Path(path).name for path in self.paths]
        return names[0] if len(names) == 1 else f"{names[0]} and {len(names) - 1} more"

    def options(self) -> dict[str, Any]:
        """Return the options for manifest and report; files by name."""
        return {
            "scans": [Path(path).name for path in self.paths],
            "intrinsics": self.intrinsics,
            "depth_scale": self.depth_scale,
            "poses": None if self.poses is None else Path(self.poses).name,
            "units": self.units,
            "origins": self.origins,
            "up": self.up,
            "trajectory": None if self.trajectory is None else Path(self.trajectory).name,
        }


@dataclass(frozen=True, slots=True, eq=False)
class GivenScans:
    """Scans in one world, and what is to be told of them.

    Attributes
    ----------
    scans : tuple of RangeImage
        All of them, lengths in metres.
    doubts : tuple of str
        What is doubtful about the scans, with a scan's name or the number of scans, and about their poses.
    instruments : tuple of str
        Which sensors took them, and the effects that were active, as far as the files say so.
    paths : tuple of str
        The path of each scan, as it was given.
    names : tuple of str
        What each scan is called: its path, with its number in the file where the path holds several.
    """

    scans: tuple[RangeImage, ...]
    doubts: tuple[str, ...]
    instruments: tuple[str, ...]
    paths: tuple[str, ...] = ()
    names: tuple[str, ...] = ()

    def pick(self, kept: Sequence[int]) -> GivenScans:
        """Return some of the scans, by number; the doubts are of all."""
        picked = {name: tuple(getattr(self, name)[k] for k in kept) for name in ("scans", "paths", "names")}
        return replace(self, **picked)

    @classmethod
    def of(cls, scans: Sequence[RangeImage]) -> GivenScans:
        """Look at scans.

        Raises InputError: one whose ranges no scanner measures, as kilometres read as metres.
        """
        for scan in scans:
            typical = float(np.median(scan.ranges[scan.valid])) if scan.valid.any() else np.inf
            if typical < TINY_M:
                raise InputError(
                    f"{scan.name}: the median range is {typical:.2g} m, which no scanner measures; give "
                    "--units, or scale the file where its unit is larger than a metre"
                )
        doubts = merge_warnings([(scan.name, scan_warnings(scan)) for scan in scans])
        convention = convention_doubt(scans)
        instruments = {": ".join(part for part in (scan.sensor, scan.noise) if part) for scan in scans}
        return cls(
            tuple(scans),
            tuple([*doubts, convention] if convention else doubts),
            tuple(sorted(text or "not known" for text in instruments)),
        )

    def with_z_up(self, up: Axis) -> GivenScans:
        """Return the scans in the world of a scene, or for planners, in which axis `up` of theirs is z."""
        turn = world_from_file_up(up)
        return self if up == "z" else replace(self, scans=tuple(scan.transform(turn) for scan in self.scans))


def read_request(request: ScanRequest, *, posed: bool = True) -> GivenScans:
    """Return all scans of a request, each file opened once, in the world of their poses.

    Parameters
    ----------
    request : ScanRequest
        The files, and how to read them.
    posed : bool
        Whether several scans must have poses; without, each is in a world of its own.

    Raises
    ------
    InputError
        Unusable files; several scans whose poses are not known, unless `posed` is off.
    """
    scene = next((path for path in request.paths if path.startswith("builtin:")), None)
    if scene is not None:
        raise InputError(
            f"{scene} is a scene, not a scan; take a scan of it first: "
            f"unseen scan {scene} --at X,Y,Z --look X,Y,Z -o scan.npz"
        )
    if request.origins and request.trajectory is not None:
        raise InputError(f"{request.trajectory}: a trajectory says where the scanner was; leave out --origin")
    if request.origins:
        scans = _read_clouds(request)
        paths = list(request.paths) * (len(scans) // len(request.paths))
        several = len(paths) > len(request.paths)
        names = [f"{path}#{k}" if several else path for k, path in enumerate(paths, start=1)]
    else:
        scans, paths, names = _read_scans(request, posed=posed)
    if posed and all(_is_at_origin(scan) for scan in scans):
        _refuse_unplaced(scans)
    new = _first_of_equals(scans) if posed else range(len(scans))
    given = GivenScans.of([scans[k] for k in new])
    if n_more := len(scans) - len(new):
        again = names[min(set(range(len(scans))) - set(new))]
        told = f"{n_more} of {len(scans)} scans, as {again}, repeat others with their poses and were left out"
        given = replace(given, doubts=(told, *given.doubts))
    return replace(given, paths=tuple(paths[k] for k in new), names=tuple(names[k] for k in new))


def _first_of_equals(scans: Sequence[RangeImage]) -> list[int]:
    """The numbers of the scans that no earlier one equals in ranges and pose; empty ones are all kept."""
    first: dict[tuple[object, ...], list[int]] = {}
    kept = []
    for number, scan in enumerate(scans):
        middle = scan.ranges[scan.shape[0] // 2].tobytes()
        alike = first.setdefault((scan.shape, scan.world_from_sensor.matrix.tobytes(), middle), [])
        if not any(np.array_equal(scans[k].ranges, scan.ranges) for k in alike) or not scan.valid.any():
            kept.append(number)
            alike.append(number)
    return kept


def _read_scans(request: ScanRequest, *, posed: bool) -> tuple[list[RangeImage], list[str], list[str]]:
    """Return the scans of each path with the poses that it or the request says, their paths and names."""
    check_units(request.units)
    if request.trajectory is not None and request.poses is not None:
        raise InputError(f"{request.poses}: a trajectory gives the places of all points; leave out --poses")
    parts = [split_index(path) for path in request.paths]
    camera = None
    if request.intrinsics is not None:
        fx, fy, cx, cy = request.intrinsics
        camera = (fx, fy, cx, cy)
    given: list[str | list[Pose] | None] = [request.poses] * len(parts)
    opened: dict[Path, ScanSource] = {}

    def source_of(base: Path) -> ScanSource:
        if base not in opened:
            opened[base] = (
                open_scans(base, intrinsics=camera, depth_scale=request.depth_scale)
                if request.trajectory is None
                else open_walk(base, request.trajectory, request.units)
            )
        return opened[base]

    counts = [len(source_of(base).readers) if number is None else 1 for base, number in parts]
    if request.poses is not None and len(parts) > 1 and not _are_named(request.poses, opened.values()):
        pose = read_poses(Path(request.poses))
        if sum(counts) != len(pose):
            raise InputError(
                f"{request.poses}: {len(pose)} poses for {sum(counts)} scans; give one pose a scan"
            )
        given = [pose[end - n : end] for end, n in zip(np.cumsum(counts), counts, strict=True)]
    scans, paths, names = list[RangeImage](), list[str](), list[str]()
    spill = spill_for(sum(counts))
    for path, (base, number), poses, count in zip(request.paths, parts, given, counts, strict=True):
        held = source_of(base).read(number, poses, request.units, spill)
        scans += held
        source = source_of(base)
        numbered = [f"{base}#{source.number(k)}" for k in source.pick_posed(number, poses)[0]]
        paths += [path] * count if len(held) == count else numbered
        names += [path] if len(held) == count == 1 and not source.warnings else numbered
    if posed and not all(source.registered for source in opened.values()) and request.poses is None:
        _refuse_unplaced(scans)
    return scans, paths, names


def _refuse_unplaced(scans: Sequence[RangeImage]) -> None:
    """Raise InputError where several scans are said not to have poses."""
    if len(scans) > 1:
        raise InputError(
            f"{len(scans)} scans without poses cannot be joined; give --poses FILE with one line a scan "
            "(tx ty tz qx qy qz qw, world from sensor), find poses by `unseen register`, in a design by "
            "`unseen check --register`, or complete them one by one"
        )


def _is_at_origin(scan: RangeImage) -> bool:
    """Whether the pose of a scan says nothing: the identity, or points about their own origin."""
    pose = scan.world_from_sensor
    is_of_points = scan.sensor.startswith(POINTS_SENSOR)
    return np.allclose(pose.translation if is_of_points else pose.matrix - np.eye(4), 0.0)


def _are_named(poses: str, sources: Iterable[ScanSource]) -> bool:
    """Whether each pose is that of an image by its name, and all scans have images."""
    return all(source.images for source in sources) and read_named_poses(Path(poses)) is not None


def _read_mesh(request: ScanRequest) -> list[RangeImage]:
    """Return what is seen of the one mesh that was given from each place that was said."""
    if len(request.paths) > 1:
        raise InputError(
            f"{request.paths[0]} and {len(request.paths) - 1} more: give one mesh alone, with --origin X,Y,Z "
            "for each place where a scanner stood"
        )
    return scan_mesh(request.paths[0], request.origins, request.units, request.up)


def _read_clouds(request: ScanRequest) -> list[RangeImage]:
    """Return the points of each path as a scan from the place that was said; a mesh from all places."""
    if any(is_mesh(path) for path in request.paths):
        return _read_mesh(request)
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
            scan = scan_from_station(
                cloud.points, np.array(origin) * cloud.metres_per_unit, cloud.name, cloud.colour
            )
            scans.append(scan.add_warnings(cloud.warnings).with_facts(step_m=cloud.step_m))
        except InputError as error:
            raise InputError(f"{path}: {'; '.join([str(error), *cloud.warnings])}") from error
    return scans
