# SPDX-License-Identifier: MIT
"""Check against a design: verdicts and intervals on planted states, beside C2M and M3C2."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields

import numpy as np

from benchmarks.cases.asbuilt import MOVES_M, PlantedState, duplex, planted_state
from benchmarks.cases.offices import large_office, office
from benchmarks.cases.surveys import SETTINGS, Survey, sighting, survey
from benchmarks.methods.distances import DesignTree, aligned_points, cloud_to_mesh, judged, multiscale
from benchmarks.metrics.verdicts import Covered, Judged, Share, StateScore, poisson_bound, rates, score
from benchmarks.run import head, row, suite
from benchmarks.store import each, measured
from completion.asbuilt.findings import VERDICTS, DesignCheck
from completion.asbuilt.pipeline import CheckOptions, check_against_design
from scenes.checks import InputError

BUILDINGS = {"duplex": duplex, "office": office, "large": large_office}
_TRUTHS = (
    "unchanged", *(f"moved {1000 * size:.0f} mm" for size in MOVES_M), "tilted", "thickness", "bowed",
    "displaced", "open", "removed", "hidden", "hidden removed",
)  # fmt: skip
_FAR_OFF = "unchanged", "moved", "tilted", "thickness", "bowed", "displaced", "hidden"


@dataclass(frozen=True, slots=True)
class StateResult:
    """Score of a check, verdicts of its peers by element, and what it took."""

    score: StateScore
    peers: dict[str, list[str]]
    cpu_s: float
    peak_mb: float
    megapixels: float


def checked(state: PlantedState, scans: Survey, setting: str, tolerance_m: float) -> DesignCheck:
    """Check the scans of a state on one thread, with the registration error that they have."""
    sd_m, sd_rad = SETTINGS[setting].station
    options = CheckOptions(tolerance_m=tolerance_m, registration=(sd_m, float(np.degrees(sd_rad))))
    return check_against_design(state.design, scans.given, options, n_threads=1)


def of_state(
    building: str, seed: int, setting: str, megapixels: float, tolerance_m: float, peers: bool
) -> StateResult:
    """Plant, scan, check and score one state."""
    state = planted_state(BUILDINGS[building](), seed)
    scans = survey(state, setting, seed, megapixels)
    check, cost = measured(lambda: checked(state, scans, setting, tolerance_m))
    found = score(check, state, sighting(state, scans.true))
    verdicts: dict[str, list[str]] = {}
    if peers:
        tree = DesignTree(state.design.mesh)
        points = aligned_points(scans.given, state.design, tree)
        verdicts["C2M"] = judged(cloud_to_mesh(points, state.design, tree), tolerance_m)
        verdicts["M3C2"] = judged(multiscale(points, state.design, state.stations), tolerance_m)
    return StateResult(found, verdicts, cost.cpu_s, (cost.peak_bytes or 0) / 1e6, scans.n_pixels / 1e6)


@suite("asbuilt", smallest="--seeds 1 --megapixels 0.4 --no-peers")
def asbuilt(
    seeds: int = 12,
    first: int = 100,
    building: str = "duplex",
    setting: str = "2mm",
    megapixels: float = 2.4,
    tolerance: float = 0.01,
    peers: bool = True,
    listed: bool = False,
) -> Iterator[str]:
    """Check against a design: verdicts on planted states, intervals, and distances to the design beside it.

    Seeds 0 to 5 are for tuning (--first 0 --seeds 6), those from 100 held out. --building: duplex, office or
    large; --setting: 2mm, 0mm, 5mm, 3cm or camera.
    """
    for what, given, known in (("building", building, BUILDINGS), ("setting", setting, SETTINGS)):
        if given not in known:
            raise InputError(f"there is no {what} {given}; there are {', '.join(known)}")
    states = list(
        each(of_state, building, range(first, first + seeds), setting, megapixels, tolerance, peers)
    )
    for number, state in enumerate(states if listed else ()):
        yield from (
            f"seed {first + number}: {one}" for one in state.score.judged if _is_worth(one, tolerance)
        )
    yield from _verdicts(states)
    yield ""
    yield from _promises(states, tolerance)
    yield ""
    yield from _coverage([one for state in states for one in state.score.covered])
    yield ""
    yield from _costs(states)


def _is_worth(one: Judged, tolerance_m: float) -> bool:
    """Whether an element is worth a line: changed, or wrongly judged."""
    found = rates([one], tolerance_m)
    return one.truth != "unchanged" or bool(found.false_deviates + found.false_missing)


def _verdicts(states: Sequence[StateResult]) -> Iterator[str]:
    """Truth by verdict, measured elements (of removed ones: with beams behind) apart; the peers beside."""
    names = list(states[0].peers)
    yield from head("truth", "n", *VERDICTS, *(f"{name}: within / deviates / no data" for name in names))
    for truth in _TRUTHS:
        words = ("no beam behind", "beams behind") if truth == "removed" else ("not measured", "measured")
        for is_known in (True, False):
            own = [
                (one, [state.peers[name][one.surface] for name in names])
                for state in states
                for one in state.score.judged
                if one.truth == truth and (one.behind if truth == "removed" else one.measured) == is_known
            ]
            if not own:
                continue
            count = Counter(one.verdict for one, _ in own)
            beside = [Counter(said[k] for _, said in own) for k in range(len(names))]
            told = (" / ".join(str(one[w]) for w in ("within", "deviates", "no data")) for one in beside)
            yield row(
                f"{truth}, {words[is_known]}", len(own), *(count[verdict] for verdict in VERDICTS), *told
            )


def _promises(states: Sequence[StateResult], tolerance_m: float) -> Iterator[str]:
    """What a check promises, and the same of the peers."""
    names = ["check", *states[0].peers]
    columns = []
    for name in names:
        elements = [
            one if name == "check" else _said(one, state.peers[name][one.surface])
            for state in states
            for one in state.score.judged
        ]
        columns.append(rates(elements, tolerance_m))
    yield from head(f"{len(states)} states, T = {1000 * tolerance_m:g} mm", *names)
    for one in fields(columns[0]):
        cells = []
        for column in columns:
            value = getattr(column, one.name)
            bound = (
                "" if isinstance(value, Share) else f" (a state: < {poisson_bound(value, len(states)):.2f})"
            )
            cells.append(f"{value}{bound}")
        yield row(one.name.replace("_", " "), *cells)
    extra = np.array([(state.score.extra_right, state.score.extra_found) for state in states])
    right, found = np.nanmean(extra, axis=0) if np.isfinite(extra).any(axis=0).all() else (np.nan, np.nan)
    yield row("extras right, found", f"{right:.1%}, {found:.1%}", *("-" for _ in names[1:]))
    for truth in ("tilted", "bowed", "thickness", "displaced", "open"):
        own = [one for s in states for one in s.score.judged if one.truth == truth]
        kinds = Counter((one.kind or one.verdict) + (" + extra" if one.related else "") for one in own)
        said = ", ".join(f"{count} {kind}" for kind, count in kinds.most_common())
        yield row(f"{truth}: kinds", said, *("-" for _ in names[1:]))


def _said(one: Judged, verdict: str) -> Judged:
    """The element as a peer judged it."""
    return Judged(one.surface, one.truth, one.measured, one.worst_m, one.behind, verdict, "", related=False)


def _coverage(covered: Sequence[Covered]) -> Iterator[str]:
    """How many intervals of 95 % hold."""
    yield from head("intervals of 95 %", "n", "hold", "median half, mm or mrad")
    for what in ("offset", "thickness", "tilt", "bow", "shift"):
        for truth in _FAR_OFF:
            own = [one for one in covered if (one.what, one.truth) == (what, truth)]
            if own:
                hold = f"{np.mean([one.holds for one in own]):.1%}"
                yield row(f"{what}, {truth}", len(own), hold, f"{1e3 * np.median([o.half for o in own]):.2f}")


def _costs(states: Sequence[StateResult]) -> Iterator[str]:
    """Processor time and memory of the check."""
    yield from head("elements", "Mpx", "CPU, s", "s a Mpx", "s a 1,000 elements", "peak, MB")
    cpu, pixels = np.median([s.cpu_s for s in states]), np.median([s.megapixels for s in states])
    n, peak = len(states[0].score.judged), max(s.peak_mb for s in states)
    yield row(
        n,
        f"{pixels:.2f}",
        f"{cpu:.1f}",
        f"{cpu / pixels:.1f}",
        f"{1000 * cpu / max(n, 1):.0f}",
        f"{peak:.0f}",
    )
