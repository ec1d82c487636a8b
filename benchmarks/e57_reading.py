# SPDX-License-Identifier: MIT
"""Reading a large E57: CPU seconds and peak memory above what the libraries take, for scans of several sizes.

Two writers: ours (double precision, points on their rays, projection in the header) and one like a scanner's
(single precision, column by column, points a little off the rays, no projection). Both with colours and
intensities. Each is read in a process of its own; told beside are what memory holds afterwards and how large
the scan is.
Run by `make bench`, or alone:

    python benchmarks/e57_reading.py [MILLIONS OF PIXELS ...]
"""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pye57

from scenes.io.grid_fit import SCANNER_FROM_SENSOR
from scenes.io.scan_files import read_scan, write_scan
from scenes.pose import Pose
from scenes.scan.colour import colour_bytes
from scenes.scan.projection import SphericalProjection
from scenes.scan.range_image import RangeImage

WALLS = np.array([4.0, 1.2, 3.0]), np.array([-4.0, -1.8, -3.0])  # of a box about the scanner, metres
SIGMA_M, OFF_RAYS_M, LOST = 0.002, 3e-4, 0.02


def room(millions: float) -> RangeImage:
    """A box from inside: ranges with noise, some without return."""
    rows = int(np.sqrt(millions * 1e6 / 2))
    projection, rng = (
        SphericalProjection.regular(2 * rows, rows, 360.0, (-60.0, 60.0)),
        np.random.default_rng(0),
    )
    rays = projection.directions()
    with np.errstate(divide="ignore"):
        ranges = np.where(rays > 0, WALLS[0] / rays, WALLS[1] / rays).min(axis=-1)
    ranges += rng.normal(0, SIGMA_M, ranges.shape)
    ranges[rng.random(ranges.shape) < LOST] = np.inf
    colour = np.rint(np.abs(rays) * 255).astype(np.float32) / 255
    light = rng.random(ranges.shape, np.float32)
    return RangeImage(ranges, projection, Pose.identity(), colour=colour, intensity=light)


def write_as_scanners_do(scan: RangeImage, path: Path) -> None:
    """Points in single precision, column by column."""
    column, row = np.nonzero(scan.valid.T)
    points = SCANNER_FROM_SENSOR.apply(scan.points_in_sensor()[row, column])
    points += np.random.default_rng(1).normal(0, OFF_RAYS_M, points.shape)
    data = {f"cartesian{axis}": points[:, k].astype(np.float32) for k, axis in enumerate("XYZ")}
    for k, name in enumerate(("Red", "Green", "Blue")):
        data[f"color{name}"] = colour_bytes(scan.colour[row, column, k])
    data |= {"rowIndex": row.astype(np.uint16), "columnIndex": column.astype(np.uint16)}
    data["intensity"] = scan.intensity[row, column]
    file = pye57.E57(str(path), mode="w")
    file.write_scan_raw(data, name="scanner", rotation=np.array([1.0, 0, 0, 0]), translation=np.zeros(3))
    file.close()


def peak_bytes() -> int:
    """The most that this process had in memory; getrusage would count what its parent had."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return 1024 * next(int(line.split()[1]) for line in lines if line.startswith("VmHWM"))


def resident_bytes() -> int:
    """What this process has in memory now."""
    return 1024 * next(
        int(line.split()[1])
        for line in Path("/proc/self/status").read_text().splitlines()
        if line.startswith("VmRSS")
    )


def measure(small: str, large: str) -> None:
    """Read a small scan, so that all is loaded, then a large one; print what the second took."""
    read_scan(small)
    before, at_first, started = peak_bytes(), resident_bytes(), time.process_time()
    scan = read_scan(large)
    seconds = time.process_time() - started
    peak, after = peak_bytes() - before, resident_bytes() - at_first
    arrays = (scan.ranges, scan.colour, scan.intensity, scan.sensor_points)
    held = sum(array.nbytes for array in arrays if array is not None)
    n = int(scan.valid.sum())
    print(
        f"  {n / 1e6:6.2f} M points {seconds:7.2f} s CPU {peak / 1e6:7.0f} MB at the peak, "
        f"{after / 1e6:.0f} MB afterwards; the scan is {held / 1e6:.0f} MB"
    )


def main(sizes: list[float]) -> None:
    """Write the scans, and read each in a new process."""
    writers = {"ours": write_scan, "a scanner's": write_as_scanners_do}
    with TemporaryDirectory() as folder:
        small = room(0.01)
        for name, write in writers.items():
            print(name, flush=True)
            write(small, Path(folder, "small.e57"))
            for millions in sizes:
                write(room(millions), Path(folder, "large.e57"))
                files = [str(Path(folder, file)) for file in ("small.e57", "large.e57")]
                subprocess.run([sys.executable, __file__, "--measure", *files], check=True)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--measure"]:
        measure(*sys.argv[2:])
    else:
        main([float(word) for word in sys.argv[1:]] or [1.0, 3.27, 20.0])
