# SPDX-License-Identifier: MIT
"""Real scans: angles between planes before and after relations, how far these turn them, what is rejected."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from benchmarks.completion.ledger.sources import DATA, REAL
from completion import CompletionOptions, complete
from completion.fitting.result import SurfaceFit
from completion.relations.engine.relation import Status
from completion.relations.surfaces import FoundRelations
from scenes import RangeImage, read_scan
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Plane

_FILES = (("office1", "range/pcl/office1.pcd"), ("pumpA", "range/e57/pumpA.e57"))
_LEFT_OUT = ("nyu_dining",)
_NEAR_DEG = 5.0  # of square or parallel: what is farther off was not meant to be
_EXACT_DEG = 0.05


def real_table() -> Iterator[str]:
    """Yield the lines of a table: a scan each, all its frames completed together.

    Of pairs of planes within 5 deg of square or parallel: how many are within .05 deg of it, and how far off
    a usual one is, as measured, where relations hold, and where the model has them: a plane that would leave
    its points by half of their scatter stays. "turn" is the largest that relations ask for. Rejected are
    proposals that the data contradict, of all that could be decided.
    """
    yield (
        "| scan | frames | surfaces | pairs | within .05 deg | related | in the model | off, deg | related "
        "| in the model | largest turn, deg | sd | above 3 sd | stayed | accepted, implied | rejected "
        "| undecided |"
    )
    yield "|---" * 17 + "|"
    for name, scans in _sources():
        done = complete(scans, CompletionOptions(texture=False), rng=0)
        if done.relations is not None:
            yield f"| {name} | {len(scans)} | {_row(done.relations)} |"


def _sources() -> Iterator[tuple[str, Sequence[RangeImage]]]:
    for source in REAL:
        if source.name not in _LEFT_OUT:
            yield source.name, source.frames
    for name, path in _FILES:
        yield name, [read_scan(DATA / path)]


def _row(found: FoundRelations) -> str:
    graph = found.graph
    places = [k for k, fit in enumerate(found.before) if isinstance(fit.surface, Plane)]
    now = [graph.fits[k] if moves else found.before[k] for k, moves in enumerate(found.is_moved)]
    sides = [_normals(fits, places) for fits in (found.before, graph.fits, now)]
    off = [[_off_deg(one[a], one[b]) for one in sides] for a, b in combinations(range(len(places)), 2)]
    meant = np.array([three for three in off if three[0] <= _NEAR_DEG]).reshape(-1, 3)
    turns = np.degrees(np.linalg.norm(np.cross(sides[0], sides[1]), axis=1))
    largest = int(np.argmax(turns)) if len(turns) else 0
    sd = graph.moved_sd[places[largest]] if len(turns) else 0.0
    n_far = sum(one > 3 for one in graph.moved_sd)
    exact = np.count_nonzero(meant <= _EXACT_DEG, axis=0)
    middle = np.median(meant, axis=0) if len(meant) else np.zeros(3)
    shares, offs = " | ".join(map(str, exact)), " | ".join(f"{one:.2f}" for one in middle)
    held = [graph.numbered(status) for status in (Status.ACCEPTED, Status.IMPLIED)]
    rejected = graph.numbered(Status.REJECTED)
    share = rejected / max(sum(held) + rejected, 1)
    n_stayed = sum(not moves for moves in found.is_moved)
    return (
        f"{len(found.before)} | {len(meant)} | {shares} | {offs} "
        f"| {turns.max(initial=0.0):.2f} | {sd:.1f} | {n_far} | {n_stayed} "
        f"| {held[0]}, {held[1]} | {rejected} ({share:.3f}) | {graph.numbered(Status.UNDECIDED)}"
    )


def _normals(fits: Sequence[SurfaceFit], places: Sequence[int]) -> FloatArray:
    """The normals (n, 3) of the planes among the fits."""
    chosen = [fits[k].surface for k in places]
    return np.array([one.normal_direction for one in chosen if isinstance(one, Plane)]).reshape(-1, 3)


def _off_deg(one: FloatArray, two: FloatArray) -> float:
    """How far two normals (3,) are from parallel or square, whichever is nearer, degrees."""
    angle = float(np.degrees(np.arctan2(np.linalg.norm(np.cross(one, two)), abs(float(one @ two)))))
    return min(angle, 90.0 - angle)
