# SPDX-License-Identifier: MIT
"""Visibility history: which samples each view sees, and from which view on they meet the requirement."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nbv.coverage.measurement import CoverageTally
from nbv.scanning.view import View
from nbv.visibility.requirement import Requirement
from nbv.visibility.samples import SurfaceSamples
from scenes.checks import FloatArray
from scenes.rays.raycast import RayCaster
from scenes.scan.range_image import RangeImage

NEVER = 1 << 20
"""First view of samples that no view measures as required."""


@dataclass(frozen=True, slots=True, eq=False)
class VisibilityHistory:
    """What views see, one after the other.

    Attributes
    ----------
    start : (n + 1,) int64
        What views see of sample k stands from `start[k]` to `start[k + 1]`.
    view : (m,) int64
        Number of the view, from 1, ascending for each sample; 0 for what was scanned before.
    cosine : (m,) float
        Cosine of incidence.
    first_met : (n,) int64
        Number of the view after which a sample meets the requirement, `NEVER` where none does.
    met : tuple of float
        Share of the area that meets it before the first view and after each.
    """

    start: NDArray[np.int64]
    view: NDArray[np.int64]
    cosine: FloatArray
    first_met: NDArray[np.int64]
    met: tuple[float, ...]


def visibility_history(
    caster: RayCaster,
    samples: SurfaceSamples,
    requirement: Requirement,
    stations: Sequence[View | RangeImage],
    before: Sequence[RangeImage] = (),
) -> VisibilityHistory:
    """Walk through views or scans and note what each sees.

    Parameters
    ----------
    caster : RayCaster
        The scene.
    samples : SurfaceSamples
        Of its surface.
    requirement : Requirement
        What counts as met.
    stations : sequence of View or RangeImage
        Views, whose sight is cast, or scans, which have measured what they have.
    before : sequence of RangeImage
        Scans that were there before; together they are number 0.
    """
    tally = CoverageTally.start(caster, samples, requirement)
    first_met = np.full(len(samples), NEVER, np.int64)
    seen = [(0, *tally.see_scan(scan)) for scan in before]
    met = [tally.met_m2() / samples.total_m2]
    first_met[tally.met] = 0
    for number, station in enumerate(stations, start=1):
        found = tally.see_scan(station) if isinstance(station, RangeImage) else tally.see(station)
        seen.append((number, *found))
        first_met[tally.met & (first_met == NEVER)] = number
        met.append(tally.met_m2() / samples.total_m2)
    return _joined(seen, first_met, tuple(met))


def _joined(
    seen: Sequence[tuple[int, NDArray[np.int64], FloatArray]],
    first_met: NDArray[np.int64],
    met: tuple[float, ...],
) -> VisibilityHistory:
    """Sort what each view saw by sample; the views of a sample stay in their order."""
    sample = np.concatenate([np.zeros(0, np.int64), *(index for _, index, _ in seen)])
    view = np.concatenate([np.zeros(0, np.int64), *(np.full(len(i), k, np.int64) for k, i, _ in seen)])
    cosine = np.concatenate([np.zeros(0), *(values for _, _, values in seen)])
    order = np.argsort(sample, kind="stable")
    start = np.concatenate([[0], np.cumsum(np.bincount(sample, minlength=len(first_met)))])
    return VisibilityHistory(start, view[order], cosine[order], first_met, met)
