# SPDX-License-Identifier: MIT
"""Preferred values: which round or standard number a dimension was meant to be, as a hypothesis.

Each series is a prior: numbers that are multiples of its step, as likely as one another, or none at all. With
measurement x of deviation s, a number v of a series of step h is w h N(x; v, s) times as likely as any number
at all, w being the weight of the series. The weights of a part's series are learned from all of its
dimensions together (expectation maximisation, with prior counts), and so is whether it is in inches.

Holes for threads: core holes are drilled to the nominal diameter less the pitch, in the steps of ISO 2306;
coarse pitches are those of ISO 261; clearance holes are the fine, medium and coarse series of ISO 273.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import logsumexp

from completion.parts.dimensions.dimension import PartDimension, PreferredValue
from completion.parts.division.divided_part import RelatedPart
from completion.relations.relation import RelationKind, StatedRelation
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Plane

_INCH = 25.4e-3
_EXACT_M, _EXACT_RAD = 5e-7, 1e-6  # to which numbers are known at best: the rounding of files
_ROUNDS = 30
_PRIOR_COUNTS = 4.0  # of dimensions, that the prior weights are worth
_LEAST_TOLD = 0.05  # probability of a value that is told
IMPOSED = 0.95
"""Probability from which a preferred value is imposed where that is asked for."""

THREADS: dict[str, tuple[float, float, float, float]] = {
    "M1.6": (1.25, 1.7, 1.8, 2.0), "M2": (1.6, 2.2, 2.4, 2.6), "M2.5": (2.05, 2.7, 2.9, 3.1),
    "M3": (2.5, 3.2, 3.4, 3.6), "M4": (3.3, 4.3, 4.5, 4.8), "M5": (4.2, 5.3, 5.5, 5.8),
    "M6": (5.0, 6.4, 6.6, 7.0), "M8": (6.8, 8.4, 9.0, 10.0), "M10": (8.5, 10.5, 11.0, 12.0),
    "M12": (10.2, 13.0, 13.5, 14.5), "M14": (12.0, 15.0, 15.5, 16.5), "M16": (14.0, 17.0, 17.5, 18.5),
    "M18": (15.5, 19.0, 20.0, 21.0), "M20": (17.5, 21.0, 22.0, 24.0), "M22": (19.5, 23.0, 24.0, 26.0),
    "M24": (21.0, 25.0, 26.0, 28.0), "M27": (24.0, 28.0, 30.0, 32.0), "M30": (26.5, 31.0, 33.0, 35.0),
    "M33": (29.5, 34.0, 36.0, 38.0), "M36": (32.0, 37.0, 39.0, 42.0),
}  # fmt: skip
"""Millimetres of coarse threads: core hole, then clearance holes, fine, medium and coarse."""
_HOLES = ("core", "clearance, fine", "clearance, medium", "clearance, coarse")


@dataclass(frozen=True, slots=True, eq=False)
class ValueSeries:
    """Preferred values: multiples of a step, or a table; metres or radians, and its prior weight."""

    name: str
    weight: float
    step: float = 0.0
    values: tuple[float, ...] = ()
    names: tuple[str, ...] = ()

    def near(self, value: float) -> tuple[float, float, str]:
        """The value that is nearest to a number, the distance between values there, and its name."""
        if self.step:
            return float(np.rint(value / self.step)) * self.step, self.step, self.name
        place = int(np.argmin(np.abs(np.array(self.values) - value)))
        low, high = self.values[max(place - 1, 0)], self.values[min(place + 1, len(self.values) - 1)]
        return self.values[place], (high - low) / 2, self.names[place]

    def log_density(self, value: float, sd: float) -> float:
        """Log of how much likelier a measurement is if it is of this series than if it is of any number."""
        meant, step, _ = self.near(value)
        if step > 2 * sd:
            return float(np.log(step / (sd * np.sqrt(2 * np.pi))) - ((value - meant) / sd) ** 2 / 2)
        return 0.0  # as dense as numbers are known


def _hole_series() -> ValueSeries:
    every: dict[float, list[str]] = {}
    for thread, sizes in THREADS.items():
        for size, use in zip(sizes, _HOLES, strict=True):
            source = "ISO 2306" if use == "core" else "ISO 273"
            every.setdefault(size / 1000, []).append(f"{thread} {use} ({source})")
    values = tuple(sorted(every))
    names = tuple("; ".join(every[value]) for value in values)
    return ValueSeries("hole for a thread", 0.1, values=values, names=names)


HOLES = _hole_series()


_System = tuple[float, tuple[ValueSeries, ...]]
METRIC: _System = (
    0.8, (ValueSeries("1 mm", 0.3, 1e-3), ValueSeries("0.5 mm", 0.15, 5e-4),
          ValueSeries("0.1 mm", 0.15, 1e-4), HOLES),
)  # fmt: skip
"""Prior weight of a system, and the series that a part in it has values of."""
INCHES: _System = (
    0.2, (ValueSeries("1/4 in", 0.2, _INCH / 4), ValueSeries("1/16 in", 0.2, _INCH / 16),
          ValueSeries("1/64 in", 0.1, _INCH / 64), ValueSeries("0.01 in", 0.1, _INCH / 100)),
)  # fmt: skip
_PRIOR_DEG = {15: 0.4, 5: 0.1, 1: 0.1}
ANGLES: _System = (
    1.0, tuple(ValueSeries(f"{step} deg", prior, float(np.radians(step)))
               for step, prior in _PRIOR_DEG.items()),
)  # fmt: skip


def with_preferred(rows: Sequence[PartDimension]) -> tuple[PartDimension, ...]:
    """Return dimensions, each with its most probable preferred value.

    A part is metric or in inches as a whole, as its lengths together say.
    """
    lengths = _read_together(rows, "m", (METRIC, INCHES), _EXACT_M)
    angles = _read_together(rows, "rad", (ANGLES,), _EXACT_RAD)
    return tuple(replace(row, preferred=lengths.get(k, angles.get(k))) for k, row in enumerate(rows))


def _read_together(
    rows: Sequence[PartDimension], unit: str, systems: Sequence[_System], exact: float
) -> dict[int, PreferredValue]:
    """The preferred values of dimensions in one unit, by their places."""
    chosen = [k for k, row in enumerate(rows) if row.unit == unit and np.isfinite(row.sd) and row.value > 0]
    if not chosen:
        return {}
    sd = [max(rows[k].sd, exact) for k in chosen]
    shares, evidence = [], []
    for prior, of_system in systems:
        density = np.zeros((len(chosen), len(of_system) + 1))  # the last: any number
        for n, one in enumerate(of_system):
            for m, k in enumerate(chosen):
                may = one is not HOLES or rows[k].kind == "hole diameter"
                density[m, n] = one.log_density(rows[k].value, sd[m]) if may else -np.inf
        share = density + np.log(_weights(density, np.array([one.weight for one in of_system])))
        every = logsumexp(share, axis=1)
        shares.append(np.exp(share - every[:, None]))
        evidence.append(np.log(prior) + float(every.sum()))
    system_share = np.exp(np.array(evidence) - logsumexp(evidence))
    series = [one for _, of_system in systems for one in of_system]
    joint = np.concatenate(
        [weight * share[:, :-1] for weight, share in zip(system_share, shares, strict=True)], axis=1
    )
    found = ((k, _best_value(rows[k].value, sd[m], joint[m], series)) for m, k in enumerate(chosen))
    return {k: best for k, best in found if best is not None}


def _weights(density: FloatArray, prior: FloatArray) -> FloatArray:
    """Weights (m + 1,) of series by all dimensions (n, m + 1) together, the last of none."""
    prior = np.append(prior, 1 - prior.sum())
    weight = prior.copy()
    for _ in range(_ROUNDS):
        share = density + np.log(weight)
        weight = np.exp(share - logsumexp(share, axis=1, keepdims=True)).sum(axis=0) + _PRIOR_COUNTS * prior
        weight /= weight.sum()
    return np.asarray(weight)


def _best_value(
    value: float, sd: float, share: FloatArray, series: Sequence[ValueSeries]
) -> PreferredValue | None:
    """The most probable value by the series' shares (m,), with the coarsest that has it, and threads."""
    candidates: dict[float, list[int]] = {}
    for n, one in enumerate(series):
        meant, step, _ = one.near(value)
        if share[n] > 0 and meant > 0 and step > 2 * sd:
            same = next((each for each in candidates if abs(each - meant) <= 1e-9), meant)
            candidates.setdefault(same, []).append(n)
    if not candidates:
        return None
    meant = max(candidates, key=lambda each: (share[candidates[each]].sum(), each))
    probability = float(share[candidates[meant]].sum())
    if probability < _LEAST_TOLD:
        return None
    plain = [n for n in candidates[meant] if series[n].step]
    names = [series[max(plain, key=lambda n: series[n].step)].name] if plain else []
    names += [series[n].near(value)[2] for n in candidates[meant] if not series[n].step]
    return PreferredValue(meant, "; ".join(names), probability)


_STATED: dict[str, tuple[RelationKind, float]] = {
    **dict.fromkeys(("hole diameter", "outer diameter", "sphere diameter"), ("radius", 0.5)),
    **dict.fromkeys(("radius", "fillet radius", "tube radius"), ("radius", 1.0)),
    **dict.fromkeys(("thickness", "length", "slot width", "step", "distance"), ("distance", 1.0)),
    **dict.fromkeys(("axis distance", "axis to plane"), ("distance", 1.0)),
    "cone angle": ("half_angle", 0.5),
    "angle": ("angle", 1.0),
}


def preferred_relations(
    part: RelatedPart, rows: Sequence[PartDimension], least: float = IMPOSED
) -> list[StatedRelation[int]]:
    """Return preferred values that are probable enough as relations to state, by label."""
    stated = []
    for row in rows:
        if row.preferred is None or row.preferred.probability < least:
            continue
        is_between = len(row.places) == 2 and all(part.fits[k].surface.kind == Plane.kind for k in row.places)
        kind = "distance" if row.kind == "overall size" and is_between else row.kind
        if kind not in _STATED:
            continue
        relation, factor = _STATED[kind]
        between = tuple(part.labels[place] for place in row.places)
        stated += [
            StatedRelation(
                kind=relation,
                surfaces=surfaces,
                value=factor * row.preferred.value,
                source=f"preferred value of {row.kind}",
            )
            for surfaces in ([between] if len(between) > 1 else [(label,) for label in row.surfaces])
        ]
    return stated
