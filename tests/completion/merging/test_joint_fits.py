# SPDX-License-Identifier: MIT
"""Joint fits: from lists of pixels as from whole images of labels, and without memory of an image's size."""

import tracemalloc

import numpy as np
import pytest

from completion.observe.observation import LabelledBeams, PixelSet, ScanPixels, observe
from completion.observe.refitting import block_sums, refit, refit_each
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection
from scenes.scan.range_image import RangeImage
from scenes.surfaces.catalogue import Cylinder, Plane

SURFACES = [
    Plane((0, 0, 3.0), (0.1, 0, -1)),
    Cylinder((0.2, 0, 3.0), (0, 1, 0.1), 0.6),
    Plane((0, 1, 3), (0, -1, 0)),
]
STARTS = [Plane((0, 0, 3.01), (0.1, 0, -1)), Cylinder((0.2, 0, 3.01), (0, 1, 0.1), 0.6), SURFACES[2]]
FLAT_M = 0.001


def observations(shape=(203, 154), n_scans=3):
    """Scans of all surfaces, each seen in random pieces, some pixels of it in none; their labels."""
    rng, camera, found = np.random.default_rng(0), PinholeProjection.from_fov(*shape, 60), []
    rays = camera.directions().reshape(-1, 3)
    for x in range(n_scans):
        pose = Pose.looking_at((0.3 * x, 0, 0), (0.0, 0.1, 3.0))
        turned = rays @ pose.rotation.T
        hit = [s.ray_ranges(np.broadcast_to(pose.translation, rays.shape), turned) for s in SURFACES]
        piece = np.kron(rng.integers(0, 4, (75, 75)), np.ones((14, 14), int))[
            : camera.shape[0], : camera.shape[1]
        ]
        ranges = np.choose(piece, [np.full(camera.shape, 9.0), *(one.reshape(camera.shape) for one in hit)])
        ranges += rng.normal(0, 0.002, ranges.shape)
        scan = RangeImage(ranges, camera, pose, sigma_m=0.002)
        labels = np.where(np.isfinite(ranges) & (rng.random(ranges.shape) < 0.9), piece, 0).astype(np.int32)
        found.append((observe(scan, Pose.identity()), labels))
    return zip(*found, strict=True)


def test_fits_from_pixel_lists_are_those_from_images_to_the_bit():
    seen, labels = observations()
    pixels = list(map(ScanPixels.of, zip(*(PixelSet.by_label(one, 3) for one in labels), strict=True)))
    expected = refit(STARTS, seen, labels, FLAT_M, n_rounds=2)
    for one, other in zip(refit_each(STARTS, seen, pixels, FLAT_M, n_rounds=2), expected, strict=True):
        assert one is not None
        assert one.surface.point.tobytes() == other.surface.point.tobytes()
        assert one.covariance.tobytes() == other.covariance.tobytes()
        assert (one.rms, one.n, one.inflation) == (other.rms, other.n, other.inflation)
    assert refit_each([], seen, [], FLAT_M) == []


def test_a_small_surface_takes_no_memory_of_an_images_size():
    (seen,), (labels,) = observations((1000, 800), 1)
    some = PixelSet(PixelSet.by_label(labels, 3)[0].flat[:3000], labels.shape)
    refit_each(STARTS[:1], [seen], [ScanPixels.of([some])], FLAT_M)
    tracemalloc.start()
    refit_each(STARTS[:1], [seen], [ScanPixels.of([some])], FLAT_M)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < labels.size / 4  # bytes


@pytest.mark.parametrize("whole", [True, False], ids=["image", "list"])
def test_blocks_are_the_dark_squares_of_a_chessboard(whole):
    (seen,), (labels,) = observations(n_scans=1)
    pixel = np.flatnonzero(labels).astype(np.int32)
    beams = (
        LabelledBeams.of(seen, labels)
        if whole
        else LabelledBeams(seen.rays, seen.noise.numbers(), seen.scan.ranges, pixel, labels.ravel()[pixel])
    )
    expected, points = np.zeros((3, 4)), seen.scan.points()
    rays = (points - seen.scan.origin) / seen.scan.ranges[..., None]
    for top in range(0, labels.shape[0], 10):
        for left in range(top % 20, labels.shape[1], 20):
            block = np.s_[top : top + 10, left : left + 10]
            for k, surface in enumerate(SURFACES):
                own = labels[block] == k + 1
                if not own.any():
                    continue
                there = points[block][own]
                cosine = np.einsum("ij,ij->i", surface.normal(there), rays[block][own])
                facing = cosine < 0 if surface.kind == "cylinder" else np.ones(len(there), bool)
                sigma = seen.noise.deviation(seen.scan.ranges[block][own])
                residual = (surface.distance(there) / np.hypot(sigma * cosine, FLAT_M))[facing]
                expected[k, 2:] += np.square(residual).sum(), len(residual)
                if 2 * len(residual) >= 100:
                    expected[k, :2] += residual.sum() ** 2 / len(residual), 1
    assert (expected[:, 1] > 10).all()
    np.testing.assert_allclose(block_sums(SURFACES, [beams], FLAT_M), expected, rtol=1e-6)
