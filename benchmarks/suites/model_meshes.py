# SPDX-License-Identifier: MIT
"""Meshes of CAD models: faces found once and of their kind, at three chord tolerances and in four formats."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.cases.model_shapes import HELD_OUT, TUNING
from benchmarks.cases.models import FORMATS, TOLERANCES, ModelMesh, model_mesh
from benchmarks.run import head, row, suite
from benchmarks.store import each
from completion.parts.division.result import PartSegmentation
from completion.parts.pipeline import divide_part, relate_part
from completion.parts.step_export import step_model
from scenes.checks import InputError, IntArray
from scenes.io.point_files import read_part_file

OVERLAP = 0.95
"""Share of a face's area that one label must have, and share of that label's area that must be the face's."""


@dataclass(frozen=True, slots=True)
class ModelScore:
    """What became of one file.

    `faults` are faces that were not found or are of another kind, in words; `n_more` labels that are no
    face; `volume` by how much that of the solid is off, as a share, None where it is none; `reason` why.
    """

    name: str
    n_faces: int
    n_found: int
    n_right: int
    n_more: int
    is_model: bool
    seconds: float
    faults: list[str]
    volume: float | None = None
    step_seconds: float = 0.0
    reason: str = ""


def faces_found(model: ModelMesh, part: PartSegmentation) -> tuple[int, int, list[str]]:
    """Faces of a model that a division found, those of them of the right kind, and what is wrong in words."""
    labels: IntArray = np.asarray(part.triangle_labels, dtype=np.int64)
    table = np.zeros((len(model.kinds), len(part.fits) + 1))
    np.add.at(table, (model.face, labels), model.areas)
    shares = np.minimum(
        table / table.sum(axis=1, keepdims=True), table / np.maximum(table.sum(axis=0), 1e-12)
    )
    best, faults, n_right = shares[:, 1:].argmax(axis=1), list[str](), 0
    found = shares[:, 1:].max(axis=1, initial=0.0) >= OVERLAP
    for k, kind in enumerate(model.kinds):
        got = part.fits[best[k]].surface.kind
        n_right += bool(found[k] and got == kind)
        if not (found[k] and got == kind):
            size = f"{(model.face == k).sum()} triangles, {table[k].sum():.3g} mm2"
            most = f"overlaps {shares[k, 1:].max():.2f} with a {got}"
            is_lost = 2 * table[k, 0] > table[k].sum()
            what = f"is a {got}" if found[k] else "is on no surface" if is_lost else most
            faults.append(f"face {k} ({kind}, {size}) {what}")
    return int(found.sum()), n_right, faults


def evaluate_model(name: str, tolerance: str, format_: str, seed: int, with_step: bool) -> ModelScore:
    """Divide the file of a model, and score it; with its solid where asked."""
    model = model_mesh(name, tolerance, seed)
    with tempfile.TemporaryDirectory() as folder:
        held = read_part_file(model.write(Path(folder), "part", format_), "mm")
    title = f"{name} {seed} {tolerance} {format_}"
    if held.mesh is None or len(held.mesh.faces) != len(model.face):
        n = 0 if held.mesh is None else len(held.mesh.faces)
        raise InputError(f"{title}: {n} triangles were read of {len(model.face)}")
    began = time.process_time()
    part = divide_part(held.mesh, step_m=held.step_m)
    seconds = time.process_time() - began
    n_found, n_right, faults = faces_found(model, part)
    n_more = int(len(part.fits) - n_found)
    counts = title, len(model.kinds), n_found, n_right, n_more, part.is_model, seconds, faults
    if not with_step:
        return ModelScore(*counts)
    related = relate_part(held.mesh, part)
    began = time.process_time()
    try:
        solid = step_model(related)
    except InputError as error:
        return ModelScore(*counts, None, time.process_time() - began, str(error))
    off = solid.volume_m3 * 1e9 / model.volume_mm3 - 1 if solid.is_solid and solid.is_valid else None
    return ModelScore(*counts, off, time.process_time() - began, solid.reason)


@suite("model-meshes", smallest="--part nut --tolerance coarse --file stl")
def model_meshes(
    seed: list[int] | None = None,
    only: str = "",
    part: list[str] | None = None,
    tolerance: list[str] | None = None,
    file: list[str] | None = None,
    step: bool = False,
) -> Iterator[str]:
    """Meshes of CAD models: faces found once and of their kind, and with --step their solids.

    --only: tuning (five parts that were looked at) or held-out (ten of other kinds, dimensions by --seed);
    --file: format.
    """
    names = [*(TUNING if only != "held-out" else ()), *(HELD_OUT if only != "tuning" else ())]
    cases = [
        (name, chord, kind, number)
        for name in names
        if not part or name in part
        for chord in tolerance or TOLERANCES
        for kind in file or FORMATS
        for number in ((seed or [0]) if name in HELD_OUT else [0])
    ]
    if not cases:
        raise InputError(f"no such model; there are {', '.join([*TUNING, *HELD_OUT])}")
    scores = list(each(evaluate_model, *(list(column) for column in zip(*cases, strict=True)), step))
    yield from head(
        "file", "faces", "found", "of their kind", "more", "model", "CPU s", *_STEP_HEAD[: 3 * step]
    )
    for score in scores:
        volume = None if score.volume is None else f"{score.volume:+.3%}"
        solid = (volume, f"{score.step_seconds:.1f}", score.reason) if step else ()
        found = score.n_found, score.n_right, score.n_more, "yes" if score.is_model else "no"
        yield row(score.name, score.n_faces, *found, f"{score.seconds:.1f}", *solid)
    yield ""
    yield from (f"- {score.name}: {fault}" for score in scores for fault in score.faults)
    for title, of in (("tuning", TUNING), ("held out", HELD_OUT)):
        half = [score for score, case in zip(scores, cases, strict=True) if case[0] in of]
        if half:
            yield f"\n{title}: {_sentence(half, with_step=step)}"


_STEP_HEAD = "volume", "STEP, CPU s", "why no solid"


def _sentence(scores: list[ModelScore], *, with_step: bool) -> str:
    """Counts of some files."""
    faces = sum(score.n_faces for score in scores)
    right = sum(score.n_right for score in scores)
    whole = sum(score.n_right == score.n_faces and not score.n_more for score in scores)
    solids = [abs(score.volume) for score in scores if score.volume is not None]
    off = f"; {len(solids)} solids, volumes off by {max(solids, default=0.0):.3%} at most"
    return (
        f"{whole} of {len(scores)} files right, {right} of {faces} faces ({right / faces:.1%}), "
        f"{sum(score.n_more for score in scores)} too many, "
        f"{sum(score.is_model for score in scores)} told as models, "
        f"CPU s {sum(score.seconds for score in scores):.0f}{off if with_step else ''}"
    )
