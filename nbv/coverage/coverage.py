# SPDX-License-Identifier: MIT
"""Coverage: which share of a scene's area is measured as required, which could be, and what hinders.

Error of a share: samples are drawn one in each of many pieces of surface, and neighbouring pieces come in
pairs (or threes; `nbv.visibility.samples`). A share p is a ratio of two sums over samples; of its linear part
u = z - p within the surface in question, and 0 elsewhere, the variance is estimated from the differences
within pairs (Cochran, Sampling Techniques, 1977, sections 5A.12 and 6.3):

    sd(p)^2 = sum over pairs of m / (m - 1) * a^2 * sum of (u - mean u)^2 / A^2

with m samples in a pair, a^2 their mean squared area, and A the area in question. The two pieces of a pair
are taken as if one were drawn from both, so that the estimate is too large rather than too small: where the
share changes along a smooth line, the sd comes out a third too large; where it changes from sample to sample,
right. What samples never met they cannot tell: no sd is less than the share that one sample stands for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from nbv.coverage.surface_classes import INFERRED, MODELLED
from nbv.run.showing import show_report
from nbv.visibility.requirement import Requirement
from nbv.visibility.samples import SurfaceSamples
from nbv.visibility.visibility import REASONS
from scenes.card import Card
from scenes.checks import ArrayValue, BoolArray, FloatArray, Value, frozen_copy
from scenes.run.libraries import table_of


def share_error(samples: SurfaceSamples, where: BoolArray, among: BoolArray | None = None) -> float:
    """Return the standard deviation of the share of area that lies in the samples `where` (n,).

    The share is of the samples `among` (n,), of all when not given; 0 where these have no area.

    Examples
    --------
    >>> one, row = np.ones(4), np.zeros((4, 3))
    >>> samples = SurfaceSamples(row, row, one, np.zeros(4), np.zeros(4))
    >>> share_error(samples, np.array([True, True, False, False]))
    0.25
    >>> round(share_error(samples, np.array([True, False, True, False])), 3)
    0.354
    """
    areas = samples.areas if among is None else np.where(among, samples.areas, 0.0)
    total, counts = float(areas.sum()), areas > 0
    if total == 0:
        return 0.0
    share = float(areas[where].sum()) / total
    off = np.where(counts, where - share, 0.0)
    pair = np.unique(samples.pair, return_inverse=True)[1]
    n = np.maximum(np.bincount(pair), 2)
    squares = np.bincount(pair, areas**2) / np.maximum(np.bincount(pair, counts), 1)
    spread = np.bincount(pair, off**2) - np.bincount(pair, off) ** 2 / n
    variance = float((n / (n - 1) * squares * np.maximum(spread, 0.0)).sum()) / total**2
    one_sample = float((areas**2).sum()) / counts.sum() / total**2
    return float(np.sqrt(max(variance, one_sample)))


NEVER = 1 << 20
"""First view of samples that no view measures as required."""


@dataclass(frozen=True, slots=True, eq=False)
class VisibilityHistory(ArrayValue):
    """What views see of n samples, one after the other.

    What is seen of sample k stands from `start[k]` to `start[k + 1]`, (n + 1,): number (m,) of the view, from
    1 and ascending, 0 for what was scanned before, and cosine (m,) of incidence. `first_met` (n,) is the view
    after which a sample meets the requirement, `NEVER` where none does; `met` the share of the area that
    meets it before the first view and after each.
    """

    start: NDArray[np.int64]
    view: NDArray[np.int64]
    cosine: FloatArray
    first_met: NDArray[np.int64]
    met: tuple[float, ...]

    @classmethod
    def of(
        cls,
        seen: Sequence[tuple[int, NDArray[np.int64], FloatArray]],
        first_met: NDArray[np.int64],
        met: Sequence[float],
    ) -> VisibilityHistory:
        """Return the history of (view, samples seen (m,), their cosines (m,)), in the order of the views."""
        sample = np.concatenate([np.zeros(0, np.int64), *(index for _, index, _ in seen)])
        view = np.concatenate([np.zeros(0, np.int64), *(np.full(len(i), k, np.int64) for k, i, _ in seen)])
        cosine = np.concatenate([np.zeros(0), *(values for _, _, values in seen)])
        order = np.argsort(sample, kind="stable")
        start = np.concatenate([[0], np.cumsum(np.bincount(sample, minlength=len(first_met)))])
        return cls(start, view[order], cosine[order], first_met.copy(), tuple(met))


if TYPE_CHECKING:
    from nbv.scanning.sensor import View
    from scenes.scan.range_image import RangeImage
    from scenes.world.scene import Scene

UNREACHABLE, REACHABLE, MET = 0, 1, 2
STATES = ("unreachable", "reachable", "met")
_MOST_LISTED, _LEAST_LISTED = 5, 0.0005  # surfaces on a card; fractions that it tells


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceCoverage(Value):
    """Coverage of one surface.

    Attributes
    ----------
    surface, name : int, str
        Its id in the scene, and its name.
    area_m2 : float
        Square metres; the fractions are of it.
    met, reachable, unreachable : float
        Fractions measured as required, that some candidate could measure so, and that none can.
    inferred, modelled, unknown : float
        Where completion stands in for views: fractions that are inferred, seen but not as required on a
        surface that is known exactly enough, and neither; without completion, unknown is what is not met.
    mean_cosine : float
        Area-weighted mean of the best cosines of incidence.
    standard_error : mapping
        Of each fraction, by its name (`nbv.coverage.coverage`).
    """

    surface: int
    name: str
    area_m2: float
    met: float
    reachable: float
    unreachable: float
    inferred: float
    modelled: float
    unknown: float
    mean_cosine: float
    standard_error: Mapping[str, float]


@dataclass(frozen=True, slots=True, eq=False)
class FaceCoverage(ArrayValue):
    """Coverage of every face (m,), as `coverage.ply` shows it.

    Attributes
    ----------
    best_cosine : (m,) float
        Area-weighted mean of the samples' best cosines; NaN for faces that hold no sample.
    n_views : (m,) float
        Mean number of views that see the face; NaN likewise.
    state : (m,) int8
        The state of most of the face's area (index into `STATES`); -1 for faces that hold no sample.
    """

    best_cosine: FloatArray
    n_views: FloatArray
    state: NDArray[np.int8]


@dataclass(frozen=True, slots=True)
class CoverageSummary(Value):
    """The `coverage` entry of `plan.json`.

    Attributes
    ----------
    total_m2 : float
        Area of the scene, square metres; the fractions are of it.
    met, reachable, unreachable : float
        Fractions measured as required, that some candidate could measure so, and that none can.
    inferred, modelled, unknown : float
        Where completion stands in for views: fractions that are inferred, seen but not as required on a
        surface that is known exactly enough, and neither; without completion, unknown is what is not met;
        None in files that do not tell it.
    standard_error : mapping
        Of each fraction, by its name (`nbv.coverage.coverage`); empty in files that do not tell it.
    """

    total_m2: float
    met: float
    reachable: float
    unreachable: float
    inferred: float
    modelled: float = 0.0
    unknown: float | None = None
    standard_error: Mapping[str, float] = field(default_factory=dict)

    def to_json(self) -> dict[str, Any]:
        """Return the entry."""
        return asdict(self)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Coverage(Value):
    """What views of a scene have measured.

    Attributes
    ----------
    samples : SurfaceSamples
        The points on which it was measured.
    requirement : Requirement
        What counts as met.
    best_cosine : (n,) float
        Largest cosine of incidence over the views that see the sample in range; 0 where none does.
    n_views : (n,) int32
        How many views see the sample in range, at any incidence.
    state : (n,) int8
        `UNREACHABLE`, `REACHABLE` (but not met) or `MET`.
    reason : (n,) int8
        Why unreachable, index into `nbv.visibility.visibility.REASONS`; -1 elsewhere.
    surface_names : tuple of str
        Names of the surfaces that the samples refer to.
    n_faces : int
        Faces of the mesh.
    classes : (n,) int8, optional
        Where completion stands in for views: index into `nbv.coverage.surface_classes.CLASSES`.
    history : VisibilityHistory, optional
        Which view saw which sample, as measuring found it.
    apart_m2 : mapping
        Area that bounds none of the rooms asked for and counts for nothing, by reason
        (`nbv.visibility.candidates.APART`), square metres; the samples there stand for no area.
    """

    samples: SurfaceSamples
    requirement: Requirement
    best_cosine: FloatArray
    n_views: NDArray[np.int32]
    state: NDArray[np.int8]
    reason: NDArray[np.int8]
    surface_names: tuple[str, ...]
    n_faces: int
    classes: NDArray[np.int8] | None = None
    history: VisibilityHistory | None = None
    apart_m2: Mapping[str, float] = field(default_factory=dict)

    def __repr__(self) -> str:
        return (
            f"Coverage({len(self.samples)} samples, {self.total_m2:.4g} m2, met {self.met:.4f}, "
            f"reachable {self.reachable:.4f})"
        )

    def __post_init__(self) -> None:
        for name, dtype in (
            ("best_cosine", np.float64),
            ("n_views", np.int32),
            ("state", np.int8),
            ("reason", np.int8),
        ):
            object.__setattr__(self, name, frozen_copy(getattr(self, name), dtype))
        if self.classes is not None:
            object.__setattr__(self, "classes", frozen_copy(self.classes, np.int8))

    @property
    def total_m2(self) -> float:
        """Area of the scene, square metres."""
        return self.samples.total_m2

    @property
    def met(self) -> float:
        """Fraction of the area that meets the requirement."""
        return self._fraction(self.state == MET)

    @property
    def reachable(self) -> float:
        """Fraction of the area that some candidate, or one of the views, could measure as required."""
        return self._fraction(self.state != UNREACHABLE)

    @property
    def unreachable(self) -> float:
        """Fraction of the area that none can: 1 - reachable."""
        return 1.0 - self.reachable

    @property
    def inferred(self) -> float:
        """Fraction of the area, not measured, that completion infers; 0 for coverage by views alone."""
        return self._fraction(self._is(INFERRED))

    @property
    def modelled(self) -> float:
        """Fraction of the area, not measured as required, that completion models; 0 by views alone."""
        return self._fraction(self._is(MODELLED))

    @property
    def unknown(self) -> float:
        """Fraction of the area that is neither met nor modelled nor inferred."""
        return max(1.0 - self.met - self.modelled - self.inferred, 0.0)

    @property
    def met_of_reachable(self) -> float:
        """Fraction of the reachable area that is met; 1 where nothing is reachable."""
        reachable = self.reachable
        return self.met / reachable if reachable > 0 else 1.0

    @property
    def met_of_reachable_error(self) -> float:
        """Standard error of `met_of_reachable`."""
        return share_error(self.samples, self.state == MET, self.state != UNREACHABLE)

    def standard_errors(self) -> dict[str, float]:
        """Standard error of each fraction of the area, by its name (`nbv.coverage.coverage`)."""
        return self._errors(np.ones(len(self.samples), np.bool_))

    def reasons(self) -> dict[str, float]:
        """Fractions of the area that are unreachable for each reason."""
        return {name: self._fraction(self._unreachable_for(k)) for k, name in enumerate(REASONS)}

    def reason_errors(self) -> dict[str, float]:
        """Standard error of each of `reasons`."""
        errors = (share_error(self.samples, self._unreachable_for(k)) for k in range(len(REASONS)))
        return dict(zip(REASONS, errors, strict=True))

    def by_surface(self) -> tuple[SurfaceCoverage, ...]:
        """Coverage of each surface that has area, by surface id."""
        ids, table = self.samples.surface, []
        kinds = self.state == MET, self.state != UNREACHABLE, self._is(INFERRED), self._is(MODELLED)
        for surface in np.unique(ids[self.samples.areas > 0]):
            here = ids == surface
            area = self.samples.areas[here]
            total = float(area.sum())
            met, reachable, inferred, modelled = (float(area[kind[here]].sum()) / total for kind in kinds)
            table.append(
                SurfaceCoverage(
                    surface=int(surface),
                    name=self.surface_names[surface],
                    area_m2=total,
                    met=met,
                    reachable=reachable,
                    unreachable=1 - reachable,
                    inferred=inferred,
                    modelled=modelled,
                    unknown=max(1 - met - modelled - inferred, 0.0),
                    mean_cosine=float(area @ self.best_cosine[here]) / total,
                    standard_error=self._errors(here),
                )
            )
        return tuple(table)

    def by_face(self) -> FaceCoverage:
        """Coverage of each face."""
        face, area = self.samples.face, self.samples.areas
        held = np.bincount(face, area, self.n_faces)
        shares = np.stack(
            [np.bincount(face, area * (self.state == k), self.n_faces) for k in range(len(STATES))]
        )
        with np.errstate(invalid="ignore"):
            cosine = np.bincount(face, area * self.best_cosine, self.n_faces) / held
            views = np.bincount(face, area * self.n_views, self.n_faces) / held
        return FaceCoverage(cosine, views, np.where(held > 0, shares.argmax(axis=0), -1).astype(np.int8))

    def summary(self) -> CoverageSummary:
        """Return the `coverage` entry of `plan.json`."""
        shares = (self.met, self.reachable, self.unreachable, self.inferred, self.modelled, self.unknown)
        return CoverageSummary(self.total_m2, *shares, self.standard_errors())

    def to_json(self) -> dict[str, Any]:
        """Return the contents of `coverage.json`: fractions are of area."""
        names = {"surface": "id", "mean_cosine": "mean_best_cosine"}
        rows = [asdict(row) for row in self.by_surface()]
        surfaces = [{names.get(name, name): value for name, value in row.items()} for row in rows]
        return {
            **self.summary().to_json(),
            "requirement": self.requirement.to_json(),
            "n_samples": len(self.samples),
            "unreachable_because": self.reasons(),
            "unreachable_because_standard_error": self.reason_errors(),
            "set_apart_m2": dict(self.apart_m2),
            "surfaces": surfaces,
        }

    def to_pandas(self) -> Any:
        """Return `by_surface` as a `pandas.DataFrame`; raises InputError without pandas."""
        return table_of([asdict(row) for row in self.by_surface()])

    def show(
        self, scene: Scene, stations: Sequence[View] | Sequence[RangeImage], *, n_threads: int | None = None
    ) -> Path:
        """Show the full report of this coverage of `scene` by `stations`; see `nbv.show`."""
        return show_report(self, scene, stations, n_threads=n_threads)

    def _repr_html_(self) -> str:
        """What a notebook shows: measured, missed and unreachable area."""
        from nbv.coverage.card_parts import area_bar  # only notebooks need cards

        total, reasons = self.total_m2, self.reasons()
        figures = [
            ("surface", f"{total:.2f} m\u00b2, {len(self.samples)} samples"),
            ("counts as measured", self.requirement.describe()),
            ("measured", f"{100 * self.met:.1f} %, {self.met * total:.2f} m\u00b2"),
            ("of what can be reached", f"{100 * self.met_of_reachable:.1f} %"),
        ]
        figures += [
            (f"unreachable: {name.replace('_', ' ')}", f"{100 * share:.1f} %")
            for name, share in reasons.items()
            if share >= _LEAST_LISTED
        ]
        missed = sorted(self.by_surface(), key=lambda row: (row.met - row.reachable) * row.area_m2)
        figures += [
            (f"missed on {row.name}", f"{(row.reachable - row.met) * row.area_m2:.2f} m\u00b2")
            for row in missed[:_MOST_LISTED]
            if row.reachable - row.met > _LEAST_LISTED
        ]
        bar = area_bar(met=self.met, inferred=self.modelled + self.inferred, reachable=self.reachable)
        return Card("Coverage", "which surface is measured as required", figures, bar=bar).to_html()

    def _is(self, kind: int) -> BoolArray:
        """Samples of a class; none where completion does not stand in for views."""
        classes = np.full(len(self.samples), -1, np.int8) if self.classes is None else self.classes
        return np.asarray(classes == kind, dtype=np.bool_)

    def _unreachable_for(self, reason: int) -> BoolArray:
        """Samples that are unreachable for the reason of this number."""
        return np.asarray((self.state == UNREACHABLE) & (self.reason == reason), dtype=np.bool_)

    def _errors(self, here: BoolArray) -> dict[str, float]:
        """Standard error of the fractions of the area of the samples `here` (n,), by their names."""
        samples = self.samples.some(here)
        inferred, modelled = self._is(INFERRED)[here], self._is(MODELLED)[here]
        met, reachable = (self.state == MET)[here], (self.state != UNREACHABLE)[here]
        error = share_error(samples, reachable)
        return {
            "met": share_error(samples, met),
            "reachable": error,
            "unreachable": error,
            "inferred": share_error(samples, inferred),
            "modelled": share_error(samples, modelled),
            "unknown": share_error(samples, ~(met | inferred | modelled)),
        }

    def _fraction(self, where: BoolArray) -> float:
        total = self.total_m2
        return float(self.samples.areas[where].sum()) / total if total > 0 else 0.0
