# SPDX-License-Identifier: MIT
"""The audit casts only beams that may meet a mesh, and comes to what all beams would."""

import numpy as np
import pytest

from completion.observe.observation import observe
from completion.observe.tolerance import EvidenceOptions
from completion.result import audit as module
from completion.result.audit import Bundles, audit, bundle
from scenes import PinholeProjection, Pose, RangeImage, SphericalProjection

TOLERANCE = EvidenceOptions(flatness_m=0.001).tolerance()
CAMERAS = {
    "camera": PinholeProjection.from_fov(90, 70, 75),
    "panorama": SphericalProjection.regular(180, 60, 360.0, (-50.0, 70.0)),
}


def patchwork(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Triangles that hang about the origin, some large, most small."""
    n = 200
    middle = rng.normal(0, 2.5, (n, 1, 3))
    corners = middle + rng.normal(0, 1, (n, 3, 3)) * rng.choice(
        [0.05, 0.3, 2.0], (n, 1, 1), p=[0.5, 0.4, 0.1]
    )
    return corners.reshape(-1, 3), np.arange(3 * n, dtype=np.int32).reshape(-1, 3)


def all_beams(bundles: Bundles) -> Bundles:
    """Bundles that say of no beam that it passes a mesh."""
    around = np.array([0.0, 0.0, 1.0, np.pi, np.inf])
    return bundles._replace(
        cosine=np.full_like(bundles.cosine, -1.0), far=np.full_like(bundles.far, np.inf), around=around
    )


@pytest.mark.parametrize("off_grid", [False, True], ids=["on the grid", "off it"])
@pytest.mark.parametrize("sigma_m", [0.0, 0.01])
@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
@pytest.mark.parametrize("seed", range(3))
def test_beams_left_out_change_nothing(camera, sigma_m, off_grid, seed):
    rng = np.random.default_rng(seed)
    ranges = rng.uniform(0.2, 6.0, camera.shape)
    ranges[rng.random(camera.shape) < 0.2] = np.inf
    ranges[:30, :30] = np.inf  # squares without any return
    pose = Pose.looking_at(rng.normal(0, 2, 3), rng.normal(0, 0.5, 3))
    scan = RangeImage(ranges, camera, pose, sigma_m=sigma_m)
    if off_grid:
        points = scan.points_in_sensor() + rng.normal(0, 0.01, (*camera.shape, 3))
        scan = RangeImage.from_points(points.astype(np.float32), camera, pose)
    seen, sd = observe(scan, Pose.identity(), sigma_m), np.full(600, 0.002)
    few, every = bundle(seen), all_beams(bundle(seen))
    found, expected = (
        audit(*patchwork(rng), sd, [seen], [one], tolerance=TOLERANCE)
        for rng, one in ((np.random.default_rng(seed), few), (np.random.default_rng(seed), every))
    )
    assert expected.violation_m2 > 0
    assert found.violation_m2 == pytest.approx(expected.violation_m2, rel=1e-12)
    np.testing.assert_array_equal(found.faces, expected.faces)


def test_most_beams_are_left_out_where_a_mesh_is_small(monkeypatch):
    camera, cast = CAMERAS["panorama"], []
    scan = RangeImage(np.full(camera.shape, 5.0), camera, Pose.identity(), sigma_m=0.0)
    returned = module._returning_pixels
    monkeypatch.setattr(module, "_returning_pixels", lambda *given: cast.append(returned(*given)) or cast[-1])
    seen = observe(scan, Pose.identity())
    square = np.array([[-0.2, -0.2, 2.0], [0.2, -0.2, 2.0], [0.2, 0.2, 2.0], [-0.2, 0.2, 2.0]])
    faces = np.array([[0, 2, 1], [0, 3, 2]], np.int32)
    assert audit(square, faces, np.zeros(4), [seen], [bundle(seen)], tolerance=TOLERANCE).violation_m2 > 0
    assert 0 < sum(map(len, cast)) < 0.15 * scan.ranges.size
    far = square + [0, 0, 10.0]
    assert audit(far, faces, np.zeros(4), [seen], [bundle(seen)], tolerance=TOLERANCE).violation_m2 == 0
    assert len(cast) == 1  # no beam gets there
