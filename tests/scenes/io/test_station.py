# SPDX-License-Identifier: MIT
"""Points without grid or pose, as a scan from the place where the scanner stood."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from completion import complete
from completion.extension.patch import Provenance
from nbv.cli import app
from nbv.report.blocks.page import Page
from scenes.checks import InputError
from scenes.io.formats.station import scan_from_station
from scenes.pose import Pose
from scenes.scan.projection import SphericalProjection
from scenes.scan.range_image import RangeImage
from tests.helpers.completion_examples import PLAIN, completed, distance_to_truth, example, scene
from tests.helpers.long_cases import first_in_gate


@pytest.fixture(scope="module")
def cloud():
    scan = example("two_occluders", "gaussian-2mm", pixels=120)
    points = scan.points()[scan.valid]
    return np.random.default_rng(0).permutation(points), scan.origin


def rows_of(points):
    return {tuple(row) for row in np.round(points, 6)}


def test_points_of_a_panorama_are_its_scan_again():
    """A closed form: a spherical scanner inside a box, whose grid is found to within the pixels' widening."""
    grid = SphericalProjection.regular(240, 80, 360.0, (-40.0, 39.0))
    pose = Pose.from_parts(Pose.looking_at((1, 2, 1.5), (2, 2, 1.5)).rotation, np.array([1.0, 2, 1.5]))
    reach = 3.0 / np.abs(pose.rotate(grid.directions())).max(axis=-1)
    scan = RangeImage(reach, grid, pose, sigma_m=0.0)
    points = scan.points().reshape(-1, 3)
    found = scan_from_station(points, scan.origin)
    assert 0.5 * 240 <= found.shape[1] <= 240
    assert 0.5 * 80 <= found.shape[0] <= 80
    assert found.valid.mean() > 0.95
    np.testing.assert_allclose(found.origin, scan.origin, atol=1e-12)
    assert rows_of(found.points()[found.valid]) <= rows_of(points)  # measured points are kept as they are
    pixels = found.pixels(found.points()[found.valid])
    off = np.abs(pixels - np.argwhere(found.valid))
    off[:, 1] = np.minimum(off[:, 1], found.shape[1] - off[:, 1])
    assert off.max() <= 0.5 + 1e-6


def behind_occluders(found):
    """Inferred area, the pixels left out that were empty, square metres."""
    return sum(
        np.count_nonzero(patch.hypothesised & (patch.provenance != Provenance.NO_RETURN))
        * patch.grid.cell_area
        for patch in found.patches
    )


@pytest.mark.long
@pytest.mark.parametrize("share", first_in_gate(1, [1.0, 0.3]))
def test_shuffled_and_thinned_points_complete_like_the_scan(cloud, share):
    points, origin = cloud
    found = complete(scan_from_station(points[: int(share * len(points))], origin), PLAIN)
    whole = completed("two_occluders", "gaussian-2mm", pixels=120)
    assert found.free_space_violation_m2 == 0
    assert behind_occluders(found) == pytest.approx(behind_occluders(whole), rel=0.1)
    world = found.world_from_reference.apply(found.hypothesised.vertices)
    assert np.mean(distance_to_truth(scene("two_occluders"), world) < 0.01) > 0.98


def test_the_order_of_the_points_does_not_matter(cloud):
    points, origin = cloud
    one, other = scan_from_station(points, origin), scan_from_station(points[::-1], origin)
    assert one.shape == other.shape
    np.testing.assert_array_equal(one.points(), other.points())


def test_places_and_points_that_cannot_be_meant_are_refused(cloud):
    points, origin = cloud
    with pytest.raises(InputError, match="99 points are too few"):
        scan_from_station(points[:99], origin)
    with pytest.raises(InputError, match=r"origin is .* give finite"):
        scan_from_station(points, (0, np.nan, 0))
    layers = np.concatenate([origin + k * (points - origin) for k in (1.0, 1.5)])
    with pytest.raises(InputError, match=r"100 % of .* from \(0.4, 0.4, 1.7\) meet points"):
        scan_from_station(layers, origin)


def test_complete_takes_mere_points_with_their_origin(cloud, tmp_path, monkeypatch):
    page = Page("", "", "", (), None, (), {}, 0)
    monkeypatch.setattr("nbv.report.completion_report.completion_page", lambda *_, **__: page)
    points, origin = cloud
    file = tmp_path / "room.xyz"
    np.savetxt(file, points)
    place = ",".join(str(float(number)) for number in origin)

    def run(*arguments):
        return CliRunner().invoke(
            app, ["complete", str(file), *arguments, "--no-texture", "-o", str(tmp_path)]
        )

    refused = run()
    assert refused.exit_code == 1
    assert "--origin X,Y,Z" in refused.stderr
    result = run("--origin", place, "--json")
    assert result.exit_code == 0, result.stderr
    assert json.loads(result.stdout)["hypothesised_m2"] > 5
    assert json.loads((tmp_path / "manifest.json").read_text())["options"]["origins"] == [list(origin)]
    twice = run("--origin", place, "--origin", place)
    assert "2 places for 1 scans; give --origin X,Y,Z once a scan" in twice.stderr
    poses = tmp_path / "poses.txt"
    poses.write_text("0 0 0 0 0 0 1\n")
    assert "leave out --origin" in run("--origin", place, "--poses", str(poses)).stderr
    file.write_text("0 0 1\n" * 50)
    assert "room.xyz: 50 points are too few" in run("--origin", place).stderr
    assert run("--origin", "1,2").exit_code == 2


@pytest.mark.parametrize("axis", ["x", "y", "z", "tilted"])
def test_the_axis_of_the_sweep_is_found_and_every_point_kept(axis):
    grid = SphericalProjection.regular(90, 70, 135.0, (-60.0, 66.0))
    turns = {"x": [0, 90, 0], "y": [90, 0, 0], "z": [0, 0, 30], "tilted": [7, -4, 50]}
    turn = Rotation.from_euler("xyz", turns[axis], degrees=True).as_matrix()
    upright = Pose.looking_at((0, 0, 0), (1, 0, 0))
    rays = upright.rotate(grid.directions()) @ turn.T
    points = (2.0 / np.abs(rays).max(axis=-1))[..., None] * rays
    points += np.random.default_rng(0).normal(0, 0.003, (*grid.shape, 1)) * rays
    in_order = points.swapaxes(0, 1).reshape(-1, 3) + 5  # column by column
    found = scan_from_station(in_order, (5, 5, 5))
    assert found.shape == grid.shape
    assert found.valid.all()
    assert "6300 of 6300 kept" in found.sensor
    assert found.warnings == ()
    assert abs(found.world_from_sensor.rotation[:, 1] @ turn[:, 2]) == pytest.approx(1, abs=1e-6)


def test_what_lies_on_no_grid_says_how_much_was_lost_and_has_no_single_holes():
    rng = np.random.default_rng(1)
    rays = rng.normal(size=(20_000, 3))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    points = rays * 2.0 / np.abs(rays).max(axis=1, keepdims=True)
    found = scan_from_station(points, (0, 0, 0))
    (text,) = found.warnings
    n_kept = int(text.split()[0])
    assert 3000 < n_kept < 0.95 * 20_000
    assert f"{n_kept} of 20000 points were kept" in text
    assert "structured .e57" in text
    inside = np.pad(found.valid, 1)
    around = inside[:-2, 1:-1] & inside[2:, 1:-1] & inside[1:-1, :-2] & inside[1:-1, 2:]
    assert found.valid[around].all()
    assert rows_of(found.points()[found.valid]) <= rows_of(points)
