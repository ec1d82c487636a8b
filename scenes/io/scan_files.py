# SPDX-License-Identifier: MIT
"""Scan files: reads and writes organised scans by suffix, one scan of several by PATH#k."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path, PureWindowsPath

import numpy as np

from scenes.checks import InputError
from scenes.io.checks.guard import check_file, guard_reading
from scenes.io.clouds.uos import is_uos, open_uos, read_uos
from scenes.io.formats.format import (
    METRES_PER_UNIT,
    NO_RAYS,
    Intrinsics,
    ScanReader,
    Units,
    check_own_unit,
    check_units,
    empty_warnings,
    format_of,
    scan_suffixes,
    written_suffixes,
)
from scenes.io.meshes.mesh_file import MESH_SUFFIXES
from scenes.io.poses.trajectory import poses_at, read_named_poses, read_poses
from scenes.io.rgbd.frames import read_frame
from scenes.io.rgbd.layouts import open_rgbd
from scenes.io.rgbd.writer import Layout, write_rgbd
from scenes.pose import Pose
from scenes.run.mapping import NoSpill, Spill, trim
from scenes.scan.pixels import scale_pixels
from scenes.scan.range_image import RangeImage, without_saturated

_FEW = 8  # scans that are read together into memory; of more, the pixels are in files


@dataclass(frozen=True, slots=True)
class ScanSource:
    """A file or folder of scans, opened but not read.

    Attributes
    ----------
    path : Path
        Without `#k`.
    kind : str
        The suffix: "npz", "e57" and so on, or "rgbd (plain)" and the like.
    readers : tuple of functions
        One a scan, in natural order; each reads and returns its scan, or raises InputError.
    registered : bool
        False when frames of a folder have no poses.
    times : tuple of float, optional
        When each was taken, seconds, where a folder tells.
    unit : str, optional
        Of its lengths, where the format fixes one; the readers give metres then.
    numbers : tuple of int
        The number of each reader's scan in the file, from 1; unless given, 1 to as many as there are.
    warnings : tuple of str
        Which scans of the file have no points, so that there is no reader for them.
    images : tuple of tuple of Path, optional
        Those of each scan, by whose names poses may be given.
    moves : bool
        Whether poses that are given are those of the file's own axes, not of a sensor's.
    """

    path: Path
    kind: str
    readers: tuple[ScanReader, ...]
    registered: bool = True
    times: tuple[float, ...] | None = None
    unit: Units | None = None
    numbers: tuple[int, ...] = ()
    warnings: tuple[str, ...] = ()
    images: tuple[tuple[Path, ...], ...] | None = None
    moves: bool = False

    def number(self, index: int) -> int:
        """Return the number in the file, from 1, of the scan that reader `index` reads."""
        return self.numbers[index] if self.numbers else index + 1

    def pick(self, number: int | None) -> list[int]:
        """Return the indices of all readers, or of the one for scan `number` from 1.

        Raises InputError: no scan at all, none of that number, or one without points.
        """
        held = [self.number(index) for index in range(len(self.readers))]
        if not held:
            raise InputError(f"{self.path}: holds no scan")
        if number is None:
            return list(range(len(held)))
        if number in held:
            return [held.index(number)]
        if not 1 <= number <= held[-1] and not self.warnings:
            raise InputError(f"{self.path}#{number}: there are {len(held)} scans, counted from 1")
        known = ", ".join(f"#{k}" for k in held)
        raise InputError(
            f"{self.path}#{number}: no scan with points has that number; those that have: {known}"
        )

    def read(
        self,
        number: int | None = None,
        poses: str | os.PathLike[str] | Sequence[Pose] | None = None,
        units: Units = "m",
        spill: Spill | NoSpill | None = None,
    ) -> list[RangeImage]:
        """Return all scans, or scan `number` from 1; poses and units as for `read_scans`.

        Their arrays are where `spill` keeps them; unless given, that is as `spill_for` says.

        Raises InputError: damaged, no such scan, several frames without poses, or poses of another number.
        """
        picked, given, sentences = self.pick_posed(number, poses)
        if given is None and not self.registered and len(picked) > 1:
            raise InputError(
                f"{self.path}: {len(picked)} frames without poses; give --poses FILE, put a pose.txt there, "
                "or pick one frame with PATH#k"
            )
        where = spill_for(len(picked)) if spill is None else spill
        scans = [keep_scan(self.readers[k](), where) for k in picked]
        if number is None:
            scans[0] = scans[0].add_warnings(self.warnings)
        if given is not None:
            scans = [
                scan.transform(pose) if self.moves else scan.with_facts(world_from_sensor=pose)
                for scan, pose in zip(scans, given, strict=True)
            ]
            scans[0] = scans[0].add_warnings(sentences)
        return [self.in_metres(scan, units) for scan in scans]

    def pick_posed(
        self, number: int | None = None, poses: str | os.PathLike[str] | Sequence[Pose] | None = None
    ) -> tuple[list[int], list[Pose] | None, tuple[str, ...]]:
        """Return which scans, from 0, are read, their poses where these are given, and which are left out.

        All scans, or scan `number` from 1; where poses are given by name, those that have one.

        Raises InputError: no such scan, poses of another number, or of other names.
        """
        picked = self.pick(number)
        file = Path(poses) if self.images and isinstance(poses, str | os.PathLike) else None
        named = None if file is None else read_named_poses(file)
        if file is None or named is None or self.images is None:
            return picked, _given_poses(poses, self, picked), ()
        with guard_reading(file, "a file of poses"):
            pose_of = _match_images(self.images, named)
        held = [k for k in picked if k in pose_of]
        if not held:
            first = self.images[picked[0]][0].name
            raise InputError(
                f"{file}: none of its {len(named)} images, as {next(iter(named))!r}, is one of the "
                f"{len(picked)} frames asked for, as {first!r}; name images as the files are named"
            )
        n_left = len(picked) - len(held)
        sentence = f"{n_left} of {len(picked)} frames have no pose in {file.name} and were left out"
        return held, [pose_of[k] for k in held], (sentence,) if n_left else ()

    def in_metres(self, scan: RangeImage, units: Units) -> RangeImage:
        """Return a scan of it, whose lengths are in `units`, in metres.

        Raises InputError: other units than the format's own.
        """
        if self.unit is None:
            return in_metres(scan, units)
        check_own_unit(self.path, self.kind, self.unit, units)
        return scan


def spill_for(n_scans: int) -> Spill | NoSpill:
    """Return where the arrays of so many scans are kept: of more than eight, on disk."""
    return Spill() if n_scans > _FEW else NoSpill()


def keep_scan(scan: RangeImage, spill: Spill | NoSpill) -> RangeImage:
    """Return a scan with its arrays where they are kept; the memory of those on disk is free."""
    held = spill.keep(scan)
    trim()
    return held


def open_scans(
    path: str | os.PathLike[str], *, intrinsics: Intrinsics | None = None, depth_scale: float | None = None
) -> ScanSource:
    """Open a file or folder of scans; the pixels are read when a reader is called.

    Raises InputError: nothing there, empty, damaged, or of no known kind.
    """
    source = Path(path)
    if not source.exists():
        raise InputError(f"{source}: no such file or folder")
    if is_uos(source):
        return _open_3dtk(source)
    if source.is_dir():
        folder = open_rgbd(source)
        readers = [partial(read_frame, folder, k, intrinsics, depth_scale) for k in range(len(folder.frames))]
        times = tuple(frame.time for frame in folder.frames if frame.time is not None)
        timed = times if len(times) == len(readers) else None
        kind, images = f"rgbd ({folder.layout})", tuple(frame.images for frame in folder.frames)
        guarded = _guard_readers(source, kind, readers, marks_misses=True)
        return ScanSource(
            source, kind, guarded, folder.registered, timed, warnings=folder.warnings, images=images
        )
    check_file(source)
    suffix = source.suffix.lower()
    known = format_of(suffix)
    if known is None or known.scans is None:
        raise InputError(f"{source}: {_refusal(suffix)}")
    kind = known.name or suffix[1:]
    with guard_reading(source, f"{kind.upper()} scan"):
        opened = known.scans(source, intrinsics)
    filled = {number: reader for number, reader in enumerate(opened, start=1) if reader is not None}
    if opened and not filled:
        raise InputError(
            f"{source}: none of its {len(opened)} scans has a point; export them again, with points"
        )
    return ScanSource(
        source,
        kind,
        _guard_readers(source, kind, [*filled.values()], marks_misses=known.marks_misses),
        unit=known.unit,
        moves=known.is_local,
        numbers=tuple(filled),
        warnings=empty_warnings([k for k in range(1, len(opened) + 1) if k not in filled], len(opened)),
    )


def _open_3dtk(source: Path) -> ScanSource:
    folder = open_uos(source)
    readers = [partial(read_uos, folder, k) for k in range(len(folder.scans))]
    guarded = _guard_readers(source, "3dtk", readers, marks_misses=False)
    return ScanSource(source, "3dtk", guarded, folder.registered, unit="cm")


def _guard_readers(
    source: Path, kind: str, readers: Sequence[ScanReader], *, marks_misses: bool
) -> tuple[ScanReader, ...]:
    """The readers, of which none raises anything but InputError, nor takes full numbers for ranges."""

    def guard_reader(reader: ScanReader) -> RangeImage:
        with guard_reading(source, f"{kind} scan"):
            scan = reader()
            return scan if marks_misses else without_saturated(scan)

    return tuple(partial(guard_reader, reader) for reader in readers)


def _refusal(suffix: str) -> str:
    """Why a suffix is no scan, and the cure."""
    if suffix in MESH_SUFFIXES:
        return (
            f"{suffix} is a mesh, not a scan; say where scanners stood in it, --origin X,Y,Z, or simulate a "
            "scan with `unseen scan SCENE -o FILE.npz`"
        )
    held = format_of(suffix)
    if held is not None:
        return held.refusal or NO_RAYS
    known = ", ".join(scan_suffixes())
    return f"cannot read scans from {suffix or 'a file without suffix'}; known: {known}, RGB-D folders"


def split_index(path: str | os.PathLike[str]) -> tuple[Path, int | None]:
    """Split `PATH#k` into the path and k, None without; a file whose own name ends in #k is left whole.

    Examples
    --------
    >>> split_index("house.e57#2")
    (PosixPath('house.e57'), 2)
    """
    text = os.fspath(path)
    before, mark, number = text.rpartition("#")
    if not mark or Path(text).exists():
        return Path(text), None
    if not (number.isascii() and number.isdigit()):
        raise InputError(f"{text}: after # comes the number of a scan, from 1; got {number!r}")
    return Path(before), int(number)


def read_scans(
    path: str | os.PathLike[str],
    *,
    intrinsics: Intrinsics | None = None,
    depth_scale: float | None = None,
    poses: str | os.PathLike[str] | Sequence[Pose] | None = None,
    units: Units = "m",
) -> list[RangeImage]:
    """Return all scans of a file or folder, or the one that `PATH#k` names.

    Parameters
    ----------
    path : str or path
        `.npz .ply .pcd .ptx .e57 .3d .las .laz .xyz .csv` or a folder (RGB-D, 3DTK); `#k` counts from 1 in
        natural order. Files of mere points are scans where they tell the place of the scanner: ours do.
    intrinsics : (fx, fy, cx, cy), optional
        Pixels; goes before what a file or folder says. Used by folders and .pcd.
    depth_scale : float, optional
        Depth values a unit, for folders.
    poses : file or sequence of Pose, optional
        `world_from_sensor` of each scan of `path` (all of them, or as many as are picked).
    units : "mm", "cm", "m", "in", "ft" or "us-ft"
        Unit of the lengths in the file, poses included.

    Raises
    ------
    InputError
        Unusable input, several frames without poses, or poses of another number.
    """
    check_units(units)
    base, number = split_index(path)
    return open_scans(base, intrinsics=intrinsics, depth_scale=depth_scale).read(number, poses, units)


def _match_images(images: Sequence[tuple[Path, ...]], named: Mapping[str, Pose]) -> dict[int, Pose]:
    """The poses of the scans that are named, by the scans' numbers; folders and suffixes may differ.

    Raises InputError: two images of one name.
    """
    poses: dict[str, Pose] = {}
    for name, pose in named.items():
        stem = PureWindowsPath(name).stem  # either slash parts folders
        if stem in poses:
            raise InputError(f"several images are named {stem!r}, as {name!r}; give the poses of one camera")
        poses[stem] = pose
    stems = ((k, image.stem) for k, files in enumerate(images) for image in reversed(files))
    return {k: poses[stem] for k, stem in stems if stem in poses}


def _given_poses(
    poses: str | os.PathLike[str] | Sequence[Pose] | None, source: ScanSource, picked: list[int]
) -> list[Pose] | None:
    """The poses of the picked scans: one each, or for all of them; of a trajectory with times the nearest."""
    if poses is None:
        return None
    n_scans = len(source.readers)
    pose = read_poses(Path(poses)) if isinstance(poses, str | os.PathLike) else list(poses)
    if isinstance(poses, str | os.PathLike) and source.times is not None and len(pose) != n_scans:
        return poses_at(Path(poses), [source.times[k] for k in picked])
    if len(pose) == n_scans:
        return [pose[k] for k in picked]
    if len(pose) == len(picked):
        return pose
    raise InputError(f"{len(pose)} poses for {n_scans} scans; give one pose a scan")


def read_scan(
    path: str | os.PathLike[str],
    *,
    intrinsics: Intrinsics | None = None,
    depth_scale: float | None = None,
    poses: str | os.PathLike[str] | Sequence[Pose] | None = None,
    units: Units = "m",
) -> RangeImage:
    """Return the one scan of a file, or the one that `PATH#k` names; parameters as for `read_scans`.

    Raises
    ------
    InputError
        As `read_scans`, and when there are several and none was picked.
    """
    check_units(units)
    base, number = split_index(path)
    source = open_scans(base, intrinsics=intrinsics, depth_scale=depth_scale)
    n_scans = len(source.readers)
    if number is None and n_scans > 1:
        ends = f"{base}#{source.number(0)} to {base}#{source.number(n_scans - 1)}"
        raise InputError(f"{base}: holds {n_scans} scans; pick one with {ends}")
    return source.read(number, poses, units)[0]


def in_metres(scan: RangeImage, units: Units) -> RangeImage:
    """Return `scan` with all its lengths, which are in `units`, in metres."""
    factor = METRES_PER_UNIT[units]
    if factor == 1.0:
        return scan
    pose = scan.world_from_sensor
    truth = scan.truth
    return replace(
        scan,
        ranges=scale_pixels(scan.ranges, factor),
        sensor_points=None if scan.sensor_points is None else scale_pixels(scan.sensor_points, factor),
        world_from_sensor=Pose.from_parts(pose.rotation, pose.translation * factor),
        sigma_m=None if scan.sigma_m is None else scan.sigma_m * factor,
        step_m=scan.step_m * factor,
        truth=None if truth is None else replace(truth, ranges=scale_pixels(truth.ranges, factor)),
        echoes=scan.echoes and scan.echoes.scale(factor),
    )


def writer_for(target: Path, n_scans: int = 1) -> Callable[[Sequence[RangeImage], Path], None]:
    """Return what writes so many scans to a file of that suffix.

    Raises InputError: a suffix that scans are not written to, or of files that hold one scan.
    """
    known = format_of(target.suffix)
    if known is None or known.write is None:
        suffix = target.suffix or "a name without suffix"
        raise InputError(f"{target}: cannot write scans to {suffix}; known: {', '.join(written_suffixes())}")
    if n_scans > 1 and not known.several:
        raise InputError(f"{target}: holds one scan, not {n_scans}; write an .e57 file or a folder")
    return known.write


def write_scan(scan: RangeImage, path: str | os.PathLike[str]) -> None:
    """Write one scan by suffix, atomically.

    `.npz` (lossless, with truth), `.ply .pcd .ptx .e57 .las .laz`, and `.xyz .txt .asc .csv` as text;
    docs/guides/formats.md says what each keeps and to which precision.

    Raises
    ------
    InputError
        Another suffix, a folder that does not exist, a missing extra, or what the format cannot hold.
    """
    target = Path(path)
    with np.errstate(invalid="ignore"):
        writer_for(target)([scan], target)


def write_scans(
    scans: Sequence[RangeImage], path: str | os.PathLike[str], *, layout: Layout = "plain"
) -> None:
    """Write several scans to one `.e57` file, or pinhole scans of one camera to an RGB-D folder.

    Parameters
    ----------
    scans : sequence of RangeImage
        What to write.
    path : str or path
        A file by its suffix; a name without suffix is a folder.
    layout : "plain", "tum" or "redwood"
        Of a folder; see `scenes.io.rgbd.writer.write_rgbd`.

    Raises
    ------
    InputError
        Another suffix with more than one scan, or what the format cannot hold.
    """
    target = Path(path)
    if target.suffix == "":
        write_rgbd(scans, target, layout)
    elif len(scans) == 1:
        write_scan(scans[0], target)
    else:
        writer_for(target, len(scans))(scans, target)
