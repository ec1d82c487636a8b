# SPDX-License-Identifier: MIT
"""Entries: one inferred surface, one reason and one bin of confidence each, and how much of it came true."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.completion.ledger.sources import Known, Source
from benchmarks.completion.scenes.cases import hypothesis_of
from benchmarks.completion.scores.other_scans import score_by_others
from benchmarks.completion.truth.samples import Samples, sample
from completion import CompletionOptions, complete
from completion.result.completed_model import CompletedModel
from scenes.checks import BoolArray, FloatArray
from scenes.rays.raycast import RayCaster

CELL_M = 0.02
TOLERANCE_M = 0.03
_SAME_WAY = np.cos(np.radians(30.0))  # normals of what is taken for the same surface


@dataclass(frozen=True, slots=True)
class Entry:
    """Inferred area of one surface, for one reason, of one tenth of the scale of confidence.

    Attributes
    ----------
    source : str
        Of the frames.
    frames : tuple of int
        Those that were completed together, from 0.
    surface : int
        Its number, from 1.
    kind, reason : str
        Of the surface; why the area was inferred.
    n_parts : int
        Regions that it was joined from.
    measured_m2 : float
        Its measured area.
    confidence : float
        Mean of the area.
    right_m2, wrong_m2, unknown_m2 : float
        Of the area that was hidden from the frames, and not beside what they measured.
    """

    source: str
    frames: tuple[int, ...]
    surface: int
    kind: str
    reason: str
    n_parts: int
    measured_m2: float
    confidence: float
    right_m2: float
    wrong_m2: float
    unknown_m2: float


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of frames that were completed together.

    Attributes
    ----------
    entries : tuple of Entry
        What was inferred.
    completed : CompletedModel
        The completion.
    samples : Samples
        Inferred area.
    state : (n,) int8
        For each sample: 1 right, -1 wrong, 0 unknown, 2 not counted.
    found : tuple of int
        Reference points that the frames did not see, and those of them that were inferred.
    """

    entries: tuple[Entry, ...]
    completed: CompletedModel
    samples: Samples
    state: NDArray[np.int8]
    found: tuple[int, int]


def outcome(
    source: Source, frames: Sequence[int], options: CompletionOptions, *, by_truth: bool = True
) -> Outcome:
    """Complete some frames of a source, and hold what was inferred against the other ones, or the truth.

    The truth is asked where it is known, and `by_truth`.
    """
    scans = [source.frames[k] for k in frames]
    others = [scan for k, scan in enumerate(source.frames) if k not in frames]
    completed = complete(scans, options, rng=0)
    hypothesis = hypothesis_of(completed, scans)
    samples = sample(hypothesis, CELL_M)
    tolerance = max(TOLERANCE_M, 2 * source.registration_m)
    scored = score_by_others(scans, others, samples, tolerance_m=tolerance)
    state = scored.state
    if by_truth and isinstance(source, Known):
        state = np.where(
            state == 2, 2, np.where(is_there(samples.points, samples.normals, source.caster), 1, -1)
        ).astype(np.int8)
    entries = []
    tenth = np.clip((10 * samples.confidence).astype(np.int64), 0, 9)
    counted = state != 2
    keys = np.stack([samples.surface, samples.reason, tenth], axis=1)[counted]
    for key in np.unique(keys, axis=0):
        here = counted & (samples.surface == key[0]) & (samples.reason == key[1]) & (tenth == key[2])
        patch, areas = completed.patches[key[0]], samples.areas[here]
        entries.append(
            Entry(
                source=source.name,
                frames=tuple(frames),
                surface=int(key[0]) + 1,
                kind=type(patch.grid.surface).__name__.lower(),
                reason=hypothesis.reasons[key[1]],
                n_parts=patch.source.n_parts,
                measured_m2=patch.observed_m2,
                confidence=float(areas @ samples.confidence[here] / areas.sum()),
                right_m2=float(areas[state[here] == 1].sum()),
                wrong_m2=float(areas[state[here] == -1].sum()),
                unknown_m2=float(areas[state[here] == 0].sum()),
            )
        )
    return Outcome(tuple(entries), completed, samples, state, (scored.n_reference, scored.n_found))


def is_there(points: FloatArray, normals: FloatArray, caster: RayCaster) -> BoolArray:
    """Tell which places (n, 3) have surface of nearly their direction within 3 cm along their normal."""
    return _meets(points, normals, caster) | _meets(points, -normals, caster)


def _meets(points: FloatArray, normals: FloatArray, caster: RayCaster) -> BoolArray:
    hits = caster.first_hit(points - TOLERANCE_M * normals, normals)
    near = hits.ranges <= 2 * TOLERANCE_M
    return np.asarray(near & (hits.incidence_cosine >= _SAME_WAY), dtype=np.bool_)
