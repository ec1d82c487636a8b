# SPDX-License-Identifier: MIT
"""Placement of scans that come without poses on a design, on one page.

Scans are registered among themselves; each group is then placed as a whole. Beams judge: a place is accepted
only where they prefer it clearly to every other one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from completion.asbuilt.design_rays import BeamVotes, DesignRays
from completion.asbuilt.group_rays import GroupRays
from completion.asbuilt.pose_votes import vote
from completion.registration.motions import angle_between
from completion.registration.pipeline import register_scans
from scenes.checks import FloatArray, InputError, check_directions
from scenes.mesh.design import ElementMesh
from scenes.pose import Pose
from scenes.run.steps import Progress
from scenes.scan.range_image import RangeImage

_N_SCREENED, _N_REFINED, _FEW = 400, 30, 4
_OTHER = (0.3, np.radians(3.0)), (0.1, np.radians(1.0))
"""Metres and radians from which on poses are different: before their last refinement, and after it."""
_LEAST_ON, _LEAST_ABOVE, _MOST_BEHIND = 0.4, 0.9, 0.05
"""Of a right pose: least share of beams that end on the design, and of those that go up, near it; largest
share of those behind it among both. Measured on sets of rooms that the benchmark `placement` does not report:
right poses 0.90, 0.99 and 0.001, other storeys at best 0.82, 0.94 and 0.005."""
_CLEARLY = 6.0
"""Log odds by which beams must prefer a pose to any other. Measured there: 3.9 at most for a wrong one."""
_CELL_M, _A_CELL, _ALIKE = 1.0, 1.0, 10.0
"""Side of cells, metres; log odds of one at most; beams that count as one."""
_UPWARD = 0.17
"""Sine of the angle with the horizontal from which on beams go over furniture: 10 deg."""
_LEAST_STIFFNESS = 0.005
"""Of 1/3, of a pose that does not slide."""
_N_TOLD = 4


@dataclass(frozen=True, slots=True, eq=False)
class Alternative:
    """A place where scans of one group may have stood.

    Attributes
    ----------
    scans : tuple of int
        Their numbers, from 0.
    poses : tuple of Pose
        `world_from_sensor` of each in the design's frame.
    agreeing, through : float
        Shares of beams that end within 3 cm of the design, and that end behind its first surface.
    near_above : float
        Of beams that go up by 10 degrees and more, over most of what is not in a design, the share that ends
        within 6 cm of it.
    behind : float
        Log odds by which beams prefer the best place to this one; 0 of the best itself.
    stiffness : float
        How well the design holds the scans there: 1/3 where surfaces face all ways alike, 0 where they slide.
    """

    scans: tuple[int, ...]
    poses: tuple[Pose, ...]
    agreeing: float
    through: float
    near_above: float
    behind: float
    stiffness: float


@dataclass(frozen=True, slots=True, eq=False)
class Placement:
    """Where scans stood in a design.

    Attributes
    ----------
    is_placed : bool
        Whether all were placed.
    poses : tuple of Pose or None
        `world_from_sensor` of each scan in the design's frame; None of scans that were not placed.
    agreeing, through : float
        Shares of beams that end within 3 cm of the design, and that end behind its first surface, at the
        best places.
    alternatives : tuple of Alternative
        Of groups that were not placed: their best place, and the others that beams do not exclude.
    sentences : tuple of str
        What was found, a sentence for each group.
    """

    is_placed: bool
    poses: tuple[Pose | None, ...]
    agreeing: float
    through: float
    alternatives: tuple[Alternative, ...]
    sentences: tuple[str, ...]


def place_on_design(
    design: ElementMesh,
    scans: Sequence[RangeImage],
    *,
    together: bool = False,
    up: FloatArray | None = None,
    n_threads: int | None = None,
    progress: Progress | None = None,
) -> Placement:
    """Find where scans stood in a design, or say why that cannot be told.

    Parameters
    ----------
    design : ElementMesh
        Its z is up.
    scans : sequence of RangeImage
        Of their own poses only what is up is used, to some degrees.
    together : bool
        Whether the scans are registered among themselves: they keep their poses to each other.
    up : (3,) or (n, 3) float, optional
        What is up in the worlds of the scans, of all or of each; z when not given.
    n_threads : int, optional
        Threads; results do not depend on it.
    progress : callable, optional
        Called with a stage's name, steps done and steps in all.

    Raises
    ------
    InputError
        No scans, scans without flat surface, an up that is no direction, a design without surface, or scans
        that fit nowhere in it.
    """
    if not scans:
        raise InputError("no scans to place on the design; give at least one")
    if not len(design.mesh.faces):
        raise InputError(f"{design.name} has no surface to place scans on")
    upward = check_directions("up", (0.0, 0.0, 1.0) if up is None else up, len(scans))

    # 1. Group: scans whose poses to each other are known.
    groups = _groups(scans, together, n_threads, progress)

    # 2. Find the places of each group in the design, which here lies about its own middle.
    middle = design.mesh.bounds().mean(axis=0)
    rays = DesignRays(design, middle, n_threads)
    found = []
    for number, group in enumerate(groups):
        if progress:
            progress("places", number, len(groups))
        measured = GroupRays.of([scans[scan] for scan in group], list(group.values()), upward[list(group)])
        found.append(_find_places(rays, measured, group, middle))
    if progress:
        progress("places", len(groups), len(groups))

    # 3. Judge: whether beams prefer one place, and the design holds the scans there.
    names = [[scans[scan].name for scan in group] for group in groups]
    verdicts = [_judge(*each, design.name) for each in zip(found, names, strict=True)]
    if not any(verdict.places for verdict in verdicts):
        raise InputError(" ".join(verdict.sentence for verdict in verdicts[:_N_TOLD]))
    return _joined(verdicts, [places[0] for places in found if places], len(scans))


def _groups(
    scans: Sequence[RangeImage], together: bool, n_threads: int | None, progress: Progress | None
) -> list[dict[int, Pose]]:
    """By the number of each scan its pose in the frame of its group."""
    if together or len(scans) == 1:
        frame = scans[0].world_from_sensor.inverse()
        return [{number: frame @ scan.world_from_sensor for number, scan in enumerate(scans)}]
    registered = register_scans(scans, n_threads=n_threads, progress=progress)
    return [
        {number: Pose(np.vstack([motion, [0, 0, 0, 1]])) for number, motion in network.group.poses.items()}
        for network in registered.networks
    ]


class _Placed(NamedTuple):
    """A pose (3, 4) of a group, what beams say of it, and how stiff the design holds it."""

    pose: FloatArray
    votes: BeamVotes
    stiffness: float

    @property
    def density(self) -> float:
        """What beams say, in one number."""
        return float(self.votes.log_density.mean())


def _find_places(
    design: DesignRays, rays: GroupRays, group: Mapping[int, Pose], middle: FloatArray
) -> list[Alternative]:
    """Places of a group in a design, best first."""
    few = rays.thin(_FEW)
    screened = [design.refine(few, pose, coarse=True)[0] for pose in vote(design, rays)[:_N_SCREENED]]
    screened.sort(key=lambda pose: -float(design.votes(few, pose).log_density.mean()))
    refined = [design.refine(rays, pose) for pose in _distinct(screened, rays, *_OTHER[0])[:_N_REFINED]]
    judged = [_Placed(pose, design.votes(rays, pose), stiffness) for pose, stiffness in refined]
    judged.sort(key=lambda each: -each.density)
    by_pose = {id(each.pose): each for each in judged}
    kept = [by_pose[id(pose)] for pose in _distinct([each.pose for each in judged], rays, *_OTHER[1])]
    return [_told(each, kept[0], rays, group, middle) for each in kept]


def _distinct(
    poses: Sequence[FloatArray], rays: GroupRays, least_m: float, least_turn: float
) -> list[FloatArray]:
    """The first of poses (3, 4), and those that differ from all before them."""
    eye, kept = np.append(rays.eye.mean(axis=0), 1.0), list[FloatArray]()
    for pose in poses:
        if kept:
            others = np.array(kept)
            near = np.linalg.norm((others - pose) @ eye, axis=1) < least_m
            if (near & (angle_between(pose, others) < least_turn)).any():
                continue
        kept.append(pose)
    return kept


def _told(
    placed: _Placed, best: _Placed, rays: GroupRays, group: Mapping[int, Pose], middle: FloatArray
) -> Alternative:
    """A place of a group as an alternative to the best one."""
    design_from_group = Pose.from_parts(placed.pose[:, :3] @ rays.turn, placed.pose[:, 3] + middle)
    return Alternative(
        scans=tuple(group),
        poses=tuple(design_from_group @ pose for pose in group.values()),
        agreeing=float(placed.votes.agrees.mean()),
        through=float(placed.votes.passes.mean()),
        near_above=float(placed.votes.is_near[rays.direction @ placed.pose[2, :3] > _UPWARD].mean()),
        behind=_behind(placed.votes, best.votes, rays),
        stiffness=placed.stiffness,
    )


def _behind(votes: BeamVotes, best: BeamVotes, rays: GroupRays) -> float:
    """Log odds by which beams prefer the best pose to another one.

    Beams that differ at one place have one cause, a door or a wall that was built otherwise: what those that
    end in one cell say, or would by either pose, counts `_A_CELL` at most.
    """
    nearest = np.minimum(np.minimum(best.end_m, votes.end_m), rays.range_m)
    cell = np.floor((rays.origin + nearest[:, None] * rays.direction) / _CELL_M).astype(np.int64)
    number = np.unique(cell, axis=0, return_inverse=True)[1].ravel()
    each = np.bincount(number, best.log_density - votes.log_density) / _ALIKE
    return float(np.clip(each, -_A_CELL, _A_CELL).sum())


class _Verdict(NamedTuple):
    """The places of a group that are left, best first: one where it is placed; and what to tell."""

    places: list[Alternative]
    is_placed: bool
    sentence: str


def _judge(places: Sequence[Alternative], names: Sequence[str], design: str) -> _Verdict:
    """Return which places of a group are left."""
    who = f"{', '.join(names[:_N_TOLD])}{' ...' if names[_N_TOLD:] else ''}"
    if not places:
        return _Verdict([], False, f"{who}: no surface to place on {design}")
    best = places[0]
    left = [place for place in places if place.behind < _CLEARLY]
    shares = f"{100 * best.agreeing:.0f} % of beams end on it, {100 * best.through:.1f} % behind it"
    is_of_here = best.agreeing >= _LEAST_ON and best.near_above >= _LEAST_ABOVE
    if not is_of_here or best.through > _MOST_BEHIND * (best.agreeing + best.through):
        sentence = (
            f"{who}: fits nowhere in {design}; at the best place {shares}, and {100 * best.near_above:.0f} % "
            "of those that go up end near it; is it of this building and storey, and is its z up (--up)?"
        )
        return _Verdict([], False, sentence)
    if len(left) > 1:
        where = "; ".join(_where(place) for place in left[:_N_TOLD]) + ("; ..." if left[_N_TOLD:] else "")
        sentence = (
            f"{who}: the design looks the same from {len(left)} places ({where}); name one with --poses"
        )
        return _Verdict(left, False, sentence)
    if best.stiffness < _LEAST_STIFFNESS:
        sentence = f"{who}: surfaces of the design that were measured leave it free to slide; add scans"
        return _Verdict(left, False, sentence)
    lead = f", log odds {places[1].behind:.0f} to any other place" if len(places) > 1 else ""
    return _Verdict(left, True, f"{who}: placed on {design}, {shares}{lead}")


def _where(place: Alternative) -> str:
    """Where the first scan of a group stands, in words."""
    x, y, z = place.poses[0].translation + 0.0
    return f"{x:.2f} {y:.2f} {z:.2f} m"


def _joined(verdicts: Sequence[_Verdict], best: Sequence[Alternative], n_scans: int) -> Placement:
    """All groups together."""
    poses: list[Pose | None] = [None] * n_scans
    for verdict in verdicts:
        if verdict.is_placed:
            for scan, pose in zip(verdict.places[0].scans, verdict.places[0].poses, strict=True):
                poses[scan] = pose
    weights = [len(each.scans) for each in best]
    return Placement(
        is_placed=all(pose is not None for pose in poses),
        poses=tuple(poses),
        agreeing=float(np.average([each.agreeing for each in best], weights=weights)),
        through=float(np.average([each.through for each in best], weights=weights)),
        alternatives=tuple(
            place for verdict in verdicts if not verdict.is_placed for place in verdict.places
        ),
        sentences=tuple(verdict.sentence for verdict in verdicts),
    )
