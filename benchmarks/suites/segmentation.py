# SPDX-License-Identifier: MIT
"""Segmentation of frames with known faces, ours beside Open3D's two: correct faces and CPU time a frame."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.cases.segmented import (
    LEAST_PIXELS,
    NOISE_M,
    Frame,
    frames,
    judged,
    labels_of,
    prepared,
    segmented,
)
from benchmarks.metrics.regions import HooverScore, score_regions
from benchmarks.run import head, row, suite
from scenes.checks import FloatArray


@suite("segmentation", smallest="--rounds 1")
def segmentation(rounds: int = 3) -> Iterator[str]:
    """Faces of Hoover et al. (1996) at 80 % overlap, ten frames each of drum_and_post and office."""
    yield from head("method, frames", "CPU ms a frame", "correct", "of", "over", "under", "missed", "noise")
    for name in ("drum_and_post", "office"):
        observations = [prepared(frame) for frame in frames(name)]
        found = [segmented(observation) for observation in observations]
        seconds = np.empty((rounds, len(observations)))
        for turn in seconds:
            for k, observation in enumerate(observations):
                begin = time.process_time()
                segmented(observation)
                turn[k] = time.process_time() - begin
        judgements = [judged(name, frame, some) for frame, some in zip(frames(name), found, strict=True)]
        yield _line(f"unseen, {name}", seconds.min(axis=0), [j.score for j in judgements], frames(name))
        angles = np.concatenate([judgement.angle_deg for judgement in judgements])
        radii = 1e3 * np.concatenate([judgement.radius_error_m for judgement in judgements])
        yield (
            f"median plane angle {np.median(angles):.4f} deg; {len(radii)} cylinders, |dr| median "
            f"{np.median(radii):.3f} mm, largest {radii.max():.3f}; r > 1 m: "
            f"{sum(judgement.n_huge for judgement in judgements)}"
        )
    try:
        import open3d
    except (ImportError, OSError) as error:
        yield f"without Open3D: {error}"
        return
    for title, method in (("segment_plane", _planes_one_by_one), ("planar patches", _planar_patches)):
        spent, scores = [], []
        for frame in frames("drum_and_post"):
            begin = time.process_time()
            labels = method(open3d, frame)
            spent.append(time.process_time() - begin)
            scores.append(score_regions(frame.faces, labels, min_pixels=LEAST_PIXELS))
        yield _line(f"Open3D {title}, drum_and_post", np.array(spent), scores, frames("drum_and_post"))


def _line(title: str, seconds: FloatArray, scores: Sequence[HooverScore], scored: Sequence[Frame]) -> str:
    counts = [sum(len(getattr(s, name)) for s in scores) for name in ("over", "under", "missed", "noise")]
    correct = sum(len(score.correct) for score in scores)
    return row(title, f"{1e3 * np.mean(seconds):.0f}", correct, sum(f.n_faces for f in scored), *counts)


def _cloud(open3d: Any, frame: Frame) -> tuple[Any, FloatArray]:
    points = frame.scan.points_in_sensor().reshape(-1, 3)
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
    return cloud, points


def _planes_one_by_one(open3d: Any, frame: Frame) -> NDArray[np.int64]:
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


def _planar_patches(open3d: Any, frame: Frame) -> NDArray[np.int64]:
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
