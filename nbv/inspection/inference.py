# SPDX-License-Identifier: MIT
"""Inference: what completion says of surface that no scan measured. It takes no part in any verdict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from completion.asbuilt.findings import SAMPLE_STATES, DesignCheck, ElementFinding, Inference, Shares
from nbv.coverage.surface_classes import KnownSurfaces
from nbv.run.wording import percent
from scenes.checks import BoolArray, FloatArray
from scenes.rays.raycast import RayCaster
from scenes.scan.range_image import RangeImage

_MEASURED, _INFERRED, _UNKNOWN = range(len(SAMPLE_STATES))


def infer_elements(
    check: DesignCheck, scans: Sequence[RangeImage], *, n_threads: int | None = None
) -> DesignCheck:
    """Return a check that also tells where continued surface lies within the tolerance of the design.

    The scans are completed at their aligned poses. A sample that was not measured counts as inferred where
    continued surface crosses its normal within the tolerance of its element. Verdicts stay as they are.
    """
    placed = [
        scan.with_facts(world_from_sensor=pose)
        for scan, pose in zip(scans, check.alignment.poses, strict=True)
    ]
    completed = KnownSurfaces.of(placed, relates=False, n_threads=n_threads)
    probability = _continued(check, completed, n_threads)
    samples = check.samples
    state = np.where(probability > 0, _INFERRED, samples.state).astype(np.int8)
    held = (samples.area_m2, state, probability)
    elements = tuple(
        _with_inference(finding, *(column[samples.element == finding.surface] for column in held))
        for finding in check.elements
    )
    return replace(check, elements=elements, samples=replace(samples, state=state))


def _continued(check: DesignCheck, completed: KnownSurfaces, n_threads: int | None) -> FloatArray:
    """Probability (n,) of continued surface within tolerance of each sample; 0 for none, and if measured."""
    samples, probability = check.samples, np.zeros(len(check.samples.state))
    vertices, faces, confidence = completed.inferred_mesh()
    asked = np.flatnonzero(samples.state != _MEASURED)
    if not len(faces) or not len(asked):
        return probability
    tolerance = np.zeros(len(check.design.elements))
    for finding in check.elements:
        tolerance[finding.surface] = finding.tolerance_m
    reach = tolerance[samples.element[asked]][:, None]
    start = samples.points[asked] + reach * samples.normals[asked]
    hits = RayCaster(vertices, faces, n_threads).first_hit(start, -samples.normals[asked])
    is_near: BoolArray = hits.hit & (hits.ranges <= 2 * reach[:, 0])
    probability[asked[is_near]] = confidence[hits.face[is_near]]
    return probability


def _with_inference(
    finding: ElementFinding, area_m2: FloatArray, state: np.ndarray, probability: FloatArray
) -> ElementFinding:
    """Return a finding with what completion says, by its samples (n,)."""
    inferred, total = area_m2[state == _INFERRED], float(area_m2.sum())
    if not len(inferred):
        return finding
    share = float(inferred.sum() / area_m2[state != _MEASURED].sum())
    likely = float(np.average(probability[state == _INFERRED], weights=inferred))
    measured = finding.share.measured
    of_all = min(float(inferred.sum()) / total, 1.0 - measured)
    sentence = (
        f"Continued surface lies within {1000 * finding.tolerance_m:g} mm of the design on "
        f"{percent(share, 0)} % of what was not measured, with probability {likely:.2f}."
    )
    shares = Shares(measured, of_all, 1.0 - measured - of_all)
    return replace(finding, share=shares, inference=Inference(share, likely, sentence))
