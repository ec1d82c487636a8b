# SPDX-License-Identifier: MIT
"""Milliseconds of CPU time and correct faces a frame: ours beside Open3D's two, same frames, same run."""

import os
import time

import numpy as np
import pytest

from benchmarks.completion.scores.hoover import score_regions
from tests.helpers.bench_frames import (
    LEAST_PIXELS,
    NOISE_M,
    Frame,
    frames,
    judged,
    labels_of,
    prepared,
    segmented,
)
from tests.helpers.data_paths import requires_bench

pytestmark = requires_bench
ROWS: list[str] = []


@pytest.fixture(scope="module", autouse=True)
def _table(final_tables):
    yield
    final_tables.append(
        lambda: [f"CPU time a frame, all threads together; ours has one; {os.cpu_count()} cores", *ROWS]
    )


@pytest.mark.benchmark(group="segmentation, ten frames")
@pytest.mark.parametrize("name", ["drum_and_post", "office"])
def test_ours(benchmark, name):
    observations = [prepared(frame) for frame in frames(name)]
    for observation in observations:
        segmented(observation)
    seconds, found = [], []

    def run():
        for observation in observations:
            start = time.process_time()
            found.append(segmented(observation))
            seconds.append(time.process_time() - start)

    benchmark.pedantic(run, rounds=3)
    judgements = [judged(name, frame, surfaces) for frame, surfaces in zip(frames(name), found, strict=False)]
    best = np.array(seconds).reshape(3, -1).min(axis=0)
    for k, (judgement, frame) in enumerate(zip(judgements, frames(name), strict=True)):
        _row(f"ours, {name} {k}", best[k : k + 1], [judgement.score], [frame])
    _row(f"ours, {name}", best, [judgement.score for judgement in judgements], frames(name))
    angles = np.concatenate([judgement.angle_deg for judgement in judgements])
    radii = np.concatenate([judgement.radius_error_m for judgement in judgements])
    n_huge = sum(judgement.n_huge for judgement in judgements)
    ROWS.append(
        f"    median plane angle {np.median(angles):.4f} deg; {len(radii)} cylinders, "
        f"|dr| median {1e3 * np.median(radii):.3f} mm, largest {1e3 * radii.max():.3f}; r > 1 m: {n_huge}"
    )


@pytest.mark.benchmark(group="segmentation, ten frames")
def test_open3d_iterative_segment_plane(benchmark):
    _peer(benchmark, "Open3D segment_plane, again and again", _planes_one_by_one)


@pytest.mark.benchmark(group="segmentation, ten frames")
def test_open3d_planar_patches(benchmark):
    _peer(benchmark, "Open3D planar patches, with normals", _planar_patches)


def _peer(benchmark, title, method):
    open3d = pytest.importorskip("open3d", reason="open3d is not installed: pip install open3d")
    seconds, scores = [], []

    def run():
        for frame in frames("drum_and_post"):
            start = time.process_time()
            labels = method(open3d, frame)
            seconds.append(time.process_time() - start)
            scores.append(score_regions(frame.faces, labels, min_pixels=LEAST_PIXELS))

    benchmark.pedantic(run, rounds=1)
    _row(title, np.array(seconds), scores, frames("drum_and_post"))


def _cloud(open3d, frame: Frame):
    points = frame.scan.points_in_sensor().reshape(-1, 3)
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
    return cloud, points


def _planes_one_by_one(open3d, frame: Frame):
    """Take the plane with most inliers out until fewer than 800 points support one."""
    open3d.utility.random.seed(0)
    cloud, _ = _cloud(open3d, frame)
    left, masks = np.arange(frame.faces.size), []
    while len(left) > LEAST_PIXELS:
        _, inliers = cloud.select_by_index(left).segment_plane(3 * NOISE_M, 3, 500)
        if len(inliers) < LEAST_PIXELS:
            break
        mask = np.zeros(frame.faces.size, dtype=np.bool_)
        mask[left[inliers]] = True
        masks.append(mask.reshape(frame.faces.shape))
        left = np.delete(left, inliers)
    return labels_of(masks, frame.faces.shape)


def _planar_patches(open3d, frame: Frame):
    """Patches as boxes; each point goes to the box of least thickness that holds it."""
    cloud, points = _cloud(open3d, frame)
    cloud.estimate_normals(open3d.geometry.KDTreeSearchParamKNN(30))
    boxes = cloud.detect_planar_patches(
        normal_variance_threshold_deg=60,
        coplanarity_deg=75,
        outlier_ratio=0.75,
        min_plane_edge_length=0,
        min_num_points=0,
        search_param=open3d.geometry.KDTreeSearchParamKNN(30),
    )
    labels, nearest = np.full(frame.faces.size, -1), np.full(frame.faces.size, np.inf)
    for number, box in enumerate(boxes):
        local = np.abs((points - box.center) @ box.R)
        inside = (local[:, :2] <= np.asarray(box.extent)[:2] / 2 + 0.01).all(axis=1)
        inside &= (local[:, 2] <= 3 * NOISE_M) & (local[:, 2] < nearest)
        labels[inside], nearest[inside] = number, local[inside, 2]
    return labels.reshape(frame.faces.shape)


def _row(title, seconds, scores, scored):
    n_faces = sum(frame.n_faces for frame in scored)
    counts = ", ".join(
        f"{name} {sum(len(getattr(score, name)) for score in scores)}"
        for name in ("over", "under", "missed", "noise")
    )
    n_correct = sum(len(score.correct) for score in scores)
    ROWS.append(
        f"{title:38s} {1e3 * np.mean(seconds):7.0f} ms  {n_correct:3d} of {n_faces} correct, {counts}"
    )
