# SPDX-License-Identifier: MIT
"""Openings behind clutter, walls without any, reveals, and the doorways and windows of a duplex house."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from benchmarks.cases.buildings import TrueBuilding
from benchmarks.cases.frames import DATA
from benchmarks.cases.walls import KINDS, NULLS, WallCase, null_case, opening_case
from benchmarks.run import head, row, suite
from benchmarks.store import each
from benchmarks.suites.buildings import has_rooms_on_both_sides, house_scans, leaf_groups
from completion import CompletionOptions, complete
from completion.extension.patch import Patch, Provenance
from completion.features.engine.template import FeatureStatus, SideState, TemplateFit
from completion.features.openings.decision import LEVELS, rank
from completion.features.pipeline import find_features
from completion.result.completion import Completion
from scenes import RayCaster
from scenes.checks import FloatArray
from scenes.io.scene_files import open_scene

_RIGHT_M = 0.03
_SEEN = 0.3  # share of a side that must be in sight for it to be asked for
_HARDLY = 0.02  # share up to which a side is not in sight
_HIDDEN = (0.3, 0.5, 0.7)  # share of an opening
_SAME = 0.7  # of what is found that must lie within the true one: the rest of that may be hidden


@dataclass(frozen=True, slots=True)
class SideError:
    """A side of an opening that was found: its error and deviation, metres, and whether it was in sight."""

    kind: str
    name: str
    error: float
    deviation: float
    state: SideState
    in_sight: float


class _Wall(NamedTuple):
    """A wall: whether its opening was found and asked for, false ones, its kind's rightness, sides, depth."""

    is_found: bool
    is_asked: bool
    n_false: int
    is_kind_right: bool | None
    sides: list[SideError]
    depth_m: list[float]
    told: list[str]


def _wall(seed: int, kind: str, hidden: float, noise: float) -> _Wall:
    """Find the opening of a wall."""
    case = opening_case(seed, kind, hidden, noise)
    fits = find_features([case.scan], KINDS).fits
    found = [fit for fit in fits if fit.status is not FeatureStatus.NONE]
    same = [fit for fit in found if _overlap(case, fit) > _SAME]
    asked = sum(share >= _SEEN for share in case.seen.values()) >= 2
    sides = _errors(case, same[0]) if same else []
    depth = [float(same[0].value("depth") - case.depth)] if same else []
    right = same[0].kind == kind if same and "bottom" not in same[0].unseen else None
    told = list(_told(seed, case, fits))
    return _Wall(bool(same) and asked, asked, len(found) - len(same), right, sides, depth, told)


@suite("openings", smallest="--seeds 1")
def openings(first: int = 0, seeds: int = 10, noise: float = 0.005, listed: bool = False) -> Iterator[str]:
    """Doorways, windows and niches behind clutter, 30, 50 and 70 % hidden; --noise in metres."""
    yield from head(
        "kind, hidden", "found", "of", "false", "sides in sight right", "median mm", "depth mm", "z"
    )
    every = list[_Wall]()
    for kind in KINDS:
        for hidden in _HIDDEN:
            walls = list(each(_wall, range(first, first + seeds), kind, hidden, noise))
            yield from (line for wall in walls if listed for line in wall.told)
            every += walls
            seen = [side for wall in walls for side in wall.sides if _is_confirmed(side)]
            off = np.array([abs(side.error) for side in seen])
            z = np.array([abs(side.error) / side.deviation for side in seen])
            depth = np.abs([value for wall in walls for value in wall.depth_m])
            yield row(
                f"{kind} {hidden:.0%}", sum(wall.is_found for wall in walls),
                sum(wall.is_asked for wall in walls), sum(wall.n_false for wall in walls),
                f"{(off < _RIGHT_M).sum()} of {len(off)}", f"{1000 * np.median(off):.2f}",
                f"{1000 * np.median(depth):.1f}", f"{np.median(z):.2f}",
            )  # fmt: skip
    sides = [side for wall in every for side in wall.sides]
    seen = [side for side in sides if _is_confirmed(side)]
    missed = [side for side in sides if side.in_sight >= _SEEN and side.state is not SideState.CONFIRMED]
    blind = [side for side in sides if side.in_sight <= _HARDLY]
    blind = [side for side in blind if (side.kind, side.name) != ("doorway", "bottom")]  # the floor goes on
    off = np.array([abs(side.error) for side in seen])
    jambs = [abs(side.error) for side in seen if side.kind == "doorway" and side.name in ("left", "right")]
    z = np.array([abs(side.error) / max(side.deviation, 1e-9) for side in seen])
    found = sum(wall.is_found for wall in every)
    precision = found / max(found + sum(wall.n_false for wall in every), 1)
    recall = found / max(sum(wall.is_asked for wall in every), 1)
    kinds = np.mean([wall.is_kind_right for wall in every if wall.is_kind_right is not None])
    yield f"F1 {2 * precision * recall / max(precision + recall, 1e-9):.3f}, kinds {kinds:.2f}"
    share = (off < _RIGHT_M).mean()
    yield f"sides in sight within 3 cm {share:.3f} of {len(off)}, not confirmed {len(missed)}"
    yield f"median {1000 * np.median(off):.2f} mm, doors' jambs {1000 * np.median(jambs):.2f} mm"
    yield f"|z| median {np.median(z):.2f}, above 3: {(z > 3).mean():.3f}"
    unseen = np.mean([side.state is not SideState.CONFIRMED for side in blind])
    yield f"sides out of sight called unseen {unseen:.3f} of {len(blind)}"


def _is_confirmed(side: SideError) -> bool:
    return side.in_sight >= _SEEN and side.state is SideState.CONFIRMED


def _null(seed: int, kind: str, noise: float) -> list[tuple[str, float]]:
    """Status and evidence of each fit to a wall without opening."""
    case = null_case(seed, kind, noise)  # type: ignore[arg-type]
    return [(fit.status.value, float(fit.evidence)) for fit in find_features([case.scan], KINDS).fits]


@suite("nulls", smallest="--seeds 1")
def nulls(first: int = 0, seeds: int = 50, noise: float = 0.005, tail: bool = False) -> Iterator[str]:
    """Walls without openings, but with what looks like one: how many are found.

    --tail: the table of the null of openings in the package.
    """
    yield from head("null", "walls", "false", "ambiguous", "greatest evidence")
    every = list[list[tuple[str, float]]]()
    for kind in NULLS:
        walls = list(each(_null, range(first, first + seeds), kind, noise))
        every += walls
        false, unsure = (
            sum(any(status == wanted.value for status, _ in fits) for fits in walls)
            for wanted in (FeatureStatus.FOUND, FeatureStatus.AMBIGUOUS)
        )
        most = max((evidence for fits in walls for _, evidence in fits), default=0.0)
        yield row(kind, seeds, false, unsure, f"{max(most, 0.0):.0f}")
    if tail:
        yield from tail_lines([[(FeatureStatus(status), value) for status, value in fits] for fits in every])


def tail_lines(walls: Sequence[Sequence[tuple[FeatureStatus, float]]]) -> list[str]:
    """Return, of walls' fits, how many walls have one as good: by status first, then by evidence."""
    out = [f"N_WALLS = {len(walls)}"]
    for status in FeatureStatus:
        ranks = [[rank(status, evidence) for status, evidence in fits] for fits in walls]
        held = [sum(any(one >= rank(status, nats) for one in fits) for fits in ranks) for nats in LEVELS]
        out.append(f"{status.name}: {tuple(held)}")
    return out


def _rectangle(case: WallCase, fit: TemplateFit) -> tuple[FloatArray, float]:
    """The fit's y and z of the near and far corner (4,) in the world, and how far it is from the wall."""
    points = np.asarray(fit.geometry["corners"])
    off = float(np.abs(points[:, 0] - case.x).max())
    return np.array([*points[:, 1:].min(axis=0), *points[:, 1:].max(axis=0)]), off


def _overlap(case: WallCase, fit: TemplateFit) -> float:
    if case.hole is None:
        return 0.0
    found, off = _rectangle(case, fit)
    true = np.array(case.hole)
    shared = np.prod(np.clip(np.minimum(found[2:], true[2:]) - np.maximum(found[:2], true[:2]), 0, None))
    return float(shared / np.prod(found[2:] - found[:2])) * (off < 0.2)


def _errors(case: WallCase, fit: TemplateFit) -> list[SideError]:
    """Errors of all sides; left is the greater y, as seen from the room."""
    found = _rectangle(case, fit)[0] - np.array(case.hole)
    at = {"left": found[2], "right": found[0], "bottom": found[1], "top": found[3]}
    return [
        SideError(
            case.kind, side.name, float(at[side.name]), side.deviation, side.state, case.seen[side.name]
        )
        for side in fit.sides
    ]


def _told(seed: int, case: WallCase, fits: Sequence[TemplateFit]) -> Iterator[str]:
    true = None if case.hole is None else np.round(case.hole, 3).tolist()
    yield f"{case.kind} {seed} {true} depth {case.depth:.3f} hidden {case.hidden:.2f}"
    for fit in fits:
        at = np.round(_rectangle(case, fit)[0], 3).tolist()
        text = f"d {fit.value('depth'):.3f} evidence {fit.evidence:.0f} {fit.reason}"
        yield f"   {fit.kind} {fit.status} {at} {text}"


_OFF_M = 0.03  # from a true reveal, up to which a place is right


@suite("reveals", smallest="--n 1")
def reveals(first: int = 7000, n: int = 4) -> Iterator[str]:
    """Reveals of openings that completion infers: area, share that is right; -n seeds of nine walls each."""
    rows: dict[str, list[list[float]]] = {"measured": [], "unmeasured": []}
    hidden = 0.0
    for seed in range(first, first + n):
        for kind in KINDS:
            for area, faces in each(_reveals_of, seed, kind, list(_HIDDEN)):
                hidden += area
                for name, values in faces:
                    rows[name].append(values)
    yield f"{n * len(KINDS) * len(_HIDDEN)} walls, {hidden:.2f} m2 of true reveals at their seen sides"
    for name, faces_of in rows.items():
        if faces_of:
            seen, made, right, claimed = np.sum(faces_of, axis=0)
            yield (
                f"{name}: {len(faces_of)} faces, measured {seen:.2f} m2, inferred {made:.2f} m2, right "
                f"{right / max(made, 1e-9):.3f}, stated {claimed / max(made, 1e-9):.3f}"
            )


def _reveals_of(seed: int, kind: str, share: float) -> tuple[float, list[tuple[str, list[float]]]]:
    """True area of a wall's reveals; of each face of a feature the figures of `_rows`."""
    case = opening_case(seed, kind, share)
    done = complete(case.scan, CompletionOptions(texture=False), rng=0)
    return _truth_m2(case), [(name, [float(v) for v in values]) for name, values in _rows(case, done)]


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
    return np.asarray(near & ((places >= low - _OFF_M) & (places <= high + _OFF_M)).all(axis=1))


def _truth_m2(case: WallCase) -> float:
    if case.hole is None:
        return 0.0
    y0, z0, y1, z1 = case.hole
    length = {"left": z1 - z0, "right": z1 - z0, "bottom": y1 - y0, "top": y1 - y0}
    if case.kind == "doorway":
        del length["bottom"]
    return case.depth * sum(size for name, size in length.items() if case.seen.get(name, 0.0) > 0)


_LEAST_M2 = 0.05
_OFF_M_OF_DUPLEX = 0.4  # between a hole's middle plane and the side of its wall
_IN_REVEAL_M = 0.02  # behind the face of a wall
_HOLE_M, _AROUND_M, _BEFORE_M = 0.01, 0.1, 0.35  # grid, margin, and where beams start before the middle
_HALF_CELL_M = _HOLE_M / 2


@dataclass(frozen=True, slots=True, eq=False)
class _Hole:
    """The true hole of leaves: the axis across its wall, its box, and whether it leads to the outside."""

    axis: int
    low: FloatArray
    high: FloatArray
    is_outer: bool


@dataclass(slots=True)
class _Tally:
    """What became of holes of one sort."""

    holes: int = 0
    told: int = 0
    whole: int = 0  # all of whose seen sides are right
    errors: list[float] = field(default_factory=list)
    z: list[float] = field(default_factory=list)

    def add(self, sides: list[tuple[str, float, float]]) -> None:
        """Count a hole that was told, with its seen sides."""
        self.told += 1
        self.whole += all(abs(error) < _RIGHT_M for _, error, _ in sides)
        self.errors += [error for _, error, _ in sides]
        self.z += [abs(error) / sd for _, error, sd in sides]

    def __str__(self) -> str:
        off = np.abs(self.errors)
        if not len(off):
            return f"{self.told} of {self.holes}"
        right = f"{(off < _RIGHT_M).mean():.3f} of {len(off)} seen sides within 3 cm"
        said = f"median {1000 * np.median(off):.1f} mm, |z| median {np.median(self.z):.2f}"
        return f"{self.told} of {self.holes}, {self.whole} with all seen sides right; {right}, {said}"


@suite("duplex", smallest="--stations 2")
def duplex(
    stations: int = 14,
    noise: str = "gaussian-2mm",
    listed: bool = False,
) -> Iterator[str]:
    """Holes of doors and windows, all leaves taken out, from a panorama in each of the largest rooms."""
    truth = TrueBuilding.read(DATA / "buildings/duplex.npz")
    holes = _holes(truth)
    house = open_scene(DATA / "buildings/duplex.glb", up="y").without(("*Door*", "*Window*")).ray_caster()
    scans = list(house_scans(stations, noise, "panorama"))
    start = time.process_time()
    features = find_features(scans, ("doorway", "window", "niche"), rng=0)
    spent = time.process_time() - start
    found = [
        fit for fit in features.fits if fit.status is FeatureStatus.FOUND and not fit.geometry["is_closed"]
    ]
    unsure = [fit for fit in features.fits if fit.status is FeatureStatus.AMBIGUOUS]
    matched: set[int] = set()
    tally = {name: _Tally() for name in ("inner, found", "outer, found", "outer, ambiguous")}
    for hole in holes:
        side = "outer" if hole.is_outer else "inner"
        same = [k for k, fit in enumerate(found) if _lies_in(fit, hole)]
        doubtful = [fit for fit in unsure if _lies_in(fit, hole)]
        matched |= set(same)
        tally[f"{side}, found"].holes += 1
        tally["outer, ambiguous"].holes += hole.is_outer and not same
        if listed:
            what = [found[k].kind for k in same], [fit.reason[:30] for fit in doubtful]
            yield f"{side} {np.round(hole.low, 2)} {np.round(hole.high, 2)}: {what}"
        told = found[same[0]] if same else doubtful[0] if doubtful and hole.is_outer else None
        if told is None:
            continue
        errors = _errors_of_duplex(told, house)
        tally[f"{side}, {'found' if same else 'ambiguous'}"].add(errors)
        for name, error, sd in errors:
            if listed and abs(error) > _RIGHT_M:
                yield f"   {name} off by {1000 * error:.0f} mm, sd {1000 * sd:.1f}"
    others = [fit for k, fit in enumerate(found) if k not in matched]
    for name, one in tally.items():
        yield f"{name}: {one}"
    free = [_is_free(fit, house) for fit in others]
    yield (
        f"found elsewhere {len(others)}, of which beams pass {sum(free)}: holes without a leaf; ambiguous in "
        f"all {len(unsure)}; {spent:.0f} s of processors"
    )
    for fit, is_free in zip(others, free, strict=True):
        corners = np.asarray(fit.geometry["corners"])
        at = f"{np.round(corners.min(axis=0), 2)} {np.round(corners.max(axis=0), 2)}"
        off = [(name, round(1000 * error)) for name, error, _ in _errors_of_duplex(fit, house)]
        yield f"   elsewhere: {fit.kind} {at}, {'open' if is_free else 'FALSE'}, sides off by mm {off}"


def _holes(truth: TrueBuilding) -> list[_Hole]:
    """The holes of all groups of leaves that touch."""
    out = []
    for axis, box in leaf_groups(truth):
        places = _hole(truth, box, axis)
        if len(places) * _HOLE_M**2 >= _LEAST_M2:
            low, high = places.min(axis=0) - _HALF_CELL_M, places.max(axis=0) + _HALF_CELL_M
            out.append(_Hole(axis, low, high, not has_rooms_on_both_sides(truth, box, axis)))
    return out


def _hole(truth: TrueBuilding, box: FloatArray, axis: int) -> FloatArray:
    """Places (n, 3) around the box of a leaf where a beam goes straight through the wall."""
    other, middle = 1 - axis, box.mean(axis=0)
    steps = [np.arange(box[0, k] - _AROUND_M, box[1, k] + _AROUND_M, _HOLE_M) for k in (other, 2)]
    places = np.empty((len(steps[0]) * len(steps[1]), 3))
    places[:, [other, 2]] = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, 2)
    places[:, axis] = middle[axis] - _BEFORE_M
    hits = truth.shell.first_hit(places, np.tile(np.eye(3)[axis], (len(places), 1)))
    free = (hits.ranges > 2 * _BEFORE_M).reshape(len(steps[0]), len(steps[1]))
    part, _ = ndimage.label(free)  # margins may lie within walls that stand across
    sizes = np.bincount(part.ravel())
    sizes[0] = 0
    hole = part == int(np.argmax(sizes))
    for count, along in ((hole.sum(axis=1), 1), (hole.sum(axis=0), 0)):
        few = count < count.max() / 2
        hole &= ~(few[:, None] if along else few[None, :])
    return np.asarray(places[hole.ravel()] + _BEFORE_M * np.eye(3)[axis])


def _lies_in(fit: TemplateFit, hole: _Hole) -> bool:
    """Whether most of an opening lies within a hole, in a wall beside its middle."""
    axis, low, high = hole.axis, hole.low, hole.high
    corners = np.asarray(fit.geometry["corners"])
    at, end = corners.min(axis=0), corners.max(axis=0)
    if end[axis] - at[axis] > 0.1 or abs(at[axis] - low[axis]) > _OFF_M_OF_DUPLEX:
        return False
    flat = [1 - axis, 2]
    shared = np.clip(np.minimum(end, high) - np.maximum(at, low), 0, None)[flat]
    return bool(np.prod(shared) > 0.7 * np.prod((end - at)[flat]))


def _errors_of_duplex(fit: TemplateFit, house: RayCaster) -> list[tuple[str, float, float]]:
    """Errors of the sides that were seen, outwards, with their deviations, metres.

    Where a side is, rays say that start within the opening, just behind the wall's face, and go along it.
    """
    corners, into = np.asarray(fit.geometry["corners"]), np.asarray(fit.geometry["into"])
    across, up = corners[1] - corners[0], corners[3] - corners[0]
    middle = corners.mean(axis=0) + _IN_REVEAL_M * into
    found = []
    for side in fit.sides:
        if side.state is not SideState.CONFIRMED:
            continue
        sign = 1.0 if side.name in ("right", "top") else -1.0
        out, along = (across, up) if side.name in ("left", "right") else (up, across)
        half = np.linalg.norm(out) / 2
        starts = middle + np.linspace(-0.35, 0.35, 15)[:, None] * along
        way = sign * out / np.linalg.norm(out)
        away = house.first_hit(starts, np.tile(way, (len(starts), 1))).ranges
        found.append((side.name, float(half - np.median(away)), max(side.deviation, 1e-6)))
    return found


def _is_free(fit: TemplateFit, house: RayCaster) -> bool:
    """Whether beams straight through an opening meet nothing for half a metre, nearly all over it."""
    corners, into = np.asarray(fit.geometry["corners"]), np.asarray(fit.geometry["into"])
    steps = np.linspace(0.02, 0.98, 40)
    a, b = (grid.ravel()[:, None] for grid in np.meshgrid(steps, steps))
    places = corners[0] + a * (corners[1] - corners[0]) + b * (corners[3] - corners[0]) - 0.05 * into
    hits = house.first_hit(places, np.tile(into, (len(places), 1)))
    return bool((hits.ranges > 0.5).mean() > 0.9)
