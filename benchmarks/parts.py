# SPDX-License-Identifier: MIT
"""Parts with known primitives: how many of them are found, and which of their relations.

python -m benchmarks.parts [--noise 0 --noise .001] [--only held-out|tuning] [--pictures FOLDER] [NAMES ...]

The parts are those of Fit4CAD (Romanengo et al. 2022) in UNSEEN_DATA/parts; a noise is a share of a part's
diagonal. Primitives count as the data set counts them: a point on a rim belongs to every primitive that it
lies on, and so it does to every face found. "labels" scores labels alone, of which a point has one. A
primitive is found when some face has an intersection over union of .5 (.8) with it. Surfaces are scored
likewise, faces on one surface put together, in the truth and in what is found.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from completion.fitting.pipeline import fit
from completion.fitting.result import FitError
from completion.parts.division.pipeline import segment_part
from completion.parts.division.result import PartSegmentation
from completion.parts.pipeline import MACHINED, related_faces
from scenes.checks import BoolArray, FloatArray, IntArray
from scenes.surfaces.catalogue import Cylinder, Plane, Sphere, Surface, Torus

FOLDER = Path(os.environ.get("UNSEEN_DATA", "../shared/data")) / "parts"
_EXACT = 2e-5  # of the diagonal: how exactly the clouds lie on their surfaces
_BESIDE = 1.6  # sampling distances, within which a point is beside another
_SAME = 1e-4  # of the diagonal, and radians: what holds between true surfaces
_IMPOSED = 1e-7  # the same of surfaces found, after relations were imposed
RELATIONS = ("parallel", "perpendicular", "coaxial", "equal radius")


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """A cloud (n, 3) with the points (k, n) of each primitive and what it is."""

    name: str
    points: FloatArray
    label: IntArray
    primitives: BoolArray
    surfaces: tuple[Surface | None, ...]
    diagonal: float


def parts(only: str | None = None) -> list[Path]:
    """The parts' files: all, those for tuning (even places), or those held out (odd)."""
    files = sorted(FOLDER.glob("*.npz"))
    return files[0::2] if only == "tuning" else files[1::2] if only == "held-out" else files


def read_part(path: Path) -> Part:
    """Read a part, and put the rims of its primitives back that its labels give to one of them."""
    stored = np.load(path, allow_pickle=False)
    points, label = stored["points"].astype(np.float64), stored["label"].astype(np.int64)
    kinds = [one["kind"] for one in json.loads(str(stored["primitives"]))]
    diagonal = float(np.linalg.norm(np.ptp(points, axis=0)))
    near = _BESIDE * float(np.median(cKDTree(points).query(points, k=2)[0][:, 1]))
    surfaces, primitives = list[Surface | None](), np.zeros((len(kinds), len(points)), dtype=np.bool_)
    for number, kind in enumerate(kinds):
        own = points[label == number]
        primitives[number] = label == number
        try:
            surface: Surface | None = fit(own, kind).surface
        except FitError:
            surface = None
        surfaces.append(surface)
        if surface is not None:
            on_it = np.abs(surface.distance(points)) < _EXACT * diagonal
            primitives[number] |= on_it & (cKDTree(own).query(points)[0] < near)
    return Part(path.stem, points, label, primitives, tuple(surfaces), diagonal)


def with_noise(part: Part, noise: float, seed: int) -> FloatArray:
    """The points (n, 3) with normal noise in all directions, as a share of the diagonal."""
    rng = np.random.default_rng(seed)
    return part.points + noise * part.diagonal * rng.normal(size=part.points.shape)


def sets_of(points: FloatArray, found: PartSegmentation, *, rims: bool) -> BoolArray:
    """The points (k, n) of each face; with `rims` those beside it that it explains as well."""
    labels = found.labels.astype(np.int64)
    sets = np.stack([labels == number for number in range(1, len(found.fits) + 1)] or [labels < 0])
    if rims:
        tolerance = max(found.noise_m, 0.01 * found.spacing_m)
        nearest = cKDTree(points).query(points, k=9)[1]
        for number, one in enumerate(found.fits, start=1):
            beside = (labels[nearest] == number).any(axis=1)
            sets[number - 1] |= beside & (np.abs(one.surface.distance(points)) <= tolerance)
    return sets


def overlaps(true: BoolArray, found: BoolArray) -> FloatArray:
    """Intersection over union (k, m) of sets (k, n) and (m, n)."""
    common = true.astype(np.float64) @ found.astype(np.float64).T
    union = true.sum(axis=1)[:, None] + found.sum(axis=1)[None] - common
    return np.asarray(common / np.maximum(union, 1))


def together(sets: BoolArray, groups: Sequence[int]) -> BoolArray:
    """The union of the sets (k, n) of each group."""
    return np.stack([sets[np.array(groups) == group].any(axis=0) for group in sorted(set(groups))])


def true_groups(part: Part) -> list[int]:
    """Which primitives are on one surface: each all on the other's."""
    group = list(range(len(part.surfaces)))
    for one, two in combinations(range(len(group)), 2):
        a, b = part.surfaces[one], part.surfaces[two]
        if a is None or b is None or a.kind != b.kind or group[two] != two:
            continue
        off = [s.distance(part.points[part.primitives[k]]) for s, k in ((a, two), (b, one))]
        if max(np.abs(each).max() for each in off) < _SAME * part.diagonal:
            group[two] = group[one]
    return group


def holds(relation: str, one: Surface, two: Surface, length: float, angle: float) -> bool | None:
    """Whether a relation holds between two surfaces; None where they cannot have it."""
    directions = [getattr(s, "normal_direction", getattr(s, "direction", None)) for s in (one, two)]
    if relation == "equal radius":
        if type(one) is not type(two) or not isinstance(one, Sphere | Cylinder | Torus):
            return None
        radii = [getattr(s, "tube_radius", getattr(s, "radius", 0.0)) for s in (one, two)]
        return bool(abs(radii[0] - radii[1]) < length)
    if directions[0] is None or directions[1] is None:
        return None
    sine = float(np.linalg.norm(np.cross(*directions)))
    if relation == "perpendicular":
        return bool(abs(float(directions[0] @ directions[1])) < angle)
    if relation == "parallel":
        return sine < angle
    if isinstance(one, Plane) or isinstance(two, Plane):
        return None
    places = [getattr(s, "centre", getattr(s, "point", None)) for s in (one, two)]
    gap = places[1] - places[0]
    offset = float(np.linalg.norm(gap - (gap @ directions[0]) * directions[0]))
    return sine < angle and offset < length


def score_relations(
    part: Part, points: FloatArray, found: PartSegmentation, matched: Sequence[int]
) -> FloatArray:
    """Of each relation (4, 4): true pairs, those of them found, pairs found, those of them false."""
    counts = np.zeros((4, 4))
    fits = list(found.fits)
    graph, related, _ = related_faces(found, MACHINED, (), points)
    placed = [fit.surface for fit in fits]
    for moved, number in zip(graph.fits, related, strict=True):
        placed[number] = moved.surface
    for one, two in combinations(range(len(fits)), 2):
        true = [part.surfaces[matched[k]] if matched[k] >= 0 else None for k in (one, two)]
        if true[0] is None or true[1] is None or true[0].kind != fits[one].surface.kind:
            continue
        if true[1].kind != fits[two].surface.kind:
            continue
        for row, relation in enumerate(RELATIONS):
            size = part.diagonal
            is_true = holds(relation, true[0], true[1], _SAME * size, _SAME)
            is_found = holds(relation, placed[one], placed[two], _IMPOSED * size, _IMPOSED)
            if is_true is not None and is_found is not None:
                counts[row] += [is_true, is_true and is_found, is_found, is_found and not is_true]
    return counts


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """What was found of one part at one noise."""

    counts: FloatArray  # primitives, found at .5 and .8, by labels alone, surfaces, found at .5 and .8
    best: FloatArray
    relations: FloatArray
    seconds: float
    found: PartSegmentation


def evaluate(part: Part, noise: float, seed: int) -> Outcome:
    """Segment a part with noise, and score it."""
    points = with_noise(part, noise, seed)
    began = time.process_time()
    found = segment_part(points)
    seconds = time.process_time() - began
    sets = sets_of(points, found, rims=True)
    each = overlaps(part.primitives, sets)
    own = np.stack([part.label == number for number in range(len(part.surfaces))])
    plain = overlaps(own, sets_of(points, found, rims=False)).max(axis=1)
    whole = overlaps(together(part.primitives, true_groups(part)), together(sets, found.groups or [0]))
    best, one = each.max(axis=1), whole.max(axis=1)
    counts = [len(best), (best >= 0.5).sum(), (best >= 0.8).sum(), (plain >= 0.5).sum(), (plain >= 0.8).sum()]
    counts += [len(one), (one >= 0.5).sum(), (one >= 0.8).sum()]
    matched = [int(column.argmax()) if column.max() >= 0.5 else -1 for column in each.T]
    relations = score_relations(part, points, found, matched) if found.fits else np.zeros((4, 4))
    return Outcome(np.array(counts, dtype=np.float64), best, relations, seconds, found)


def main() -> None:
    """Print a line a part, and a table a noise."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--noise", type=float, action="append", help="share of the diagonal; may be repeated")
    parser.add_argument("--only", choices=("tuning", "held-out"))
    parser.add_argument("names", nargs="*", help="parts by name; all when not given")
    given = parser.parse_args()
    files = [path for path in parts(given.only) if not given.names or path.stem in given.names]
    if not files:
        raise SystemExit(f"no parts in {FOLDER}; set UNSEEN_DATA")
    places = {path: place for place, path in enumerate(parts())}
    for noise in given.noise or [0.0, 0.001, 0.005]:
        total, relations, seconds, means = np.zeros(8), np.zeros((4, 4)), list[float](), list[float]()
        for path in files:
            part = read_part(path)
            one = evaluate(part, noise, places[path])
            total, relations = total + one.counts, relations + one.relations
            seconds.append(one.seconds)
            means += one.best.tolist()
            print(f"{noise:g} {part.name}: {one.counts[1]:.0f}, {one.counts[2]:.0f} of {one.counts[0]:.0f}, "
                  f"{one.seconds:.1f} s; {one.found!r}", flush=True)  # fmt: skip
        shares = [*(total[1:5] / total[0]), *(total[6:8] / total[5])]
        print(f"\nnoise {noise:g}, {len(files)} parts, {total[0]:.0f} primitives on {total[5]:.0f} surfaces")
        names = ("primitives at .5", "at .8", "by labels at .5", "at .8", "surfaces at .5", "at .8")
        print(", ".join(f"{name} {share:.1%}" for name, share in zip(names, shares, strict=True)))
        cost = f"mean {np.mean(seconds):.1f}, most {max(seconds):.1f}"
        print(f"mean IoU {np.mean(means):.3f}; CPU s a part: {cost}")
        for name, (n_true, right, n_found, false) in zip(RELATIONS, relations, strict=True):
            print(f"{name}: {n_true:.0f} pairs, recall {right / max(n_true, 1):.3f}, "
                  f"false {false / max(n_found, 1):.2%} of {n_found:.0f}")  # fmt: skip


if __name__ == "__main__":
    main()
