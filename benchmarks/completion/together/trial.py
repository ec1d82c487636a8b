# SPDX-License-Identifier: MIT
"""Trial: scans of one place alone and together, with poses as they are or off by a known amount."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from benchmarks.completion.ledger.entries import CELL_M, is_there
from benchmarks.completion.ledger.sources import Source, Walk
from benchmarks.completion.scenes.cases import hypothesis_of
from benchmarks.completion.scores.other_scans import score_by_others
from benchmarks.completion.together.surfaces import Compared, compare_surfaces
from benchmarks.completion.truth.samples import sample
from completion import CompletionOptions, complete
from completion.observe.observation import observe
from completion.registration.correction import ScanPair
from completion.registration.pipeline import correct_poses
from completion.result.completed_model import CompletedModel
from scenes.checks import FloatArray, IntArray
from scenes.pose import Pose
from scenes.scan.range_image import RangeImage

_NEAR_M = 0.06  # from a place to what is known of the same
_THINNED = 3  # measured points of which one is looked at
_FLAT_M = 0.003  # root mean square of what is a plane in truth


@dataclass(frozen=True, slots=True)
class Trial:
    """What came of some scans alone and together.

    Attributes
    ----------
    name : str
        Of the scans, and how far their poses were put off.
    compared : tuple of Compared
        Surface by surface.
    pairs : tuple of ScanPair
        What the scans say of each other's poses.
    moved_m : float
        How far one was moved at most, metres.
    right_m2, wrong_m2 : tuple of float
        Inferred area that is there or not, by the truth or by frames that were left out: the mean of the
        scans alone, and together; square metres. Only what is hidden and 10 cm from all that was measured.
    kept : float
        Share of what scans alone inferred rightly that all together measured or inferred, too.
    """

    name: str
    compared: tuple[Compared, ...]
    pairs: tuple[ScanPair, ...]
    moved_m: float
    right_m2: tuple[float, float]
    wrong_m2: tuple[float, float]
    kept: float


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
        one.restated(world_from_sensor=found.moved_world(k, home) @ one.world_from_sensor)
        for k, one in enumerate(source.frames)
    ]


def _put_off(one: RangeImage, turn_deg: float, shift_m: float, rng: np.random.Generator) -> RangeImage:
    if not turn_deg and not shift_m:
        return one
    turn, shift = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
    rotation = Rotation.from_rotvec(np.radians(turn_deg) * turn).as_matrix()
    motion = Pose.from_parts(rotation, one.origin - rotation @ one.origin + shift_m * shift)
    return one.restated(world_from_sensor=motion @ one.world_from_sensor)


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
        one.scan.restated(world_from_sensor=world @ one.scan.world_from_sensor) for one in model.observations
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
