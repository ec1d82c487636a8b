# SPDX-License-Identifier: MIT
"""Small scans of every kind that a format must carry."""

import numpy as np

from scenes.pose import Pose
from scenes.scan.colour import unit_colour
from scenes.scan.projection import PinholeProjection, Projection, SphericalProjection
from scenes.scan.range_image import RangeImage, ScanTruth

PROJECTIONS: dict[str, Projection] = {
    "pinhole": PinholeProjection(31, 23, 28.5, 29.25, 14.5, 10.75),
    "negative fy": PinholeProjection(31, 23, 28.5, -29.25, 14.5, 10.75),
    "panorama": SphericalProjection.regular(60, 25, 360.0, (-60.0, 40.0)),
    "rows upwards, columns leftwards": SphericalProjection(
        np.linspace(3.6, 2.1, 31), np.linspace(-0.9, 0.7, 23)
    ),
}
POSE = Pose.looking_at((12.5, -7.25, 1.6), (10.0, 3.0, 0.4))


def example_scan(
    projection: Projection,
    *,
    colour: bool = True,
    pose: Pose = POSE,
    off_rays_m: float = 0.0,
    truth: bool = False,
    seed: int = 0,
) -> RangeImage:
    """A bumpy scan with a fifth of its pixels empty; `off_rays_m` moves measured points off their rays."""
    rng = np.random.default_rng(seed)
    rows, columns = projection.shape
    ranges = 3 + np.sin(np.arange(rows) / 5)[:, None] + np.cos(np.arange(columns) / 7)
    ranges[rng.random((rows, columns)) < 0.2] = np.inf
    points = None
    if off_rays_m:
        points = np.where(np.isfinite(ranges), ranges, np.nan)[..., None] * projection.directions()
        points = points + rng.normal(0, off_rays_m, points.shape)
        ranges = np.where(np.isfinite(ranges), np.linalg.norm(points, axis=-1), np.inf)
    colours = rng.integers(0, 256, (rows, columns, 3)).astype(np.float32) / np.float32(255)
    real = None
    if truth:
        face = np.where(np.isfinite(ranges), rng.integers(0, 9, (rows, columns)), -1)
        rays = np.where(face >= 0, 7, 0)
        real = ScanTruth(face, face // 2, ranges, np.where(face >= 0, 0.3, np.nan), rays)
    return RangeImage(
        ranges,
        projection,
        pose,
        colour=colours if colour else None,
        sensor_points=points,
        sigma_m=0.002,
        sensor="a scanner",
        noise="constant",
        truth=real,
        name="küche <b>",
    )


def assert_same_scan(first: RangeImage, second: RangeImage, tolerance_m: float = 0.0) -> None:
    """Fail unless both see the same points, colours and pixels, from the same pose."""
    np.testing.assert_array_equal(first.valid, second.valid)
    np.testing.assert_allclose(first.points(), second.points(), atol=max(tolerance_m, 1e-12), rtol=0)
    np.testing.assert_allclose(
        np.where(first.valid, first.ranges, 0),
        np.where(second.valid, second.ranges, 0),
        atol=tolerance_m,
        rtol=0,
    )
    np.testing.assert_allclose(
        first.world_from_sensor.matrix, second.world_from_sensor.matrix, atol=1e-12, rtol=0
    )
    assert (first.colour is None) == (second.colour is None)
    if first.colour is not None and second.colour is not None:
        np.testing.assert_array_equal(
            unit_colour(first.colour[first.valid]), unit_colour(second.colour[second.valid])
        )
