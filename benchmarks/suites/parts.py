# SPDX-License-Identifier: MIT
"""Parts of Fit4CAD: primitives and relations found; STEP files beside their clouds."""

from __future__ import annotations

import json
import os
import resource
import tempfile
import time
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import Delaunay, cKDTree

from benchmarks.run import suite
from benchmarks.store import each
from completion.export.step.faces import is_valid, volume_of
from completion.export.step.kernel import kernel
from completion.fitting.pipeline import fit
from completion.fitting.result import FitError
from completion.parts.division.pipeline import segment_part
from completion.parts.division.result import PartSegmentation
from completion.parts.part import Part as PartModel
from completion.parts.pipeline import MACHINED, divide_part, relate_part, related_faces
from completion.parts.step_export import step_model
from scenes.checks import BoolArray, FloatArray, InputError, IntArray
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
    directions: list[Any] = [
        getattr(s, "normal_direction", getattr(s, "direction", None)) for s in (one, two)
    ]
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
    places: list[Any] = [getattr(s, "centre", getattr(s, "point", None)) for s in (one, two)]
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


@suite("parts", smallest="--noise 0 --part PC29")
def fit4cad(noise: list[float] | None = None, only: str = "", part: list[str] | None = None) -> Iterator[str]:
    """The parts of Fit4CAD: primitives found by intersection over union, and their relations.

    --noise: share of a part's diagonal; --only: tuning or held-out; --part: by name.
    """
    files = _files(only, part)
    for level in noise or [0.0, 0.001, 0.005]:
        total, relations, seconds, means = np.zeros(8), np.zeros((4, 4)), list[float](), list[float]()
        results = each(evaluate_file, [path.stem for path in files], level)
        for path, result in zip(files, results, strict=True):
            total, relations = total + result.counts, relations + result.relations
            seconds.append(result.seconds)
            means += result.best.tolist()
            yield (
                f"{level:g} {path.stem}: {result.counts[1]:.0f}, {result.counts[2]:.0f} of "
                f"{result.counts[0]:.0f}, {result.seconds:.1f} s; {result.described}"
            )
        shares = [*(total[1:5] / total[0]), *(total[6:8] / total[5])]
        yield f"\nnoise {level:g}, {len(files)} parts, {total[0]:.0f} primitives on {total[5]:.0f} surfaces"
        names = ("primitives at .5", "at .8", "by labels at .5", "at .8", "surfaces at .5", "at .8")
        yield ", ".join(f"{name} {share:.1%}" for name, share in zip(names, shares, strict=True))
        cost = f"mean {np.mean(seconds):.1f}, most {max(seconds):.1f}"
        yield f"mean IoU {np.mean(means):.3f}; CPU s a part: {cost}"
        for name, (n_true, right, n_found, false) in zip(RELATIONS, relations, strict=True):
            yield (
                f"{name}: {n_true:.0f} pairs, recall {right / max(n_true, 1):.3f}, "
                f"false {false / max(n_found, 1):.2%} of {n_found:.0f}"
            )


class _Result(NamedTuple):
    """What was found of a part at one noise: as `Outcome`, the division described in words."""

    counts: FloatArray
    best: FloatArray
    relations: FloatArray
    seconds: float
    described: str


def evaluate_file(name: str, noise: float) -> _Result:
    """Segment the part of a name with noise, and score it."""
    places = {path.stem: (place, path) for place, path in enumerate(parts())}
    place, path = places[name]
    result = evaluate(read_part(path), noise, place)
    return _Result(result.counts, result.best, result.relations, result.seconds, repr(result.found))


def _files(only: str, names: list[str] | None) -> list[Path]:
    """The files of parts that are chosen."""
    files = [path for path in parts(only or None) if not names or path.stem in names]
    if not files:
        raise InputError(f"no such parts in {FOLDER}; set UNSEEN_DATA to the folder of the test data")
    return files


class ReadBack:
    """A STEP file as the kernel reads it; lengths in metres."""

    def __init__(self, data: bytes) -> None:
        modules = kernel()
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "read.step"
            file.write_bytes(data)
            reader = modules.STEPControl.STEPControl_Reader()
            reader.ReadFile(str(file))
            reader.TransferRoots()
            self.shape = reader.OneShape()
        self.is_valid = is_valid(self.shape)
        self.volume_m3 = abs(volume_of(self.shape)) * 1e-9
        self.surfaces = [_told(one) for one in _surfaces(self.shape)]

    def nearest(self, surface: Surface) -> tuple[str, FloatArray, FloatArray] | None:
        """Kind, place and axis of the surface in the file that is nearest to one of the part."""
        same = [one for one in self.surfaces if one[0] == surface.kind]
        if not same:
            return None
        return min(same, key=lambda one: _apart(one, surface))


def _surfaces(shape: Any) -> list[Any]:
    modules, found = kernel(), list[Any]()
    walk = modules.TopExp.TopExp_Explorer(shape, modules.TopAbs.TopAbs_ShapeEnum.TopAbs_FACE)
    while walk.More():
        found.append(modules.BRep.BRep_Tool.Surface_s(modules.TopoDS.TopoDS.Face(walk.Current())))
        walk.Next()
    return found


def _told(surface: Any) -> tuple[str, FloatArray, FloatArray]:
    names = {"Plane": "plane", "Cylindrical": "cylinder", "Conical": "cone", "Spherical": "sphere"}
    while hasattr(surface, "BasisSurface"):
        surface = surface.BasisSurface()
    word = type(surface).__name__.removeprefix("Geom_").removesuffix("Surface")
    axis = surface.Position().Axis()
    place = np.array(axis.Location().Coord()) / 1000
    return names.get(word, "torus"), place, np.array(axis.Direction().Coord())


def _apart(one: tuple[str, FloatArray, FloatArray], surface: Surface) -> float:
    """How far a surface of a file is from one of a part: along the normal, or across the axis."""
    _, place, axis = one
    own = getattr(surface, "normal_direction", getattr(surface, "direction", None))
    at: FloatArray = np.asarray(getattr(surface, "point", getattr(surface, "centre", None)))
    gap = place - at
    if surface.kind == "sphere" or own is None:
        return float(np.linalg.norm(gap))
    turned = float(np.linalg.norm(np.cross(own, axis)))
    if surface.kind == "plane":
        return turned + abs(float(gap @ own))
    return turned + float(np.linalg.norm(gap - (gap @ own) * own))


def relation_error(part: PartModel, read: ReadBack, numbers: Collection[int]) -> tuple[float, int]:
    """Largest deviation (radians, metres) of relations that hold between two surfaces, and their number.

    Of parallel, perpendicular, coaxial and coplanar ones, those of surfaces by whose numbers there is a face.
    """
    worst, n = 0.0, 0
    for one in () if part.relations is None else part.relations.relations:
        if not one.holds or one.kind not in ("parallel", "perpendicular", "coaxial", "coplanar"):
            continue
        if not {part.labels[part.related[k]] for k in one.surfaces} <= set(numbers):
            continue
        pair = [read.nearest(part.fits[part.related[k]].surface) for k in one.surfaces]
        if any(each is None for each in pair):
            continue
        (_, p, a), (_, q, b) = (each for each in pair if each is not None)
        off = abs(float(a @ b)) if one.kind == "perpendicular" else float(np.linalg.norm(np.cross(a, b)))
        gap = q - p
        if one.kind == "coaxial":
            off = max(off, float(np.linalg.norm(gap - (gap @ a) * a)))
        if one.kind == "coplanar":
            off = max(off, abs(float(gap @ a)))
        worst, n = max(worst, off), n + 1
    return worst, n


_BALLS = (0.4, 0.5, 0.6, 0.7, 0.8, 0.9)  # of the largest
_TIGHT = 0.97  # of the largest ball's volume: a ball that passes the surface somewhere finds far less


def ball_volume(points: FloatArray, largest: float) -> float:
    """Volume enclosed by points (n, 3) that a ball cannot pass between (Edelsbrunner & Muecke 1994).

    Tetrahedra of the Delaunay triangulation are outside where a ball gets to them through triangles whose
    circumscribed circles are larger than it. Of balls up to a radius the least is taken that stays outside:
    it rounds inner edges least.
    """
    most = _enclosed(points, largest)
    return next(v for share in (*_BALLS, 1.0) if (v := _enclosed(points, share * largest)) >= _TIGHT * most)


def _enclosed(points: FloatArray, radius: float) -> float:
    """Volume that a ball of a radius cannot get to."""
    mesh = Delaunay(points + 1e-9 * np.ptp(points) * np.random.default_rng(0).normal(size=points.shape))
    corners = points[mesh.simplices]
    n = len(corners)
    rows, columns = [], []
    for k in range(4):
        triangle = np.delete(corners, k, axis=1)
        other = mesh.neighbors[:, k]
        passes = _circumradius(triangle) > radius
        rows.append(np.flatnonzero(passes))
        columns.append(np.where(other[passes] < 0, n, other[passes]))
    row, column = np.concatenate(rows), np.concatenate(columns)
    graph = coo_array((np.ones(len(row)), (row, column)), shape=(n + 1, n + 1))
    _, piece = connected_components(graph, directed=False)
    edges = corners[:, 1:] - corners[:, :1]
    volume = np.abs(np.linalg.det(edges)) / 6
    return float(volume[piece[:n] != piece[n]].sum())


def _circumradius(triangles: FloatArray) -> FloatArray:
    """Radii (m,) of the circles about triangles (m, 3, 3)."""
    sides = np.linalg.norm(triangles - np.roll(triangles, 1, axis=1), axis=2)
    across = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    twice = np.linalg.norm(across, axis=1)
    return np.asarray(sides.prod(axis=1) / np.maximum(2 * twice, 1e-300))


_BALL = 1.5  # times the largest of the usual gaps between points
_MM = 1e-3


def exported(path: Path, noise: float, seed: int) -> dict[str, Any]:
    """What one part comes to."""
    truth = read_part(path)
    points = with_noise(truth, noise, seed) * _MM
    found = relate_part(points, divide_part(points))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    began = time.process_time()
    out: dict[str, Any] = {"name": path.stem, "regions": len(found.fits)}
    try:
        model = step_model(found, path.stem)
    except InputError as error:
        return {**out, "valid": False, "solid": False, "reason": str(error), "faces": 0}
    out["seconds"] = time.process_time() - began
    after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    read = ReadBack(model.data)
    worst, n = relation_error(found, read, [one.number for one in model.faces if not one.reason])
    gap = float(np.quantile(cKDTree(truth.points).query(truth.points, k=7)[0][:, -1], 0.995))
    ball = ball_volume(truth.points * _MM, _BALL * gap * _MM)
    return {
        **out, **model.record(), "valid": model.is_valid and read.is_valid, "ball_m3": ball,
        "read_back": abs(read.volume_m3 / model.volume_m3 - 1) if model.n_solids else 0.0,
        "error": model.volume_m3 / ball - 1 if model.is_solid and ball > 0 else None,
        "relations": worst, "n_relations": n, "peak_mb": after / 1024, "grown_mb": (after - before) / 1024,
    }  # fmt: skip


@suite("step", smallest="--part PC29")
def step(noise: float = 0.0, only: str = "", part: list[str] | None = None) -> Iterator[str]:
    """The parts of Fit4CAD as STEP files: validity, solids, volumes and relations when they are read back.

    --noise: share of a part's diagonal; --only: tuning or held-out; --part: by name. Volumes are compared
    with what a rolling ball cannot enter of the cloud without noise; each part has a process of its own.
    """
    rows = list(each(_exported_apart, [path.stem for path in _files(only, part)], noise))
    yield from map(line, rows)
    yield "\n" + summary(rows)


def _exported_apart(name: str, noise: float) -> dict[str, Any]:
    """Export the part of a name in a process of its own."""
    place, path = next((k, path) for k, path in enumerate(parts()) if path.stem == name)
    with ProcessPoolExecutor(1) as pool:
        return pool.submit(exported, path, noise, place).result()


def line(row: dict[str, Any]) -> str:
    """A part in words."""
    what = "solid" if row["solid"] else "open"
    valid = "valid" if row["valid"] else "NOT VALID"
    text = f"{row['name']}: {what}, {valid}, {row['faces']} faces of {row['regions']} regions"
    if row.get("error") is not None:
        text += f", volume {row['volume_m3'] * 1e6:.4f} cm3, {100 * row['error']:+.2f} % of the ball's"
    if "seconds" in row:
        text += f", relations {row['relations']:.1e} ({row['n_relations']}), gap {1e3 * row['gap_m']:.2g} mm"
        text += f", {row['seconds']:.1f} s, {row['peak_mb']:.0f} MB"
    return text + (f"; {row['reason']}" if row["reason"] else "")


def summary(rows: list[dict[str, Any]]) -> str:
    """All parts in words."""
    done = [row for row in rows if "seconds" in row]
    if not done:
        return f"none of {len(rows)} parts was exported: {'; '.join({row['reason'] for row in rows})}"
    errors = np.abs([row["error"] for row in rows if row.get("error") is not None])
    why = Counter(
        "no face at all"
        if not row["faces"]
        else "a surface could not be trimmed"
        if "could not be trimmed" in row["reason"]
        else "a face ends in the open"
        for row in rows
        if not row["solid"]
    )
    seconds = [row["seconds"] for row in done]
    return "\n".join(
        [
            f"{len(rows)} parts: {sum(row['valid'] for row in rows)} valid, "
            f"{sum(row['solid'] for row in rows)} solids",
            "others: " + (", ".join(f"{n} {reason}" for reason, n in why.items()) or "none"),
            f"faces: {sum(row['faces'] for row in rows)} of {sum(row['regions'] for row in rows)} regions",
            f"volume off the ball's: median {100 * np.median(errors):.2f} %, "
            f"95 % {100 * np.quantile(errors, 0.95):.2f} %" if len(errors) else "no volume",
            f"volume read back: off by {max(row['read_back'] for row in done):.1e} at most",
            f"relations in the file: off by {max(row['relations'] for row in done):.1e} at most, of "
            f"{sum(row['n_relations'] for row in done)}",
            f"CPU s: median {np.median(seconds):.1f}, most {max(seconds):.1f}",
            f"peak memory {max(row['peak_mb'] for row in done):.0f} MB, of which the export "
            f"{max(row['grown_mb'] for row in done):.0f}",
        ]
    )  # fmt: skip
