# SPDX-License-Identifier: MIT
"""Depth maps: numbers as files hold them (PNG, TIFF, PGM, EXR, NPY, NPZ, COLMAP), and depth in metres."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from scenes.checks import FloatArray, InputError
from scenes.io.checks.guard import check_file, check_size, guard_reading
from scenes.io.checks.image import open_image
from scenes.io.checks.limits import check_limit
from scenes.io.clouds.npz import open_arrays
from scenes.io.poses.camera import DepthEncoding
from scenes.io.rgbd.exr import read_exr
from scenes.limits import MULTIPLES_OF_8
from scenes.scan.range_image import saturation_start

_MOST_DISPARITY = 2047  # 11 bits; that number itself means that nothing was measured
_EIGHT_BITS = 255
_FULLEST = 65535
_FULL = tuple(2**bits - 1 for bits in range(11, 16))  # what a narrower sensor writes for no return, if at all
_KINECT_M, _KINECT_OFFSET = 351.3, 1092.5  # depth = 351.3 m / (1092.5 - disparity), of the NYU toolbox
LZFSE = (
    "holds depth packed by LZFSE, which is not read here; in Record3D export the recording as EXR + JPG and "
    "give the folder EXR_RGBD"
)


def depth_in_metres(counts: FloatArray, encoding: DepthEncoding, scale: float) -> FloatArray:
    """Return z-depth in metres, 0 where nothing was measured.

    Parameters
    ----------
    counts : (rows, columns) float
        Values of the image.
    encoding : "linear", "sun3d" or "kinect-disparity"
        linear: `counts / scale`. sun3d: 16-bit counts turned left by three bits, turned back and divided by
        `scale`. kinect-disparity: raw 11-bit disparities of the first Kinect, as the NYU data hold them;
        where they exceed 11 bits the bytes of the file stand in the wrong order and are swapped.
    scale : float
        Counts a metre; of no meaning for disparities.

    Raises
    ------
    InputError
        Values that the encoding cannot hold.
    """
    if encoding == "linear":
        return counts / scale
    if not ((counts >= 0) & (counts <= 65535) & (counts == np.floor(counts))).all():
        raise InputError(f"{encoding} depth needs 16-bit integers, but the image has another type")
    words = counts.astype(np.uint16)
    if encoding == "sun3d":
        return np.asarray(((words >> 3) | (words << 13)).astype(np.float64) / scale)
    return _kinect_depth(words)


def _kinect_depth(words: NDArray[np.uint16]) -> FloatArray:
    if words.max() > _MOST_DISPARITY:
        words = words.byteswap()
    if words.max() > _MOST_DISPARITY:
        raise InputError(f"kinect-disparity has 11 bits, the image holds {int(words.max())}")
    disparity = words.astype(np.float64)
    known = (disparity > 0) & (disparity < _KINECT_OFFSET - 1)
    return np.where(known, _KINECT_M / (_KINECT_OFFSET - np.where(known, disparity, 0.0)), 0.0)


def depth_warnings(counts: FloatArray) -> tuple[str, ...]:
    """Return a warning where an image (rows, columns) of more bits holds only 8: depths are steps then."""
    known = counts[np.isfinite(counts) & (counts != 0)]
    if not len(known) or known.max() > _EIGHT_BITS or (known != np.floor(known)).any():
        return ()
    return (f"its depths are whole numbers up to {known.max():g}: 8-bit depth in a wider image?",)


def without_codes(counts: FloatArray) -> tuple[FloatArray, tuple[str, ...]]:
    """Return an image (rows, columns) whose numbers for no return are 0, and a warning where there are some.

    65535 is one always: a 16-bit number that is full. So is a narrower one, 2^11 - 1 to 2^15 - 1, that is
    the largest, there over and over, and far beyond all others.
    """
    full = counts == _FULLEST
    known = counts[(counts > 0) & (counts < _FULLEST)]
    start = saturation_start(known) if len(known) else np.inf
    if start in _FULL and known.max() == start:
        full |= counts == start
    if not full.any():
        return counts, ()
    codes = ", ".join(f"{code:g}" for code in np.unique(counts[full]))
    return np.where(full, 0.0, counts), (
        f"{int(full.sum())} of {counts.size} depths are {codes}: a full number, which means no return, and "
        "were left out",
    )


def suspected_encoding(counts: FloatArray) -> str:
    """Return why the counts (rows, columns) may be no linear depth, "" where nothing speaks against it."""
    known = counts[counts > 0]
    if not len(known) or not (known == np.floor(known)).all() or known.max() > 65535:
        return ""
    eighth = float(np.mean(known % 8 == 0))
    if len(np.unique(known)) > 8 and eighth > MULTIPLES_OF_8 and known.max() > 8192:
        return (
            f"{eighth:.0%} of its values are multiples of 8, as SUN3D's are, whose bits are turned: if so, "
            'say "depth_encoding": "sun3d" in camera.json'
        )
    swapped = known.astype(np.uint16).byteswap()
    if known.max() > _MOST_DISPARITY >= swapped.max():
        return (
            "its bytes stand in the wrong order, as in NYU's raw Kinect disparities: if so say "
            '"depth_encoding": "kinect-disparity" in camera.json'
        )
    return ""


def read_depth_image(path: Path) -> NDArray[Any]:
    """Return the numbers (rows, columns) of a depth map, unscaled and of the file's own type.

    Whole numbers are counts; floats are metres where no scale is stated.

    Raises InputError: no image of one channel, damaged, too large, of 8 bits, or packed by LZFSE.
    """
    with guard_reading(path, "a depth image"):
        counts = np.squeeze(_READERS.get(path.suffix.lower(), _read_image)(path))
    if counts.ndim != 2 or counts.dtype.kind not in "iuf":
        raise InputError(f"{path}: holds {counts.dtype} of shape {counts.shape}; expected one depth a pixel")
    return counts


def _read_image(path: Path) -> NDArray[Any]:
    with open_image(path, "a depth image") as image:
        if not image.mode.startswith(("I", "F")):
            raise InputError(
                f"has mode {image.mode} (8 bits a channel), which cannot hold depth; "
                "a depth image has one channel of 16 bits"
            )
        return np.asarray(image)


def _read_array(path: Path) -> NDArray[Any]:
    """The array of a .npy, or the one of a .npz that is called depth, or its only one; never a pickle."""
    if path.suffix.lower() == ".npy":
        array = np.load(check_file(path), mmap_mode="r", allow_pickle=False)
        check_limit("pixels", array.size, "its depths")
        return np.array(array)
    with open_arrays(path) as arrays:
        name = "depth" if "depth" in arrays.files else arrays.files[0]
        if name != "depth" and len(arrays.files) > 1:
            raise InputError(f"holds the arrays {', '.join(arrays.files)}; call the one of depth 'depth'")
        return np.asarray(arrays[name])


def _read_colmap_map(path: Path) -> NDArray[Any]:
    """A map of COLMAP's dense reconstruction: `width&height&channels&`, then float32, row by row."""
    data = check_file(path).read_bytes()
    words = data[:64].split(b"&", 3)
    width, height, n_channels = (int(word) for word in words[:3])
    check_size(height, width)
    start = sum(map(len, words[:3])) + 3
    if n_channels != 1 or len(data) - start != 4 * width * height:
        raise InputError(
            f"has {len(data) - start} bytes for {width} x {height} depths of {n_channels} channels: it is "
            "truncated, or no depth map"
        )
    return np.frombuffer(data, "<f4", offset=start).reshape(height, width)


def _refuse_lzfse(_: Path) -> NoReturn:
    raise InputError(LZFSE)


_READERS: Mapping[str, Callable[[Path], NDArray[Any]]] = {
    ".npy": _read_array,
    ".npz": _read_array,
    ".exr": read_exr,
    ".bin": _read_colmap_map,
    ".depth": _refuse_lzfse,
}
DEPTH_SUFFIXES = (".png", ".tif", ".tiff", ".pgm", ".ppm", ".bmp", ".jpg", ".jpeg", *_READERS)
