# SPDX-License-Identifier: MIT
"""Reveals that completion infers of fitted openings, against those that are there."""

from __future__ import annotations

import numpy as np
import typer

from benchmarks.features.walls import KINDS, WallCase, opening_case
from completion import CompletionOptions, complete
from completion.extension.patch import Patch, Provenance
from completion.result.completion import Completion
from scenes.checks import FloatArray

_OFF_M = 0.03  # from a true reveal, up to which a place is right
_HIDDEN = (0.3, 0.5, 0.7)


def reveals(
    first: int = typer.Option(7000, "--first", help="Seed of the first; tuning seeds are below 1000."),
    n: int = typer.Option(4, "-n", help="Seeds, of nine walls each."),
) -> None:
    """Area of reveals that was inferred, how much of it is right, and how much of what is hidden it is."""
    rows: dict[str, list[tuple[float, float, float, float]]] = {"measured": [], "unmeasured": []}
    hidden = 0.0
    for seed in range(first, first + n):
        for kind in KINDS:
            for share in _HIDDEN:
                case = opening_case(seed, kind, share)
                done = complete(case.scan, CompletionOptions(texture=False), rng=0)
                hidden += _truth_m2(case)
                for name, row in _rows(case, done):
                    rows[name].append(row)
    print(f"{n * len(KINDS) * len(_HIDDEN)} walls, {hidden:.2f} m2 of true reveals at their seen sides")
    for name, some in rows.items():
        if some:
            seen, made, right, claimed = np.sum(some, axis=0)
            print(
                f"{name}: {len(some)} faces, measured {seen:.2f} m2, inferred {made:.2f} m2, right "
                f"{right / max(made, 1e-9):.3f}, stated {claimed / max(made, 1e-9):.3f}"
            )


def _rows(case: WallCase, done: Completion) -> list[tuple[str, tuple[float, float, float, float]]]:
    """For each face of a feature the area measured, inferred, right, and that times its confidence."""
    out = []
    for patch in done.patches:
        if not (patch.provenance == Provenance.FEATURE).any():
            continue
        made, area = patch.hypothesised, patch.grid.cell_area
        places = done.world_from_reference.apply(patch.grid.centres())[made.ravel()]
        right = float(np.count_nonzero(_is_right(case, patch, places, done))) * area
        name = "measured" if patch.source.n_pixels else "unmeasured"
        claimed = float(patch.confidence[made].sum()) * area
        out.append((name, (patch.observed_m2, patch.hypothesised_m2, right, claimed)))
    return out


def _is_right(case: WallCase, patch: Patch, places: FloatArray, done: Completion) -> FloatArray:
    """Whether places (n, 3) lie on a true reveal that looks the way the face does."""
    if case.hole is None:
        return np.zeros(len(places), dtype=np.bool_)
    normal = done.world_from_reference.rotate(patch.grid.surface.normal(np.zeros((1, 3))))[0]
    y0, z0, y1, z1 = case.hole
    low, high = np.array([case.x, y0, z0]), np.array([case.x + case.depth, y1, z1])
    axis = int(np.argmax(np.abs(normal)))
    side = low[axis] if normal[axis] > 0 else high[axis]
    near = np.abs(places[:, axis] - side) <= _OFF_M
    return near & ((places >= low - _OFF_M) & (places <= high + _OFF_M)).all(axis=1)


def _truth_m2(case: WallCase) -> float:
    if case.hole is None:
        return 0.0
    y0, z0, y1, z1 = case.hole
    length = {"left": z1 - z0, "right": z1 - z0, "bottom": y1 - y0, "top": y1 - y0}
    if case.kind == "doorway":
        del length["bottom"]
    return case.depth * sum(size for name, size in length.items() if case.seen.get(name, 0.0) > 0)
