# SPDX-License-Identifier: MIT
"""E57 by chunks: chunks of any size give the same scan; the first of several returns; float32 kept."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scenes.checks import InputError
from scenes.io.clouds import e57, e57_points
from scenes.io.clouds.e57_points import GridExtent, PointChunk
from scenes.io.point_files import read_points
from scenes.io.scan_files import read_scan, write_scan
from tests.helpers.long_cases import first_in_gate
from tests.helpers.scan_examples import PROJECTIONS, assert_same_scan, example_scan

pye57 = pytest.importorskip("pye57")
RNG = np.random.default_rng(3)


def by_others(path: Path, *, double: bool, repeated: int = 0, spoilt: int = 0) -> None:
    """An E57 by pye57's own writer, column by column, some pixels twice and some points zero."""
    scan = example_scan(PROJECTIONS["panorama"], off_rays_m=2e-4)
    column, row = np.nonzero(scan.valid.T)
    x, y, z = scan.points_in_sensor()[row, column].T
    points = np.stack([z, -x, -y], axis=-1)
    points = np.concatenate([points, points[:repeated] * 1.1])
    if spoilt:
        points[:spoilt] = 0
    row, column = (np.concatenate([at, at[:repeated]]) for at in (row, column))
    data = {f"cartesian{axis}": np.ascontiguousarray(points[:, k]) for k, axis in enumerate("XYZ")}
    if not double:
        data = {name: values.astype(np.float32) for name, values in data.items()}
    data |= {"rowIndex": row.astype(np.uint16) + 3, "columnIndex": column.astype(np.uint16) + 5}
    data["intensity"] = RNG.random(len(points)).astype(np.float32)
    file = pye57.E57(str(path), mode="w")
    file.write_scan_raw(data, name="theirs")
    file.close()


@pytest.mark.parametrize("off_rays_m", [0.0, 2e-4])
@pytest.mark.parametrize("size", first_in_gate(1, [7, 1, 64]))
def test_chunks_of_any_size_give_the_same_scan(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, size: int, off_rays_m: float
) -> None:
    write_scan(example_scan(PROJECTIONS["panorama"], off_rays_m=off_rays_m), tmp_path / "ours.e57")
    by_others(tmp_path / "theirs.e57", double=False, repeated=40, spoilt=3)
    for path in (tmp_path / "ours.e57", tmp_path / "theirs.e57"):
        whole, cloud = read_scan(path), read_points(path)
        monkeypatch.setattr(e57_points, "_CHUNK", size)
        assert_same_scan(read_scan(path), whole)
        assert read_scan(path).warnings == whole.warnings
        turned = read_points(path).points  # a product of one row may be rounded otherwise
        np.testing.assert_allclose(turned, cloud.points, rtol=0, atol=1e-13)
        monkeypatch.undo()


@pytest.mark.parametrize("size", [5, 100_000])
def test_of_several_returns_the_first_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, size: int
) -> None:
    monkeypatch.setattr(e57_points, "_CHUNK", size)
    by_others(tmp_path / "once.e57", double=False)
    by_others(tmp_path / "twice.e57", double=False, repeated=40)
    once, twice = read_scan(tmp_path / "once.e57"), read_scan(tmp_path / "twice.e57")
    np.testing.assert_array_equal(once.ranges, twice.ranges)
    assert twice.warnings == ("40 further returns of pixels with several were left out",)


def test_points_not_finite_are_told() -> None:
    pixels = np.array([[4, 2, 9], [1, 8, 3]])
    chunk = PointChunk(np.ones((3, 3)), pixels, None, None, n_read=5, n_bad=2)
    seen = GridExtent()
    for one in (chunk, replace(chunk, points=np.ones((0, 3)), pixels=pixels[:, :0])):
        seen.see(one)
    assert (seen.n_kept, seen.low.tolist(), seen.high.tolist()) == (3, [2, 1], [9, 8])
    assert (seen.n_bad, seen.n_read) == (4, 10)


@pytest.mark.parametrize("bounds", [None, (0, 0, 70, 90), (3, 5, 4, 6), (9, 9, 2, 2), (0, 0, 10**6, 10**6)])
def test_bounds_that_are_announced_change_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, bounds: tuple[int, ...] | None
) -> None:
    by_others(tmp_path / "a.e57", double=False, repeated=4)
    plain = read_scan(tmp_path / "a.e57")
    low, high = (np.full(2, 2**31), np.zeros(2, int)) if bounds is None else np.reshape(bounds, (2, 2))
    monkeypatch.setattr(
        e57, "announced_size", lambda header: GridExtent(header.point_count, low=low, high=high)
    )
    found = read_scan(tmp_path / "a.e57")
    assert found.warnings == plain.warnings
    for name in ("ranges", "sensor_points", "intensity"):
        np.testing.assert_array_equal(getattr(found, name), getattr(plain, name))
        assert getattr(found, name).flags.c_contiguous


def test_points_in_single_precision_are_kept_so(tmp_path: Path) -> None:
    by_others(tmp_path / "theirs.e57", double=False)
    write_scan(example_scan(PROJECTIONS["panorama"], off_rays_m=2e-4), tmp_path / "ours.e57")
    theirs, ours = read_scan(tmp_path / "theirs.e57"), read_scan(tmp_path / "ours.e57")
    assert theirs.sensor_points is not None
    assert ours.sensor_points is not None
    assert (theirs.sensor_points.dtype, ours.sensor_points.dtype) == (np.float32, np.float64)
    points = theirs.points_in_sensor()
    assert points.dtype == np.float64
    away = np.linalg.norm(points[theirs.valid], axis=-1)
    np.testing.assert_array_equal(away, theirs.ranges[theirs.valid])  # float64, of the points as they stand


def test_a_scan_without_a_valid_point_is_refused(tmp_path: Path) -> None:
    n_points = int(example_scan(PROJECTIONS["panorama"]).valid.sum())
    by_others(tmp_path / "a.e57", double=False, spoilt=n_points)
    with pytest.raises(InputError, match="has no valid point"):
        read_scan(tmp_path / "a.e57")
