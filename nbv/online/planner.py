# SPDX-License-Identifier: MIT
"""The page to read first: plan views of an unknown scene, one scan at a time.

The planner never sees the scene. It scans, writes what it learned into voxels, lists what is unknown or
badly seen, scores every candidate view by how much of that it would see, and goes where the gain is
largest. References:

* N. A. Massios and R. B. Fisher, "A best next view selection algorithm incorporating a quality criterion",
BMVC 1998;
* F. J. Sanchiz and R. B. Fisher, "A next-best-view algorithm for 3D scene recovery with 5 degrees of
freedom",
  BMVC 1999.

Their idea is followed, not their weights and thresholds.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.typing import NDArray

from nbv.coverage.completed_surfaces import CompletedSurfaces
from nbv.online.expected_gain import ExpectedGain, SurfacePrior
from nbv.online.feasible_viewpoints import feasible_viewpoints
from nbv.online.gain import BestView, GainOptions, best_view, find_targets
from nbv.online.learning import learn, recall
from nbv.online.occupancy import VoxelMap
from nbv.online.region_of_interest import of_interest
from nbv.scanning.sensors.sensor import Sensor
from nbv.visibility.requirement import Requirement
from nbv.visibility.viewpoints import Candidates
from nbv.visibility.zones import EVERYWHERE, Zones
from scenes.checks import FloatArray, InputError
from scenes.pose import Pose
from scenes.run.journal import NO_JOURNAL, Journal
from scenes.scan.range_image import RangeImage

RENEWED = 1.04  # growth of the number of scans after which they are completed anew: each of the first 25
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannerOptions:
    """How the online planner explores.

    Parameters
    ----------
    voxel_m : float, optional
        Side of a voxel in metres; `VoxelGrid.around` chooses when not given.
    clearance_m : float
        Known free space that a sensor needs around it, metres.
    on_floor : bool
        Whether the sensor of a room stands on a tripod: what is below must be known to be empty down to seen
        floor.
    epsilon_m2 : float, optional
        Stop when the best candidate gains less than this, square metres; one voxel face when not given.
    max_views : int
        Stop after so many views.
    gain : GainOptions
        Weights of the gain.
    zones : Zones
        Only what lies in the region is worth seeing (anything, until known space reaches it), and no station
        lies in what is to be kept out of.

    Raises
    ------
    InputError
        A negative clearance or epsilon, no views.
    """

    voxel_m: float | None = None
    clearance_m: float = 0.3
    on_floor: bool = True
    epsilon_m2: float | None = None
    max_views: int = 200
    gain: GainOptions = field(default_factory=GainOptions)
    zones: Zones = EVERYWHERE

    def __post_init__(self) -> None:
        if self.clearance_m < 0 or (self.epsilon_m2 or 0.0) < 0:
            raise InputError(
                f"clearance and epsilon must not be negative, got {self.clearance_m}, {self.epsilon_m2}"
            )
        if self.max_views < 1:
            raise InputError(f"max_views must be at least 1, got {self.max_views}")


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """One view of the exploration: its pose, and the gain that was expected of it (None for the start)."""

    world_from_sensor: Pose
    expected_gain_m2: float | None


@dataclass(frozen=True, slots=True, eq=False)
class Exploration:
    """What the planner did: its steps, what it knows in the end, and why it stopped."""

    steps: tuple[Step, ...]
    voxels: VoxelMap
    stopped_because: str


def explore(
    scan: Callable[[Pose], RangeImage],
    volume: FloatArray,
    start: Pose | None,
    candidates: Candidates,
    sensor: Sensor,
    requirement: Requirement | None = None,
    options: PlannerOptions | None = None,
    *,
    given: Sequence[RangeImage] = (),
    from_outside: bool = False,
    infer: Callable[[Sequence[RangeImage]], CompletedSurfaces] | None = None,
    finished: Callable[[], str | None] | None = None,
    journal: Journal = NO_JOURNAL,
    n_threads: int | None = None,
    progress: Progress | None = None,
) -> Exploration:
    """Explore an unknown volume by next best views.

    Parameters
    ----------
    scan : callable
        Takes a scan from a pose: a simulated scanner, or a person with a tripod.
    volume : (2, 3) float
        Smallest and largest coordinates of the volume to explore, metres.
    start : Pose or None
        The first view; None to choose it like the others, by what the `given` scans say.
    candidates : Candidates
        Where the sensor may go; positions not yet known to be free, or without footing, are left out.
    sensor : Sensor
        What scans.
    requirement : Requirement, optional
        What counts as seen well; 60 deg incidence when not given.
    options : PlannerOptions, optional
        Voxels, clearance, stopping, weights.
    given : sequence of RangeImage
        Scans that were taken before, by this sensor or by others, in the same world.
    from_outside : bool
        Whether the sensor moves around the volume (an object) rather than within it (a room).
    infer : callable, optional
        Completes all scans so far. What it knows counts less than what is unknown: badly seen surface that is
        modelled well, and shadows in which nothing but inferred surface is expected.
    finished : callable, optional
        Asked after every scan; a text stops the exploration and is its reason. A simulated study puts its own
        stopping rule here; the planner itself decides by its voxels alone.
    journal : Journal
        Remembers the views that are chosen; those that it knows already are not chosen anew.
    n_threads : int, optional
        Threads; the result does not depend on it.
    progress : callable, optional
        Called with ("views", done, most).

    Raises
    ------
    InputError
        Neither a start nor scans that are given.
    """
    if start is None and not given:
        raise InputError("without a scan that is given, exploring needs a pose to start from")
    requirement, options = requirement or Requirement(), options or PlannerOptions()
    voxels = VoxelMap.unknown(volume, voxel_m=options.voxel_m, outside_is_empty=from_outside)
    voxels = recall(voxels, given, sensor, options.clearance_m)
    attempts = np.zeros((2, voxels.grid.n_voxels), np.int32)
    steps = [] if start is None else [Step(start, None)]
    scans, completed, n_known = list(given), None, 0
    best: BestView | None = None
    prior = SurfacePrior.none()
    while True:
        if steps:
            scans.append(scan(steps[-1].world_from_sensor))
            voxels = learn(voxels, scans[-1], sensor, options.clearance_m)
            if best is not None:
                prior = prior.after(scans[-1], best.sees, voxels.grid)
        if infer is not None and len(scans) >= RENEWED * n_known:
            completed, n_known = infer(scans), len(scans)
        if progress is not None:
            progress("views", len(steps), options.max_views)
        reason = finished() if finished is not None else None
        if reason is None and len(steps) >= options.max_views:
            reason = f"the limit of {options.max_views} views is reached"
        if reason is not None:
            return Exploration(tuple(steps), voxels, reason)
        here = steps[-1].world_from_sensor if steps else given[-1].world_from_sensor
        choose = partial(
            next_view,
            voxels,
            attempts,
            candidates,
            here,
            sensor,
            requirement,
            options,
            n_threads,
            completed,
            prior.trust,
        )
        chosen = journal.step(f"view-{len(steps) + 1:04d}", choose)
        if isinstance(chosen, str):
            return Exploration(tuple(steps), voxels, chosen)
        best = chosen
        _count_attempts(attempts, best)
        steps.append(Step(best.pose, best.gain_m2))


def next_view(
    voxels: VoxelMap,
    attempts: NDArray[np.int32],
    candidates: Candidates,
    here: Pose,
    sensor: Sensor,
    requirement: Requirement,
    options: PlannerOptions,
    n_threads: int | None,
    completed: CompletedSurfaces | None = None,
    trust: FloatArray | None = None,
) -> BestView | str:
    """Return the view with the largest gain, or why no further view pays."""
    faces = voxels.boundary()
    targets = find_targets(
        voxels,
        faces,
        required_cosine=requirement.min_cosine,
        attempts=attempts,
        options=options.gain,
        completed=completed,
    )
    of_concern = of_interest(voxels, options.zones)
    targets = targets.some(of_concern[targets.voxel])
    if not len(targets):
        return "requirement met: nothing is unknown or badly seen"
    free = feasible_viewpoints(
        candidates, voxels, here, options.clearance_m, on_floor=options.on_floor, zones=options.zones
    )
    wanted, n_most = _wanted_cosine(requirement, options.gain), options.gain.max_targets
    sought = of_concern & (attempts[1] < options.gain.max_attempts)
    expected = None if completed is None else ExpectedGain.of(voxels, faces, sought, completed, trust)
    best = best_view(
        voxels,
        faces,
        targets=targets,
        candidates=free,
        sensor=sensor,
        required_cosine=wanted,
        expected=expected,
        n_most=n_most,
        n_threads=n_threads,
    )
    if best is None:
        return "no candidate in known free space sees what is left to see"
    if best.gain_m2 < (epsilon := _epsilon_m2(options, voxels)):
        return f"marginal gain {best.gain_m2:.3g} m2 is below {epsilon:.3g} m2"
    return best


def _wanted_cosine(requirement: Requirement, gain: GainOptions) -> float:
    """Cosine at which a predicted view counts: the required one, with the margin."""
    angle = np.arccos(requirement.min_cosine) - np.radians(gain.angle_margin_deg)
    return float(np.cos(max(angle, 0.0)))


def _epsilon_m2(options: PlannerOptions, voxels: VoxelMap) -> float:
    """Gain below which no further view pays."""
    return options.epsilon_m2 if options.epsilon_m2 is not None else voxels.grid.voxel_m**2


def _count_attempts(attempts: NDArray[np.int32], best: BestView) -> None:
    """Remember what the chosen view should settle, so that it is not sought for ever."""
    np.add.at(attempts, (best.sees.is_unknown.astype(np.int64), best.sees.voxel), 1)
