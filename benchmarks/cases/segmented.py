# SPDX-License-Identifier: MIT
"""Frames with the true face of each pixel, and how a segmentation of them is judged: UNSEEN_BENCH."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.metrics.regions import HooverScore, score_regions
from completion.merging.merged_surface import MergedSurface
from completion.merging.pipeline import merge
from completion.observe.observation import Observation, observe
from completion.observe.tolerance import EvidenceOptions
from completion.segmentation.pipeline import segment
from completion.segmentation.regions import SegmentationOptions
from scenes.pose import Pose
from scenes.scan.projection import PinholeProjection
from scenes.scan.range_image import RangeImage
from scenes.surfaces.catalogue import Cylinder, Plane

BENCH = Path(os.environ.get("UNSEEN_BENCH", Path(__file__).resolve().parents[3] / "shared" / "bench"))
LEAST_PIXELS = 800  # of a true face that is scored
NOISE_M = 0.002
_NOT_SCORED = ("outside",)


@dataclass(frozen=True)
class Frame:
    """A noisy scan and the true face of each pixel, -1 for none or not scored."""

    scan: RangeImage
    faces: NDArray[np.int64]

    @property
    def n_faces(self) -> int:
        """True faces that are scored."""
        faces, count = np.unique(self.faces, return_counts=True)
        return int((count[faces >= 0] >= LEAST_PIXELS).sum())


@dataclass(frozen=True)
class Judgement:
    """Hoover's classes, and errors of the correct faces' surfaces."""

    score: HooverScore
    angle_deg: list[float]
    radius_error_m: list[float]
    n_wrong_kind: int
    n_huge: int


@cache
def frames(name: str) -> list[Frame]:
    """The frames of a benchmark instance."""
    held = np.load(BENCH / f"{name}.npz")
    fx, fy, cx, cy = held["intrinsics"]
    n, height, width = held["surface"].shape
    camera = PinholeProjection(width, height, float(fx), float(fy), float(cx), float(cy))
    hidden = [i for i, surface in enumerate(surfaces(name)) if surface["name"] in _NOT_SCORED]
    result = []
    for k in range(n):
        ranges = held["range_tenth_mm"][k] * 1e-4  # 0 is no return
        pose = Pose(held["world_from_sensor"][k])
        faces = held["surface"][k].astype(np.int64)
        faces[np.isin(faces, hidden)] = -1
        result.append(Frame(RangeImage(ranges, camera, pose, sigma_m=NOISE_M), faces))
    return result


@cache
def surfaces(name: str) -> list[dict[str, Any]]:
    """The true surfaces by id."""
    held: list[dict[str, Any]] = json.loads(str(np.load(BENCH / f"{name}.npz")["surfaces"]))
    return held


def prepared(frame: Frame) -> Observation:
    """Return the observation of a frame."""
    return observe(frame.scan, frame.scan.world_from_sensor)


def segmented(observation: Observation) -> list[MergedSurface]:
    """Segmentation, fits and merging as `complete` does them."""
    return merge([observation], [segment(observation, SegmentationOptions())], EvidenceOptions().tolerance())


def labels_of(masks: list[NDArray[np.bool_]], shape: tuple[int, int]) -> NDArray[np.int64]:
    """Return the number of the mask (rows, columns) that each pixel is in, -1 for none."""
    found = np.full(shape, -1)
    for number, mask in enumerate(masks):
        found[mask] = number
    return found


def judged(name: str, frame: Frame, found: list[MergedSurface]) -> Judgement:
    """Score the surfaces found in a frame, at 80 % overlap."""
    labels = labels_of([surface.pixels[0].mask for surface in found], frame.faces.shape)
    score = score_regions(frame.faces, labels, min_pixels=LEAST_PIXELS)
    angles, radii, wrong = [], [], 0
    for face, region in score.correct:
        true = surfaces(name)[face]
        fitted = found[region].fit.surface.transform(frame.scan.world_from_sensor)
        if fitted.kind != true["kind"]:
            wrong += 1
        elif isinstance(fitted, Plane):
            across = np.cross(fitted.normal_direction, true["normal"]) / np.linalg.norm(true["normal"])
            angles.append(float(np.degrees(np.arcsin(min(float(np.linalg.norm(across)), 1.0)))))
        elif isinstance(fitted, Cylinder):
            radii.append(abs(fitted.radius - true["radius"]))
    huge = [s for s in found if isinstance(s.fit.surface, Cylinder) and s.fit.surface.radius > 1]
    return Judgement(score, angles, radii, wrong, len(huge))
