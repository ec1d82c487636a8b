# SPDX-License-Identifier: MIT
"""A scan whose pixels are in a file is the same scan as one in memory, and takes no memory of its size."""

from __future__ import annotations

import copy
import io
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from scenes.io.scan_files import in_metres, read_scan, write_scan
from scenes.pose import Pose
from scenes.run import journal as packing
from scenes.run import mapping
from scenes.run.journal import pack, unpack
from scenes.run.mapping import is_mapped
from scenes.scan import pixels
from scenes.scan.range_image import TRUTH_CHANNELS, RangeImage
from tests.helpers.scan_examples import PROJECTIONS, assert_same_scan, example_scan

MOVED = Pose.looking_at([4.0, 5.0, 6.0], [0.0, 0.0, 1.0])
FEW = 50  # pixels


@pytest.fixture
def few_are_many(monkeypatch: pytest.MonkeyPatch) -> None:
    """Small scans are mapped too."""
    monkeypatch.setattr(mapping, "LARGE", FEW)
    monkeypatch.setattr(pixels, "LARGE", FEW)
    monkeypatch.setattr(packing, "_LEAST", FEW)  # small arrays stand together otherwise, and in memory


def arrays_of(scan: RangeImage) -> dict[str, np.ndarray]:
    held = {name: getattr(scan, name) for name in ("ranges", "colour", "sensor_points", "intensity")}
    if scan.truth is not None:
        held |= {f"truth {name}": getattr(scan.truth, name) for name in TRUTH_CHANNELS}
    return {name: array for name, array in held.items() if array is not None}


def assert_same(first: RangeImage, second: RangeImage, *, mapped: bool = True) -> None:
    """Fail unless all arrays are equal, those of the second scan mapped and read-only."""
    arrays = arrays_of(second)
    assert arrays_of(first).keys() == arrays.keys()
    for name, array in arrays_of(first).items():
        np.testing.assert_array_equal(array, arrays[name])
        assert array.dtype == arrays[name].dtype
        assert is_mapped(arrays[name]) == mapped
        assert not arrays[name].flags.writeable
    np.testing.assert_array_equal(first.rays(), second.rays())
    np.testing.assert_array_equal(first.points(), second.points())


@pytest.mark.usefixtures("few_are_many")
@pytest.mark.parametrize("off_rays_m", [0.0, 0.01])
@pytest.mark.parametrize("kind", PROJECTIONS)
def test_mapped_and_in_memory_are_equal(kind, off_rays_m, monkeypatch):
    mapped = example_scan(PROJECTIONS[kind], off_rays_m=off_rays_m, truth=True)
    for name in (mapping, pixels):
        monkeypatch.setattr(name, "LARGE", 10**9)
    plain = example_scan(PROJECTIONS[kind], off_rays_m=off_rays_m, truth=True)
    assert_same(plain, mapped)
    assert_same(mapped, plain, mapped=False)
    assert_same(plain.transform(MOVED), mapped.transform(MOVED))


@pytest.mark.usefixtures("few_are_many")
def test_what_is_made_of_a_mapped_scan_is_mapped():
    scan = example_scan(PROJECTIONS["panorama"], off_rays_m=0.01, truth=True)
    stream = io.BytesIO()
    pack(scan, stream)
    for same in (pickle.loads(pickle.dumps(scan)), copy.deepcopy(scan), unpack(stream)):
        assert_same(scan, same)
    assert_same(in_metres(scan, "mm"), in_metres(scan, "mm"))
    assert copy.copy(scan).ranges is scan.ranges


def test_a_scan_that_is_moved_keeps_the_same_arrays():
    scan = example_scan(PROJECTIONS["panorama"], off_rays_m=0.01, truth=True)
    moved = scan.transform(MOVED)
    assert moved.ranges is scan.ranges
    assert moved.sensor_points is scan.sensor_points
    np.testing.assert_allclose(moved.points(), MOVED.apply(scan.points()), atol=1e-12)
    assert (scan.with_facts(name="b").name, scan.name) == ("b", "küche <b>")
    with pytest.raises(ValueError, match="sigma_m must be 0 or more"):
        scan.with_facts(sigma_m=-1.0)
    with pytest.raises(TypeError, match="ranges: only world_from_sensor, sigma_m"):
        scan.with_facts(ranges=scan.ranges)


@pytest.mark.parametrize("colour", ["bytes", "float"])
@pytest.mark.parametrize("suffix", [".npz", ".e57", ".ptx", ".pcd", ".las", ".laz", ".ply", ".csv"])
def test_a_file_is_read_to_the_same_scan(tmp_path, suffix, colour, monkeypatch):
    scan = example_scan(PROJECTIONS["panorama"], off_rays_m=0.0 if suffix == ".las" else 0.01)
    if colour == "bytes":
        scan = RangeImage(
            scan.ranges,
            scan.projection,
            scan.world_from_sensor,
            colour=np.rint(255 * scan.colour).astype(np.uint8),
            sensor_points=scan.sensor_points,
            intensity=np.where(scan.valid, 0.25, 0),
        )
    write_scan(scan, tmp_path / f"a{suffix}")
    plain = read_scan(tmp_path / f"a{suffix}")
    for name in (mapping, pixels):
        monkeypatch.setattr(name, "LARGE", FEW)
    assert_same(plain, read_scan(tmp_path / f"a{suffix}"))
    assert plain.colour.dtype == (np.float32 if (suffix, colour) == (".npz", "float") else np.uint8)
    if suffix != ".ptx":  # its grid is fitted anew
        assert_same_scan(plain, scan, 1e-5)


PEAK = """
import numpy as np
from pathlib import Path
from scenes.pose import Pose
from scenes.run.mapping import allocate
from scenes.scan.projection import SphericalProjection
from scenes.scan.range_image import RangeImage

def peak():
    lines = Path("/proc/self/status").read_text().splitlines()
    return 1024 * next(int(line.split()[1]) for line in lines if line.startswith("VmHWM"))

def scan(rows):
    shape = rows, 2 * rows
    points, colour = allocate((*shape, 3), np.float32), allocate((*shape, 3), np.uint8, 9)
    for row in points:
        row[:, 2] = 2
    points.setflags(write=False)
    colour.setflags(write=False)
    projection = SphericalProjection.regular(shape[1], shape[0], 360.0, (-60.0, 60.0))
    made = RangeImage.from_points(points, projection, Pose.identity(), colour).transform(Pose.identity())
    return sum(array.nbytes for array in (made.ranges, made.sensor_points, made.colour))

scan(600)
before = peak()
n_bytes = scan(1600)
print(n_bytes, peak() - before)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_memory_holds_a_small_part_of_a_large_scan():
    run = subprocess.run([sys.executable, "-c", PEAK], capture_output=True, text=True, check=True)
    n_bytes, above = map(int, run.stdout.split())
    assert n_bytes > 110e6
    assert above < 0.6 * n_bytes


@pytest.mark.long
@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_memory_holds_a_small_part_of_a_large_file():
    folder = Path(__file__).parents[3]
    command = [sys.executable, "-m", "benchmarks", "run", "--fresh", "e57", "--millions", "8"]
    run = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True)
    rows = [line.split("|") for line in run.stdout.splitlines()[2:]]
    assert len(rows) == 2
    assert all(float(cells[4]) < 120 for cells in rows)
