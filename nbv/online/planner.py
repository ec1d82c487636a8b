# SPDX-License-Identifier: MIT
"""The page to read first: plan views of an unknown scene, one scan at a time.

The planner never sees the scene. It scans, writes what it learned into voxels, lists what is unknown or
badly seen, scores every candidate view by how much of that it would see, and goes where the gain is
largest. References:

* N. A. Massios and R. B. Fisher, "A best next view selection algorithm incorporating a quality criterion",
  BMVC 1998;
* F. J. Sanchiz and R. B. Fisher, "A next-best-view algorithm for 3D scene recovery with 5 degrees of
  freedom", BMVC 1999.

Their idea is followed, not their weights and thresholds.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from nbv.coverage.surface_classes import KnownSurfaces
from nbv.online.expected_gain import ExpectedGain, SurfacePrior, UnknownSpace
from nbv.online.exploration import Exploration, Step
from nbv.online.feasible_viewpoints import feasible_viewpoints, has_floor_support
from nbv.online.gain import BestView, best_view
from nbv.online.limits import RENEWED
from nbv.online.literature import CRITERIA, choose_views
from nbv.online.occupancy import VoxelMap
from nbv.online.possible_solid import PossibleSurface
from nbv.online.targets import GainOptions, find_targets, voxels_of_interest
from nbv.scanning.sensor import Sensor
from nbv.visibility.requirement import Requirement
from nbv.visibility.viewpoints import Candidates, at_chosen_heights
from nbv.visibility.visibility import Progress
from nbv.visibility.zones import EVERYWHERE, Zones
from scenes.checks import FloatArray, InputError, Value
from scenes.pose import Pose
from scenes.run.journal import NO_JOURNAL, Journal
from scenes.scan.range_image import RangeImage

_NOTHING_IN_SIGHT = "no candidate in known free space sees what is left to see"


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannerOptions(Value):
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
    criterion : str
        What a view is chosen by: "gain", or one of the literature (`nbv.online.literature.CRITERIA`).

    Raises
    ------
    InputError
        A negative clearance or epsilon, no views, another criterion.
    """

    voxel_m: float | None = None
    clearance_m: float = 0.3
    on_floor: bool = True
    epsilon_m2: float | None = None
    max_views: int = 200
    gain: GainOptions = field(default_factory=GainOptions)
    zones: Zones = EVERYWHERE
    criterion: str = "gain"

    def __post_init__(self) -> None:
        if self.criterion not in ("gain", *CRITERIA):
            raise InputError(f"criterion must be one of gain, {', '.join(CRITERIA)}, got {self.criterion!r}")
        if self.clearance_m < 0 or (self.epsilon_m2 or 0.0) < 0:
            raise InputError(
                f"clearance and epsilon must not be negative, got {self.clearance_m}, {self.epsilon_m2}"
            )
        if self.max_views < 1:
            raise InputError(f"max_views must be at least 1, got {self.max_views}")


@dataclass(frozen=True, slots=True, eq=False)
class PlannerState:
    """What the planner knows before it decides.

    `attempts` (2, n_voxels) count the chosen views that should have settled a voxel's badly seen surface (0)
    and unknown faces (1). With completion, `completed` is that of the scans, and `prior` is learned from scan
    to scan: how likely a ray into unknown space is to meet surface.
    """

    voxels: VoxelMap
    attempts: NDArray[np.int32]
    completed: KnownSurfaces | None = None
    prior: SurfacePrior | None = None

    @classmethod
    def of(
        cls, voxels: VoxelMap, completed: KnownSurfaces | None = None, *, learns: bool = False
    ) -> PlannerState:
        """Return the state before any view was chosen; `learns` tells whether it has a prior."""
        attempts = np.zeros((2, voxels.grid.n_voxels), np.int32)
        return cls(voxels, attempts, completed, SurfacePrior.none() if learns else None)

    def after_scan(self, scan: RangeImage, sensor: Sensor, clearance_m: float) -> PlannerState:
        """Return the state after a scan."""
        prior = self.prior and self.prior.after(scan, UnknownSpace.of(self.voxels, self.completed))
        return replace(self, voxels=self.voxels.with_scan(scan, sensor, clearance_m), prior=prior)

    def after_choice(self, chosen: BestView, times: int = 1) -> PlannerState:
        """Return the state in which `chosen` has tried `times` more to settle what it sees."""
        attempts = self.attempts.copy()
        attempts[chosen.sees.is_unknown.astype(np.int64), chosen.sees.voxel] += times  # once a voxel
        return replace(self, attempts=attempts)


@dataclass(frozen=True, slots=True, eq=False)
class Decision:
    """The next view, or the reason why no further view pays: exactly one of the two.

    `then` are the views that follow it without a further decision; None to decide anew after its scan.
    """

    view: BestView | None = None
    reason: str | None = None
    then: tuple[BestView, ...] | None = None


@dataclass(slots=True, kw_only=True, eq=False)
class Explorer(Value):
    """An exploration, one view at a time: `for step in explorer`; its fields are explained at `explore`.

    What has been explored so far is `explorer.exploration`, also after a loop that was left early.
    """

    scan: Callable[[Pose], RangeImage]
    volume: FloatArray
    start: Pose | None
    candidates: Candidates
    sensor: Sensor
    requirement: Requirement = field(default_factory=Requirement)
    options: PlannerOptions = field(default_factory=PlannerOptions)
    given: Sequence[RangeImage] = ()
    from_outside: bool = False
    spot_of: Callable[[FloatArray], FloatArray] | None = None
    further_starts: Sequence[Pose] = ()
    infer: Callable[[Sequence[RangeImage]], KnownSurfaces] | None = None
    finished: Callable[[], str | None] | None = None
    journal: Journal = NO_JOURNAL
    n_threads: int | None = None
    progress: Progress | None = None
    exploration: Exploration = field(init=False)

    def __post_init__(self) -> None:
        if self.start is None and not self.given:
            raise InputError("without a scan that is given, exploring needs a pose to start from")
        voxels = VoxelMap.unknown(
            self.volume, voxel_m=self.options.voxel_m, outside_is_empty=self.from_outside
        )
        self.exploration = Exploration(
            steps=(),
            voxels=voxels.with_given(self.given, self.sensor, self.options.clearance_m),
            stopped_because="it has not begun",
            sensor=self.sensor,
            requirement=self.requirement,
            from_outside=self.from_outside,
            given=tuple(self.given),
        )

    def __iter__(self) -> Iterator[Step]:
        """Yield each view after its scan was taken and learned from. Raises InputError: a second time."""
        if self.exploration.steps:
            raise InputError("an Explorer can run only once; make another one from these scans")
        options = self.options
        state = PlannerState.of(self.exploration.voxels, learns=self.infer is not None)
        scans, n_completed, begun_at = list(self.given), 0, list(self.further_starts)
        spots = None if self.spot_of is None else self.spot_of(self.candidates.positions)
        poses, expected = ([], None) if self.start is None else ([self.start], None)
        following: tuple[BestView, ...] | None = None
        while True:
            # Scan from the last view, and learn from the scan.
            if poses:
                scans.append(self.scan(poses[-1]))
                state = state.after_scan(scans[-1], self.sensor, options.clearance_m)
                step = Step.of(poses[-1], expected, scans[-1], state.voxels, self.requirement.min_cosine)
                self._learned(state, "the loop was left", step)
                yield step

            # Complete the scans anew where there are enough new ones.
            if self.infer is not None and len(scans) >= RENEWED * n_completed:
                state, n_completed = replace(state, completed=self.infer(scans)), len(scans)

            # Stop where the caller has enough, or the views are spent.
            if self.progress is not None:
                self.progress("views", len(poses), options.max_views)
            reason = self.finished() if self.finished is not None else None
            if reason is None and len(poses) >= options.max_views:
                reason = f"the limit of {options.max_views} views is reached"
            if reason is not None:
                return self._learned(state, reason)

            # Leave out other heights over spots that have a station.
            left = self.candidates
            if self.spot_of is not None and spots is not None and poses:
                taken = np.array([pose.translation for pose in poses])
                left = at_chosen_heights(self.candidates, spots, taken, self.spot_of(taken))

            # Choose the next view; stop where none pays.
            decide = partial(
                next_view, state, left, poses[-1] if poses else self.given[-1].world_from_sensor,
                sensor=self.sensor, requirement=self.requirement, options=options, n_threads=self.n_threads,
            )  # fmt: skip
            if following is None:
                decision = self.journal.step(f"view-{len(poses) + 1:04d}", decide)
            else:
                decision = _next_of(following)
            chosen, following = decision.view, decision.then
            if chosen is None:
                begun_at = _unknown_starts(begun_at, state.voxels, options)
                if not begun_at:
                    return self._learned(state, decision.reason or "")
                poses.append(begun_at.pop(0))
                expected = None
                continue
            state = state.after_choice(chosen)
            poses.append(chosen.pose)
            expected = chosen.gain_m2

    def _learned(self, state: PlannerState, reason: str, *steps: Step) -> None:
        """Keep what is known now."""
        all_steps = (*self.exploration.steps, *steps)
        self.exploration = replace(
            self.exploration, steps=all_steps, voxels=state.voxels, stopped_because=reason
        )


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
    spot_of: Callable[[FloatArray], FloatArray] | None = None,
    further_starts: Sequence[Pose] = (),
    infer: Callable[[Sequence[RangeImage]], KnownSurfaces] | None = None,
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
        Where the sensor may go; positions not yet known to be free, or without floor below, are left out.
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
    spot_of : callable, optional
        Gives positions (p, 3) keys (p, 3) that are alike over one spot of the floor. Only one height over
        each is then chosen.
    further_starts : sequence of Pose
        Where to begin anew where nothing pays: one on each storey, say, for from below no scan shows the
        floor upstairs. Those at which the scans show that one can stand are left out.
    infer : callable, optional
        Completes all scans so far. Badly seen surface that it models well, and shadows in which nothing but
        inferred surface is expected, then count less than what is unknown.
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

    See Also
    --------
    Explorer : the same, one view at a time.
    """
    explorer = Explorer(
        scan=scan,
        volume=volume,
        start=start,
        candidates=candidates,
        sensor=sensor,
        requirement=requirement or Requirement(),
        options=options or PlannerOptions(),
        given=given,
        from_outside=from_outside,
        spot_of=spot_of,
        further_starts=further_starts,
        infer=infer,
        finished=finished,
        journal=journal,
        n_threads=n_threads,
        progress=progress,
    )
    for _ in explorer:
        pass
    return explorer.exploration


def _next_of(following: tuple[BestView, ...]) -> Decision:
    """Return the next of the views that were planned at once."""
    if not following:
        return Decision(reason="all views that were planned at once are taken")
    return Decision(view=following[0], then=following[1:])


def _unknown_starts(starts: list[Pose], voxels: VoxelMap, options: PlannerOptions) -> list[Pose]:
    """Return the starts at which no scan shows yet that one can stand."""
    places = np.array([start.translation for start in starts]).reshape(-1, 3)
    known = voxels.is_free(places, options.clearance_m) & has_floor_support(voxels, places)
    return [start for start, is_known in zip(starts, known, strict=True) if not is_known]


def next_view(
    state: PlannerState,
    candidates: Candidates,
    here: Pose,
    *,
    sensor: Sensor,
    requirement: Requirement,
    options: PlannerOptions,
    n_threads: int | None = None,
) -> Decision:
    """Return the candidate view with the largest gain, or why none pays.

    The sensor, which scans next, stands `here` now; of the requirement its incidence counts. The result does
    not depend on the number of threads.
    """
    # What is worth seeing: of the surface of what is possible, the unknown and the badly seen, in the region.
    voxels, gain = state.voxels, options.gain
    surface, wanted = PossibleSurface.of(voxels), voxels_of_interest(voxels, options.zones)
    targets = find_targets(
        voxels, surface, required_cosine=requirement.min_cosine, attempts=state.attempts, options=gain,
        completed=state.completed,
    )  # fmt: skip
    targets = targets.some(wanted[targets.voxel])
    if not len(targets):
        return Decision(reason="requirement met: nothing is unknown or badly seen")

    # Where the sensor can stand.
    free = feasible_viewpoints(
        candidates, voxels, here, options.clearance_m, on_floor=options.on_floor, zones=options.zones
    )
    if not free.n_poses:
        return Decision(reason=_NOTHING_IN_SIGHT)

    # What a criterion of the literature would take.
    if options.criterion != "gain":
        views = choose_views(
            options.criterion, voxels, free, here, sensor=sensor,
            counts=wanted & (state.attempts < gain.max_attempts), least_m2=_epsilon_m2(options, voxels),
            n_threads=n_threads,
        )  # fmt: skip
        if not views:
            return Decision(reason=_NOTHING_IN_SIGHT)
        return Decision(view=views[0], then=views[1:] if options.criterion == "set-cover" else None)

    # What views into unknown space are expected to bring, where completion says what lies around it.
    expected = None
    if state.completed is not None:
        space = UnknownSpace.of(voxels, state.completed)
        expected = ExpectedGain(space, state.prior or SurfacePrior.none(), wanted)

    # The best of all candidates, if it is worth a scan.
    best = best_view(
        surface.ray_caster(), targets, free, sensor=sensor, required_cosine=wanted_cosine(requirement, gain),
        expected=None if expected is None else expected.chance_behind, gain=gain, n_threads=n_threads,
    )  # fmt: skip
    if best is None:
        return Decision(reason=_NOTHING_IN_SIGHT)
    if best.gain_m2 < (epsilon := _epsilon_m2(options, voxels)):
        return Decision(reason=f"marginal gain {best.gain_m2:.3g} m2 is below {epsilon:.3g} m2")
    return Decision(view=best)


def wanted_cosine(requirement: Requirement, gain: GainOptions) -> float:
    """Cosine at which a predicted view counts: the required one, with the margin."""
    angle = np.arccos(requirement.min_cosine) - np.radians(gain.angle_margin_deg)
    return float(np.cos(max(angle, 0.0)))


def _epsilon_m2(options: PlannerOptions, voxels: VoxelMap) -> float:
    """Gain below which no further view pays."""
    return options.epsilon_m2 if options.epsilon_m2 is not None else voxels.grid.voxel_m**2
