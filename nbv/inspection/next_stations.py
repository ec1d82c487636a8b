# SPDX-License-Identifier: MIT
"""Next stations of a check: where to scan what is undecided, hidden or not seen, and what to move."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, hstack

from completion.asbuilt.findings import DesignCheck, ElementFinding
from nbv.cover.instance import CoverInstance
from nbv.inspection.blockers import Move, find_blockers, named
from nbv.inspection.obstacles import Obstacles
from nbv.inspection.targets import PROMISED_BEAMS, SURE_COSINE, SURE_M, Left, Targets
from nbv.plan.plan import Plan, Resumption
from nbv.run.wording import count
from nbv.scanning.sensor import Sensor, View
from nbv.visibility.candidates import Standing, find_standing
from nbv.visibility.clearance import Clearance
from nbv.visibility.requirement import Precision, Requirement, SightLimits
from nbv.visibility.site_options import SiteOptions
from nbv.visibility.visibility import orient, visible_from_positions
from scenes.checks import FloatArray, InputError, Value
from scenes.mesh.labelled_mesh import LabelledMesh
from scenes.mesh.orientation import decide_mode
from scenes.world.scene import Scene

CHECKED = Requirement(max_incidence_deg=80.0)
"""What the check itself takes: beams that meet a face at a cosine of 0.17 or more."""


@dataclass(frozen=True, slots=True, eq=False)
class Promise(Value):
    """What a station should settle: its number, from 1, the elements, and how much of targets it sees.

    `hoped` are elements that it settles only if nothing stands in space that no scan saw.
    """

    station: int
    elements: tuple[ElementFinding, ...]
    area_m2: float
    hoped: tuple[ElementFinding, ...] = ()

    def sentence(self) -> str:
        """Say what the station is for."""
        n, more = count(len(self.elements), "element"), count(len(self.hoped), "element")
        sure = f" should settle {n} ({self.area_m2:.1f} m2 seen): {named(self.elements)}"
        hope = f" may settle {more} behind space that no scan saw: {named(self.hoped)}"
        told = " and".join(text for text, held in ((sure, self.elements), (hope, self.hoped)) if held)
        return f"Station {self.station}{told}."


@dataclass(frozen=True, slots=True, eq=False)
class NextStations(Value):
    """Where to scan next after a check.

    Attributes
    ----------
    plan : Plan
        The stations; the predicted gain of each is the area that it sees of what is open.
    promised : tuple of Promise
        What each station should settle.
    moves : tuple of Move
        Extras to move, since they hide elements from every standing place; largest area first.
    left : tuple of Left
        Elements that neither settles.
    """

    plan: Plan
    promised: tuple[Promise, ...]
    moves: tuple[Move, ...]
    left: tuple[Left, ...]

    def sentences(self) -> tuple[str, ...]:
        """Return what to do and what stays open, a sentence each."""
        by_reason = dict[str, list[ElementFinding]]()
        for entry in self.left:
            by_reason.setdefault(entry.reason, []).append(entry.element)
        stays = (f"Left open, since {reason}: {named(held)}." for reason, held in by_reason.items())
        return (*(one.sentence() for one in self.promised), *(one.sentence() for one in self.moves), *stays)

    def to_json(self) -> dict[str, Any]:
        """Return the entry of `check.json`; elements by their surface ids, boxes in metres."""
        return {
            "stations": [
                {"station": one.station, "settles": _ids(one.elements), "may_settle": _ids(one.hoped),
                 "area_m2": one.area_m2}
                for one in self.promised
            ],
            "move": [
                {"what": move.extra.name, "box_m": move.extra.box_m.tolist(), "shows": _ids(move.elements),
                 "area_m2": move.area_m2}
                for move in self.moves
            ],
            "left": [{"element": entry.element.surface, "reason": entry.reason} for entry in self.left],
            "stopped_because": self.plan.stopped_because,
        }  # fmt: skip


def _ids(elements: tuple[ElementFinding, ...]) -> list[int]:
    return [element.surface for element in elements]


def plan_next_stations(
    check: DesignCheck,
    sensor: Sensor,
    requirement: Requirement = CHECKED,
    *,
    n_stations: int = 1,
    site: SiteOptions = SiteOptions(),
    n_threads: int | None = None,
) -> NextStations:
    """Plan where to scan next so that elements are settled that a check left open.

    Targets are samples of main faces of elements that are undecided, hidden or not seen; the design, without
    what is missing, and the extras are in the way. A station's gain is the number of elements of which it
    measures enough of a main face for a test, then the area that it sees; greedy choice takes one after
    another until none settles anything. What no standing place sees enough of is either hidden by an extra,
    which is to be moved, or left with the reason.

    Parameters
    ----------
    check : DesignCheck
        What was found.
    sensor : Sensor
        What scans next.
    requirement : Requirement
        What counts as seen.
    n_stations : int
        How many stations to propose at most.
    site : SiteOptions
        Where stations may stand.
    n_threads : int, optional
        Threads that cast; the result does not depend on it.

    Raises
    ------
    InputError
        Fewer than one station, nowhere to stand.
    """
    if n_stations < 1:
        raise InputError(f"n_stations must be at least 1, got {n_stations}")
    limits, obstacles = requirement.limits(sensor), Obstacles.of(check, n_threads)
    targets = Targets.of(check, obstacles, limits)
    if not targets.elements:
        plan = _plan(check, sensor, requirement, None, reason="there is nothing that a scan would settle")
        return NextStations(plan, (), (), targets.left)
    standing = _standing(check, obstacles, sensor, site)
    instance = _instance(targets, standing, obstacles, sensor=sensor, limits=limits, n_threads=n_threads)
    chosen, promised = _choose(targets, instance, n_stations, _spots(standing, site))
    settled = {element.surface for one in promised for element in (*one.elements, *one.hoped)}
    can_settle = np.asarray(instance.coverable[len(targets.elements) :][: len(targets.elements)])
    open_ = [k for k, element in enumerate(targets.elements) if element.surface not in settled]
    later = [k for k in open_ if can_settle[k]]
    why = f"it takes more than {count(n_stations, 'station')} to settle all that can be settled"
    moves, left = find_blockers(
        check, targets, [k for k in open_ if not can_settle[k]], places=standing.candidates.positions,
        obstacles=obstacles, limits=limits,
    )  # fmt: skip
    left = (*(Left(targets.elements[k], why) for k in later), *left, *targets.left)
    views = [
        View(standing.candidates.pose(c), sensor, predicted_gain_m2=one.area_m2)
        for c, one in zip(chosen, promised, strict=True)
    ]
    reason = f"the limit of {count(n_stations, 'station')} is reached" if later else "no station settles more"
    return NextStations(
        _plan(check, sensor, requirement, standing, views=views, reason=reason), promised, moves, left
    )


def _standing(check: DesignCheck, obstacles: Obstacles, sensor: Sensor, site: SiteOptions) -> Standing:
    """Return where the sensor may stand: in rooms or around an object, clear of extras, too."""
    solid, mode = obstacles.solid, decide_mode(check.design.mesh)
    scene = Scene.from_mesh(LabelledMesh(solid.vertices, solid.faces), name=check.design.name, mode=mode)
    standing = find_standing(scene, sensor, site)
    if standing.site is not None:
        return standing
    clear = Clearance.of(solid, site.clearance_m).holds(standing.candidates.positions)
    if not clear.any():
        raise InputError(f"nowhere to stand around {scene.name}: extras fill all places; see --clearance")
    around = standing.candidates.at(clear)
    return Standing(around, around, None)


def _spots(standing: Standing, site: SiteOptions) -> NDArray[np.int64] | None:
    """Numbers (c,) of the floor spots of poses; only one pose per spot is taken; None: no limit."""
    if standing.site is None or site.several_heights:
        return None
    keys = standing.site.spots(standing.candidates.positions)
    numbers = np.unique(keys, axis=0, return_inverse=True)[1].ravel()
    return np.repeat(numbers, standing.candidates.n_directions)


def _instance(
    targets: Targets,
    standing: Standing,
    obstacles: Obstacles,
    *,
    sensor: Sensor,
    limits: SightLimits,
    n_threads: int | None,
) -> CoverInstance:
    """Return which pose surely settles which of the k elements, which it may settle, and sees of n samples.

    All samples together weigh half as much as one element that may be settled.
    """
    candidates, samples = standing.candidates, targets.samples
    visible = visible_from_positions(
        obstacles.caster, candidates.positions, samples, limits, n_threads=n_threads
    )
    poses = orient(visible, candidates.positions, candidates.rotations(), samples.points, sensor)
    place = np.repeat(np.arange(poses.shape[0]) // candidates.n_directions, np.diff(poses.indptr))
    eyes, points = candidates.positions[place], samples.points[poses.indices]
    away = np.linalg.norm(points - eyes, axis=1)
    sure = poses.data >= SURE_COSINE
    veiled = np.flatnonzero(sure & targets.is_hidden[poses.indices])
    sure[veiled] = obstacles.space.unseen_m(eyes[veiled], points[veiled]) <= SURE_M
    precision = cast(Precision, limits.precision)  # limits of a sensor have one
    beams = precision.density_per_m2(away, poses.data) * samples.areas[poses.indices]
    may = [_settled(targets, poses, beams * held, samples.areas[poses.indices] * held)
           for held in (sure, np.ones(len(sure)))]  # fmt: skip
    weights = np.append(np.ones(2 * len(targets.elements)), samples.areas / (2 * samples.total_m2))
    return CoverInstance(csr_array(hstack([*may, poses], format="csr")), weights)


def _settled(targets: Targets, poses: csr_array, beams: FloatArray, areas: FloatArray) -> csr_array:
    """Ones (c, k) where a pose measures enough of an element's main faces; the others by entry of `poses`."""
    n_faces, n_elements = len(targets.owner), len(targets.elements)
    row = np.repeat(np.arange(poses.shape[0], dtype=np.int64), np.diff(poses.indptr))
    key, entry = np.unique(row * n_faces + targets.face[poses.indices], return_inverse=True)
    face = key % n_faces
    area = np.bincount(entry, areas, len(key))
    enough = (area >= targets.needed_m2[face]) & (np.bincount(entry, beams, len(key)) >= PROMISED_BEAMS)
    met = (key // n_faces)[enough] * n_elements + targets.owner[face[enough]]
    pair, n_met = np.unique(met, return_counts=True)
    pair = pair[n_met >= targets.n_needed[pair % n_elements]]
    where = (pair // n_elements, pair % n_elements)
    return csr_array((np.ones(len(pair)), where), shape=(poses.shape[0], n_elements))


def _choose(
    targets: Targets, instance: CoverInstance, n_stations: int, spots: NDArray[np.int64] | None
) -> tuple[list[int], tuple[Promise, ...]]:
    """Return the poses, greedily by weight, each of which settles something, and what they promise."""
    weights, n_elements = instance.weights.copy(), len(targets.elements)
    free = np.ones(instance.n_candidates, np.bool_)
    chosen, promised = list[int](), list[Promise]()
    while len(chosen) < n_stations:
        gains = np.where(free, instance.sums_seen(weights), 0.0)
        best = int(np.argmax(gains))
        if gains[best] < 1:
            break
        seen = instance.seen_by(best)
        new = np.sort(seen[weights[seen] > 0])
        sure, may = new[new < n_elements], new[(new >= n_elements) & (new < 2 * n_elements)] - n_elements
        area = float(targets.samples.areas[new[new >= 2 * n_elements] - 2 * n_elements].sum())
        chosen.append(best)
        of = [tuple(targets.elements[k] for k in held) for held in (sure, np.setdiff1d(may, sure))]
        promised.append(Promise(len(chosen), of[0], area, of[1]))
        weights[seen] = 0.0
        settled = np.flatnonzero(weights[:n_elements] == 0)
        weights[2 * n_elements :][np.isin(targets.owner[targets.face], settled)] = 0.0
        if spots is not None:
            free &= spots != spots[best]
    return chosen, tuple(promised)


def _plan(
    check: DesignCheck,
    sensor: Sensor,
    requirement: Requirement,
    standing: Standing | None,
    *,
    views: Sequence[View] = (),
    reason: str,
) -> Plan:
    """Return the stations as a plan, resumed from the scans of the check."""
    site = None if standing is None else standing.site
    return Plan(
        method="cover",
        sensor=sensor,
        requirement=requirement,
        target=None,
        seed=None,
        n_candidates=0 if standing is None else standing.candidates.n_poses,
        views=tuple(views),
        coverage=None,
        lower_bound=None,
        stopped_because=reason,
        candidates=None if standing is None else standing.candidates,
        resumed_from=Resumption(check.alignment.poses, None),
        site=site,
        rooms=() if site is None else site.entries(views),
        platforms=() if site is None else site.platform_entries(),
    )
