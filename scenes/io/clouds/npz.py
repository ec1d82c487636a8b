# SPDX-License-Identifier: MIT
"""NPZ scans: everything a range image holds, without loss; never a pickle.

The size of each array is checked against the archive's directory before numpy makes room for it.
"""

from __future__ import annotations

import math
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from scenes.checks import InputError, check_point
from scenes.io.checks.documents import parse_json
from scenes.io.checks.guard import check_file, guard_reading
from scenes.io.checks.limits import check_limit, check_unpacked
from scenes.io.formats.facts import FormatFacts
from scenes.io.formats.format import (
    Format,
    RawPoints,
    check_single,
    pick_indices,
    points_of,
    readers_of,
    write_single,
)
from scenes.io.formats.header import scan_from_header, scan_header
from scenes.io.formats.station import scan_from_station
from scenes.io.poses.trajectory import rounded_pose
from scenes.run.atomic import atomic_path, json_text
from scenes.run.mapping import allocate, fill_from
from scenes.scan.echoes import ECHO_CHANNELS, Echoes
from scenes.scan.projection import PinholeProjection
from scenes.scan.range_image import TRUTH_CHANNELS, RangeImage, ScanTruth

_KNOWN = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)  # what numpy writes; others may ask for any memory
_SUFFIX = ".npy"
_LEVEL = 1  # of packing: numpy's 6 takes 1.7 times as long, for 1.5 % less


class ArrayFile:
    """The arrays of an open `.npz` file, by name; none is read before it is asked for.

    Raises InputError: more entries or unpacked bytes than the limits allow, two arrays of one name, or an
    unknown packing.
    """

    def __init__(self, archive: zipfile.ZipFile) -> None:
        entries = archive.infolist()
        check_limit("entries", len(entries), "files in the archive")
        check_unpacked(
            sum(entry.file_size for entry in entries), sum(entry.compress_size for entry in entries), "it"
        )
        for entry in entries:
            if entry.compress_type not in _KNOWN:
                raise InputError(f"its {entry.filename!r} is packed in a way that numpy does not write")
            check_unpacked(entry.file_size, entry.compress_size, f"its {entry.filename!r}")
        self._archive = archive
        self._entries = {entry.filename.removesuffix(_SUFFIX): entry for entry in entries}
        if len(self._entries) < len(entries):
            raise InputError("holds two arrays of one name")

    @property
    def files(self) -> tuple[str, ...]:
        """Names of the arrays."""
        return tuple(self._entries)

    def __getitem__(self, name: str) -> NDArray[Any]:
        """Return an array, mapped where it is large.

        Raises InputError: there is none of that name, it holds Python objects, or its header announces
        another size than the archive holds.
        """
        if name not in self._entries:
            raise InputError(f"has no {name!r}; it holds {', '.join(self._entries) or 'nothing'}")
        entry = self._entries[name]
        with self._archive.open(entry) as stream:
            shape, is_fortran, dtype = _header(stream, name)
            announced, held = math.prod(shape) * dtype.itemsize, entry.file_size - stream.tell()
            if dtype.hasobject:
                raise InputError(f"its {name!r} holds Python objects (a pickle), which are never opened")
            if min(shape, default=1) < 0 or announced != held:
                raise InputError(
                    f"its {name!r} announces {dtype} of shape {shape}: {announced} bytes, {held} are there"
                )
            array = allocate(shape[::-1] if is_fortran else shape, dtype)
            n_there = fill_from(array, stream) + len(stream.read(1))  # at the end its checksum is looked at
            if n_there != held:
                raise InputError(f"truncated: its {name!r} is {n_there} bytes, {held} are announced")
        return array.T if is_fortran else array


def _header(stream: Any, name: str) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Shape, order and type that an array's own header announces."""
    version = npy.read_magic(stream)
    readers = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
    if version not in readers:
        raise InputError(f"its {name!r} is in version {version} of numpy's format; 1.0 and 2.0 are known")
    shape, is_fortran, dtype = readers[version](stream)
    return shape, is_fortran, dtype


@contextmanager
def open_arrays(path: Path) -> Iterator[ArrayFile]:
    """Open an `.npz` file; whatever goes wrong while it is open is an InputError that names it.

    Raises InputError: as `check_file` and `ArrayFile`; no archive, damaged.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     np.savez(Path(folder, "a.npz"), points=np.zeros((2, 3)))
    ...     with open_arrays(Path(folder, "a.npz")) as arrays:
    ...         arrays.files, arrays["points"].shape
    (('points',), (2, 3))
    """
    with guard_reading(path, "an .npz file"):
        file: BinaryIO
        with check_file(path).open("rb") as file, zipfile.ZipFile(file) as archive:
            yield ArrayFile(archive)


_OPTIONAL = ("colour", "sensor_points", "intensity")


def write_npz(scan: RangeImage, path: Path, level: int = _LEVEL) -> None:
    """Write `scan` losslessly, packed at a zlib `level` (0: not at all).

    Keys: `header` (JSON: format, projection, pose, sigma, noise, name), `ranges` along the ray in metres,
    and where known `colour`, `sensor_points`, `intensity` and the truth of a simulated scan: `truth_face`,
    `truth_surface`, `truth_ranges`, `truth_incidence` (radians), `truth_n_rays`, and for other readers, since
    they follow from the rest, `truth_points` (world coordinates) and `truth_range_error` (metres). Further
    returns are `echo_pixel` (row times columns plus column), `echo_ranges`, `echo_intensity`, `echo_n_rays`.
    """
    arrays: dict[str, Any] = {"header": np.array(json_text(scan_header(scan), indent=None))}
    arrays["ranges"] = scan.ranges
    arrays |= {name: getattr(scan, name) for name in _OPTIONAL if getattr(scan, name) is not None}
    if scan.truth is not None:
        known = [name for name in TRUTH_CHANNELS if getattr(scan.truth, name) is not None]
        arrays |= {f"truth_{name}": getattr(scan.truth, name) for name in known}
        arrays |= {"truth_points": scan.true_points(), "truth_range_error": scan.range_error()}
    if scan.echoes is not None:
        known = [name for name in ECHO_CHANNELS if getattr(scan.echoes, name) is not None]
        arrays |= {f"echo_{name}": getattr(scan.echoes, name) for name in known}
    with (
        atomic_path(path) as temporary,
        zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED, compresslevel=level) as archive,
    ):
        for name, array in arrays.items():
            with archive.open(f"{name}{_SUFFIX}", "w", force_zip64=True) as stream:
                npy.write_array(stream, np.asarray(array), allow_pickle=False)


def read_npz(path: Path) -> list[RangeImage]:
    """Return the scans of a file of ours or of mere beams (one), or with `range_tenth_mm` (several)."""
    with open_arrays(path) as arrays:
        return scans_in(arrays, path.stem)


def scans_in(arrays: ArrayFile, stem: str) -> list[RangeImage]:
    """Return the scans of an open file of that name, as `read_npz`."""
    if "header" in arrays.files and "ranges" in arrays.files:
        return [_read_ours(arrays)]
    if {"range_tenth_mm", "world_from_sensor", "intrinsics"} <= set(arrays.files):
        return _read_tenth_mm(arrays, stem)
    if {"origin", "directions", "ranges"} <= set(arrays.files):
        return [_of_beams(arrays, stem)]
    keys = ", ".join(sorted(arrays.files)) or "nothing"
    raise InputError(
        f"holds {keys}, which is no scan; expected header and ranges, or origin, directions and ranges, or "
        "range_tenth_mm, world_from_sensor and intrinsics"
    )


def _read_ours(arrays: ArrayFile) -> RangeImage:
    """One scan written by `write_npz`."""
    truth = None
    if "truth_face" in arrays.files:
        known = [name for name in TRUTH_CHANNELS if f"truth_{name}" in arrays.files]
        truth = ScanTruth(**{name: _pixels(arrays, f"truth_{name}") for name in known})
    optional: dict[str, Any] = {name: _pixels(arrays, name) for name in _OPTIONAL if name in arrays.files}
    scan = scan_from_header(
        parse_json(str(arrays["header"]), dict), _pixels(arrays, "ranges"), truth=truth, **optional
    )
    if "echo_pixel" not in arrays.files:
        return scan
    known = [name for name in ECHO_CHANNELS if f"echo_{name}" in arrays.files]
    echoes = Echoes(**{name: arrays[f"echo_{name}"] for name in known})
    return scan.with_facts(echoes=echoes.within(scan.valid))


def _pixels(arrays: ArrayFile, name: str) -> NDArray[Any]:
    """Pixels that nobody else has, and which need not be copied."""
    pixels = arrays[name]
    pixels.setflags(write=False)
    return pixels


def _read_tenth_mm(arrays: ArrayFile, stem: str) -> list[RangeImage]:
    """Several pinhole scans: ranges along the ray in 0.1 mm, 0 = none; poses; shared intrinsics."""
    ranges, poses = arrays["range_tenth_mm"], arrays["world_from_sensor"]
    fx, fy, cx, cy = (float(value) for value in arrays["intrinsics"])
    if ranges.ndim != 3 or poses.shape != (len(ranges), 4, 4):
        raise InputError(f"range_tenth_mm has shape {ranges.shape}, world_from_sensor {poses.shape}")
    camera = PinholeProjection(width=ranges.shape[2], height=ranges.shape[1], fx=fx, fy=fy, cx=cx, cy=cy)
    return [
        RangeImage(image / 1e4, camera, rounded_pose(pose), name=f"{stem}#{k}")
        for k, (image, pose) in enumerate(zip(ranges, poses, strict=True), start=1)
    ]


def _of_beams(arrays: ArrayFile, name: str) -> RangeImage:
    """A scan of mere beams: `origin` (3,), `directions` (n, 3), `ranges` (n,), perhaps `sigma_m`.

    World coordinates, metres. Directions have any length; ranges that are not finite brought nothing back.
    The image is made as of points; pixels without one had no return.
    """
    origin = check_point("origin", arrays["origin"])
    directions, ranges = (np.asarray(arrays[key], dtype=np.float64) for key in ("directions", "ranges"))
    if directions.ndim != 2 or directions.shape[1] != 3 or ranges.shape != (len(directions),):
        raise InputError(
            f"directions have shape {directions.shape}, ranges {ranges.shape}; expected (n, 3) and (n,)"
        )
    length = np.linalg.norm(directions, axis=1)
    wrong = ~(np.isfinite(length) & (length > 0))
    if wrong.any():
        raise InputError(f"{int(wrong.sum())} of {len(wrong)} directions are not finite or have no length")
    back = np.isfinite(ranges) & (ranges > 0)
    points = origin + directions[back] / length[back, None] * ranges[back, None]
    scan = scan_from_station(points, origin, name)
    if "sigma_m" not in arrays.files:
        return scan
    sigma = np.asarray(arrays["sigma_m"], dtype=np.float64)
    if sigma.size != 1 or not (np.isfinite(sigma).all() and sigma.min() >= 0):
        raise InputError(f"sigma_m is {sigma.tolist()}; give one number of metres from 0 on")
    return scan.with_facts(sigma_m=float(sigma.reshape(())))


def read_npz_points(path: Path, number: int | None) -> RawPoints:
    """Return arrays `points`, `normals` and `label` (n,), or the points of all scans or of scan `number`.

    Raises InputError: arrays of other shapes, or what `read_npz` refuses.
    """
    with open_arrays(path) as arrays:
        if "points" not in arrays.files:
            scans = scans_in(arrays, path.stem)
            return points_of([scans[index] for index in pick_indices(len(scans), number)])
        check_single(number)
        points = np.asarray(arrays["points"], dtype=np.float64)
        normals = np.asarray(arrays["normals"], np.float64) if "normals" in arrays.files else None
        label = np.asarray(arrays["label"], np.float64).ravel() if "label" in arrays.files else None
    if points.ndim < 2 or points.shape[-1] != 3 or (normals is not None and normals.shape != points.shape):
        shape = "" if normals is None else f" and normals {normals.shape}"
        raise InputError(
            f"expected points with shape (n, 3) and normals of the same, got {points.shape}{shape}"
        )
    points = points.reshape(-1, 3)
    if label is not None and len(label) != len(points):
        raise InputError(f"holds {len(label)} labels for {len(points)} points; give one a point")
    return RawPoints(points, None if normals is None else normals.reshape(-1, 3), label=label)


FORMAT = Format(
    suffixes=(".npz",),
    points=read_npz_points,
    scans=lambda path, _: readers_of(read_npz(path)),
    write=write_single(write_npz),
    marks_misses=True,
    all_returns=True,
    facts=FormatFacts(
        title="`.npz`",
        read="scans of ours; or beams: `origin` (3,), `directions` (n, 3), `ranges` (n,), perhaps `sigma_m`",
        lost="nothing; pickles are never read",
        written="scans, exactly, with truth of simulations",
        poses="in the file",
        units="metres",
        colours="in the file",
        noise="in the file, or `sigma_m`",
    ),
)
