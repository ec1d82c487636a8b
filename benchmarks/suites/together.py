# SPDX-License-Identifier: MIT
"""Several scans completed at once against each of them alone, their poses right or wrong."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from benchmarks.cases.frames import REAL, WALKS, Source, Walk
from benchmarks.cases.rooms import hypothesis_of
from benchmarks.metrics.inferred import sample
from benchmarks.metrics.other_scans import is_there, score_by_others
from benchmarks.run import head, suite
from benchmarks.store import each
from benchmarks.suites.ledger import CELL_M
from completion import CompletionOptions, complete
from completion.extension.patch import Patch
from completion.observe.observation import observe
from completion.registration.correction import ScanPair
from completion.registration.pipeline import correct_poses
from completion.result.completed_model import CompletedModel
from scenes.checks import FloatArray, IntArray
from scenes.pose import Pose
from scenes.scan.range_image import RangeImage
from scenes.surfaces.catalogue import Plane

LEAST_M2 = 0.1  # measured area of surfaces that are compared
_MOST = 2000  # pixels of a surface that are looked at
_SHARED = 0.5  # of a surface's pixels that its counterpart holds

TruePlane = Callable[[int, IntArray], FloatArray | None]
"""The true normal (3,), sensor frame, of what flat pixels (n,) of a scan see; None where that is no plane."""


@dataclass(frozen=True, slots=True)
class Compared:
    """One surface of a scan alone, and the one of all scans together that has its pixels.

    `scan`, `alone`, `together`: numbers, from 0. `tilt_alone_deg`, `tilt_deg`: between its normal and the
    reference, alone and together. `rms_alone_m`, `rms_m`: of the pixels that are theirs alone and together
    about the surface, alone and together. `inferred_alone_m2`, `inferred_m2`: inferred area of the two.
    """

    scan: int
    alone: int
    together: int
    area_m2: float  # measured by the scan alone
    tilt_alone_deg: float
    tilt_deg: float
    rms_alone_m: float
    rms_m: float
    inferred_alone_m2: float
    inferred_m2: float


def compare_surfaces(
    alone: Sequence[CompletedModel], together: CompletedModel, truth: TruePlane | None = None
) -> list[Compared]:
    """Compare the planes of scans alone with those of all together.

    The reference of tilts is the truth, or else the plane of the scan alone that knows it best of those with
    the same counterpart.
    """
    found = []
    for number in range(len(together.patches)):
        held = [
            (scan, k, patch)
            for scan, one in enumerate(alone)
            for k, patch in enumerate(one.patches)
            if _is_compared(patch) and _counterpart(patch, together.owners[scan]) == number
        ]
        if not held or not isinstance(together.patches[number].source.fit.surface, Plane):
            continue
        best = min(held, key=lambda one: _doubt(one[2]))
        for scan, k, patch in held:
            pixels = patch.source.pixels[0].flat
            pixels = pixels[together.owners[scan].ravel()[pixels] == number + 1]
            pixels = pixels[:: max(1, len(pixels) // _MOST)]
            own, joint = _normal(alone[scan], 0, patch), _normal(together, scan, together.patches[number])
            reference = truth(scan, pixels) if truth else _turned(best, alone, together, scan)
            if reference is None:
                continue
            found.append(
                Compared(
                    scan=scan,
                    alone=k,
                    together=number,
                    area_m2=patch.observed_m2,
                    tilt_alone_deg=_angle(own, reference),
                    tilt_deg=_angle(joint, reference),
                    rms_alone_m=_rms(alone[scan], 0, patch, pixels),
                    rms_m=_rms(together, scan, together.patches[number], pixels),
                    inferred_alone_m2=patch.hypothesised_m2,
                    inferred_m2=together.patches[number].hypothesised_m2,
                )
            )
    return found


def _is_compared(patch: Patch) -> bool:
    return isinstance(patch.source.fit.surface, Plane) and patch.observed_m2 >= LEAST_M2


def _counterpart(patch: Patch, owners: IntArray) -> int:
    """The surface, from 0, that holds most of a surface's pixels; -1 if none has half of them."""
    held = patch.source.pixels[0].pick(owners)
    count = np.bincount(held, minlength=1)
    count[0] = 0
    best = int(count.argmax())
    return best - 1 if count[best] > _SHARED * len(held) else -1


def _doubt(patch: Patch) -> float:
    """Predicted deviation of the normal, radians."""
    return float(np.sqrt(np.trace(patch.source.fit.covariance[1:, 1:])))


def _normal(model: CompletedModel, scan: int, patch: Patch) -> FloatArray:
    """The normal (3,) of a plane in the sensor frame of a scan."""
    back = model.observations[scan].scan.world_from_sensor.inverse()
    return back.rotate(patch.source.fit.surface.normal(np.zeros((1, 3)))[0])


def _turned(
    best: tuple[int, int, Patch], alone: Sequence[CompletedModel], together: CompletedModel, scan: int
) -> FloatArray:
    """The normal (3,) of the best plane of a scan alone, carried to another scan by the poses used."""
    here, there = (together.observations[k].scan.world_from_sensor for k in (best[0], scan))
    return there.inverse().rotate(here.rotate(_normal(alone[best[0]], 0, best[2])))


def _rms(model: CompletedModel, scan: int, patch: Patch, pixels: IntArray) -> float:
    points = model.observations[scan].points_at(pixels)
    return float(np.sqrt(np.mean(np.square(patch.source.fit.surface.distance(points)))))


def _angle(one: FloatArray, other: FloatArray) -> float:
    """Degrees between two directions, without sign."""
    return float(np.degrees(np.arccos(np.clip(abs(one @ other), -1.0, 1.0))))


_NEAR_M = 0.06  # from a place to what is known of the same
_THINNED = 3  # measured points of which one is looked at
_FLAT_M = 0.003  # root mean square of what is a plane in truth


@dataclass(frozen=True, slots=True)
class Trial:
    """What came of some scans alone and together.

    `right_m2`, `wrong_m2`: inferred area that is there or not, by the truth or by frames that were left out:
    the mean of the scans alone, and together; square metres. Only what is hidden and 10 cm from all that was
    measured.
    """

    name: str  # of the scans, and how far their poses were put off
    compared: tuple[Compared, ...]  # surface by surface
    pairs: tuple[ScanPair, ...]  # what the scans say of each other's poses
    moved_m: float  # how far one was moved at most, metres
    right_m2: tuple[float, float]
    wrong_m2: tuple[float, float]
    kept: float  # share of what scans alone inferred rightly that all together measured or inferred, too


def run(
    source: Source, frames: Sequence[int], options: CompletionOptions, off: tuple[float, float], seed: int
) -> Trial:
    """Complete some frames of a source alone and together.

    Each pose is turned about the sensor by `off[0]` degrees and shifted by `off[1]` metres, in directions
    drawn from the seed.
    """
    rng, places = np.random.default_rng(seed), settled(source)
    true = [places[k] for k in frames]
    scans = [_put_off(source.frames[k], *off, rng) for k in frames]
    alone = [complete(one, options, rng=0) for one in scans]
    together = complete(scans, options, rng=0)
    others = [one for k, one in enumerate(places) if k not in frames]
    plane = _Truth(source, true).normal if isinstance(source, Walk) else None
    apart = [
        _score(source, one, [given], first, others)
        for one, given, first in zip(alone, scans, true, strict=True)
    ]
    joint = _score(source, together, scans, true[0], others)
    name = f"{source.name} {'+'.join(map(str, frames))}"
    return Trial(
        name=name + (f", {off[0]:g} deg {1000 * off[1]:g} mm" if any(off) else ""),
        compared=tuple(compare_surfaces(alone, together, plane)),
        pairs=together.registration.pairs,
        moved_m=float(together.registration.moved_m.max()),
        right_m2=(float(np.mean([one.right_m2 for one in apart])), joint.right_m2),
        wrong_m2=(float(np.mean([one.wrong_m2 for one in apart])), joint.wrong_m2),
        kept=_kept([one.right for one in apart], joint.known),
    )


def _kept(right: Sequence[FloatArray], known: FloatArray) -> float:
    """Share of places (n, 3) rightly inferred by one that all together know; NaN without any."""
    places = np.concatenate(right)
    near = cKDTree(known).query(places, distance_upper_bound=_NEAR_M)[0]
    return float(np.isfinite(near).mean()) if len(places) else float("nan")


def settled(source: Source) -> Sequence[RangeImage]:
    """Return the frames where they truly stand: of a real place, where all of them together agree."""
    if isinstance(source, Walk):
        return source.frames
    home = source.frames[0].world_from_sensor
    seen = [observe(one, home) for one in source.frames]
    found = correct_poses(seen, range(len(seen)), stated_m=source.registration_m)
    return [
        one.with_facts(world_from_sensor=found.moved_world(k, home) @ one.world_from_sensor)
        for k, one in enumerate(source.frames)
    ]


def _put_off(one: RangeImage, turn_deg: float, shift_m: float, rng: np.random.Generator) -> RangeImage:
    if not turn_deg and not shift_m:
        return one
    turn, shift = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
    rotation = Rotation.from_rotvec(np.radians(turn_deg) * turn).as_matrix()
    motion = Pose.from_parts(rotation, one.origin - rotation @ one.origin + shift_m * shift)
    return one.with_facts(world_from_sensor=motion @ one.world_from_sensor)


class _Score(NamedTuple):
    """What came true of a completion: areas, the places (n, 3) that did, and all (m, 3) that it knows."""

    right_m2: float
    wrong_m2: float
    right: FloatArray
    known: FloatArray


def _score(
    source: Source,
    model: CompletedModel,
    scans: Sequence[RangeImage],
    first: RangeImage,
    others: Sequence[RangeImage],
) -> _Score:
    """Hold a model against the truth or other scans; it stands where its first scan truly does."""
    seen = model.world_from_reference @ model.observations[0].scan.world_from_sensor
    home = first.world_from_sensor @ seen.inverse()
    found = sample(hypothesis_of(model, scans), CELL_M)
    found = replace(found, points=home.apply(found.points), normals=home.rotate(found.normals))
    world = home @ model.world_from_reference
    used = [
        one.scan.with_facts(world_from_sensor=world @ one.scan.world_from_sensor)
        for one in model.observations
    ]
    scored = score_by_others(used, others, found, tolerance_m=max(0.03, 2 * source.registration_m))
    state = scored.state
    if isinstance(source, Walk):
        there = is_there(found.points, found.normals, source.caster)
        state = np.where(state == 2, 2, np.where(there, 1, -1)).astype(np.int8)
    right, wrong = state == 1, state == -1
    measured = [one.points()[one.valid][::_THINNED] for one in used]
    return _Score(
        float(found.areas[right].sum()),
        float(found.areas[wrong].sum()),
        found.points[right],
        np.concatenate([*measured, found.points]),
    )


@dataclass(frozen=True, slots=True)
class _Truth:
    """The walls of a house, as frames of a walk would see them without noise."""

    source: Walk
    frames: Sequence[RangeImage]

    def normal(self, scan: int, pixels: IntArray) -> FloatArray | None:
        """The normal (3,), sensor frame, of the plane that flat pixels (n,) see; None if they see none."""
        frame = self.frames[scan]
        rays = frame.world_from_sensor.rotate(frame.projection.directions().reshape(-1, 3)[pixels])
        ranges = self.source.caster.first_hit(np.repeat(frame.origin[None], len(rays), axis=0), rays).ranges
        points = (rays * ranges[:, None])[np.isfinite(ranges)]
        if len(points) < 10:
            return None
        _, spread, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
        if spread[2] > _FLAT_M * np.sqrt(len(points)):
            return None
        return frame.world_from_sensor.inverse().rotate(axes[2])


OFF = ((0.0, 0.0), (0.2, 0.005), (0.5, 0.02), (1.0, 0.05))
"""By how much poses of walks are put off: degrees, metres."""

_WALKED = {WALKS[0].name: (0, 1, 2, 3, 4), WALKS[2].name: (15, 16, 17, 18)}
_COLUMNS = (
    "frames", "surfaces", "tilt alone deg", "together", "worse", "rms alone mm", "together", "worse",
    "inferred alone m2", "together", "right alone m2", "together", "kept", "wrong alone m2", "together",
    "poses apart mm", "left mm", "contradicted m2", "still",
)  # fmt: skip


@suite("together", smallest="--of open3d_redwood")
def together(
    of: list[str] | None = None, keep_poses: bool = False, registration_m: float = 0.005, seed: int = 0
) -> Iterator[str]:
    """Several scans completed at once against each of them alone, with poses right and wrong.

    A surface is worse where its tilt to the truth (of real frames: to the scan that knows it best) grew by
    more than half and .2 degrees, or the rms of the same pixels about it by more than half and 2 mm. Of real
    frames the last is left out and judges what was inferred. --of: real, walks, or a source's name.
    """
    yield from head(*_COLUMNS)
    for source in (*REAL, *WALKS):
        kind = "real" if source in REAL else "walks"
        if {kind, source.name} & set(of or ["real", "walks"]) and _frames(source):
            for number in range(len(OFF) if kind == "walks" else 1):
                for trial in each(_tried, source.name, number, keep_poses, registration_m, seed + number):
                    yield trial_row(trial)


def _tried(name: str, number: int, keep_poses: bool, registration_m: float, seed: int) -> Trial:
    """The trial of a source's frames with poses put off by the number-th amount."""
    options = CompletionOptions(texture=False, registration_m=registration_m, moves_scans=not keep_poses)
    source = next(source for source in (*REAL, *WALKS) if source.name == name)
    return run(source, _frames(source), options, OFF[number], seed)


def _frames(source: Source) -> tuple[int, ...]:
    """Those of a source that are completed."""
    return tuple(range(len(source.frames) - 1)) if source in REAL else _WALKED.get(source.name, ())


def trial_row(trial: Trial) -> str:
    """Write a trial as a row of a Markdown table."""
    held = trial.compared
    tilts = np.array([(one.tilt_alone_deg, one.tilt_deg) for one in held]).reshape(-1, 2)
    rms = np.array([(one.rms_alone_m, one.rms_m) for one in held]).reshape(-1, 2)
    inferred = {one.together: one.inferred_m2 for one in held}
    best: dict[int, float] = {}
    for one in held:
        best[one.together] = max(best.get(one.together, 0.0), one.inferred_alone_m2)
    pairs = trial.pairs
    cells = (
        trial.name,
        f"{len(inferred)}",
        *(f"{value:.2f}" for value in _medians(tilts)),
        f"{sum(is_more_tilted(one) for one in held)} of {len(held)}",
        *(f"{1000 * value:.1f}" for value in _medians(rms)),
        f"{sum(is_rougher(one) for one in held)} of {len(held)}",
        f"{sum(best.values()):.2f}",
        f"{sum(inferred.values()):.2f}",
        *(f"{value:.2f}" for value in (*trial.right_m2, trial.kept, *trial.wrong_m2)),
        f"{1000 * max((one.offset_m for one in pairs), default=0.0):.1f}",
        f"{1000 * max((one.left_m for one in pairs), default=0.0):.1f}",
        f"{sum(one.contradicted_m2 for one in pairs):.2f}",
        f"{sum(one.still_contradicted_m2 for one in pairs):.2f}",
    )
    return "| " + " | ".join(cells) + " |"


def _medians(pairs: FloatArray) -> tuple[float, float]:
    return (float(np.median(pairs[:, 0])), float(np.median(pairs[:, 1]))) if len(pairs) else (np.nan, np.nan)


def is_more_tilted(one: Compared) -> bool:
    """Whether a surface is tilted more together than alone, by more than half and .2 degrees."""
    return one.tilt_deg > 1.5 * one.tilt_alone_deg and one.tilt_deg > one.tilt_alone_deg + 0.2


def is_rougher(one: Compared) -> bool:
    """Whether the same pixels lie farther off a surface together than alone, by more than half and 2 mm."""
    return one.rms_m > 1.5 * one.rms_alone_m and one.rms_m > one.rms_alone_m + 0.002
