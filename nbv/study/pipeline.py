# SPDX-License-Identifier: MIT
"""Study: plan every case that is not planned yet, then report what all of them found.

A case is a pure function of what its key names, and its plan is written whole or not at all. So a study that
was killed continues where it stopped, and ends with the same bytes, whoever does the work. Outcomes and the
groups of cases are numbers; their tables are CSV or Parquet.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any, Literal

import numpy as np

from nbv.run.workers import ThisProcess, Workers
from nbv.study.archive import RecordArchive, do_missing
from nbv.study.case import Case, cases_of, run_case
from nbv.study.spec import StudySpec
from nbv.visibility.visibility import Progress
from scenes.checks import ArrayValue, FloatArray, InputError, Value
from scenes.run.atomic import write_bytes, write_text
from scenes.run.csv_table import csv_text

SHARES = (0.90, 0.95, 0.99)  # of the reachable area, at which views are counted
COLUMNS = {
    "case": str, "scene": str, "sensor": str, "requirement": str, "planner": str, "seed": int,
    "max_incidence_deg": float, "max_range_m": float, "min_density_per_m2": float, "max_sd_m": float,
    "k": int, "target": float, "spacing_m": float,
    "n_candidates": int, "n_samples": int, "total_m2": float, "reachable": float, "met": float,
    "met_standard_error": float, "met_of_reachable": float, "modelled": float, "inferred": float,
    "unknown": float, "views": int, **{f"views_to_{100 * share:.0f}": int for share in SHARES},
    "lower_bound": int, "tour_m": float, "legs_without_way": int, "stopped_because": str, "error": str,
}  # fmt: skip
_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Outcome(ArrayValue):
    """Result of one case.

    Attributes
    ----------
    case : Case
        What was planned.
    met : (n_views,) float
        Share of the area that is measured as required after each view.
    gain_m2 : (n_views,) float
        Area that each view adds to it, square metres.
    total_m2, reachable : float
        Area, and the share of it that any candidate could measure as required.
    n_candidates, n_samples : int
        Poses that could be chosen, and samples on which coverage is measured.
    modelled, inferred, unknown : float
        Shares of the area; 0 where completion did not stand in for views (unknown: all that is not met).
    lower_bound : int or None
        Views that any plan needs, where certified.
    tour_m : float or None
        Length of the tour of the stations (online: of the way from scan to scan), metres.
    legs_without_way : int or None
        How many of its legs have no way, which the length leaves out.
    met_standard_error : float
        Of the last of `met`.
    times : mapping
        "seconds" by the clock and "cpu_seconds" that planning took, where this run planned it; in the
        manifest, not in the results, whose bytes do not depend on the run.
    stopped_because : str
        Why there are no more views.
    error : str
        Why the case could not be planned; "" where it could.
    """

    case: Case
    met: FloatArray
    gain_m2: FloatArray
    total_m2: float = float("nan")
    reachable: float = float("nan")
    n_candidates: int = 0
    n_samples: int = 0
    modelled: float = 0.0
    inferred: float = 0.0
    unknown: float = float("nan")
    lower_bound: int | None = None
    tour_m: float | None = None
    legs_without_way: int | None = None
    met_standard_error: float = float("nan")
    times: Mapping[str, float] = field(default_factory=dict)
    stopped_because: str = ""
    error: str = ""

    @property
    def n_views(self) -> int:
        """How many views were planned."""
        return len(self.met)

    @property
    def of_reachable(self) -> FloatArray:
        """Share (n_views + 1,) of the reachable area that is met before the first view and after each."""
        whole = np.concatenate([[0.0], self.met])
        return whole / self.reachable if self.reachable > 0 else np.zeros(len(whole))

    def views_to(self, share: float) -> int | None:
        """Views until `share` of the reachable area is measured as required; None where it never is."""
        enough = np.flatnonzero(self.of_reachable[1:] >= share - _ROUNDING)
        return int(enough[0]) + 1 if len(enough) else None

    def row(self) -> dict[str, Any]:
        """Return the row of the results, by `COLUMNS`."""
        figures = {
            "total_m2": self.total_m2,
            "reachable": self.reachable,
            "met": float(self.met[-1]) if self.n_views else 0.0,
            "met_standard_error": self.met_standard_error,
            "met_of_reachable": float(self.of_reachable[-1]),
            "modelled": self.modelled,
            "inferred": self.inferred,
            "unknown": self.unknown,
            "views": self.n_views,
        }
        return {
            "case": self.case.name,
            **self.case.labels(),
            **self.case.settings(),
            "n_candidates": self.n_candidates,
            "n_samples": self.n_samples,
            **(dict.fromkeys(figures) if self.error else figures),
            **{f"views_to_{100 * share:.0f}": self.views_to(share) for share in SHARES},
            "lower_bound": self.lower_bound,
            "tour_m": self.tour_m,
            "legs_without_way": self.legs_without_way,
            "stopped_because": self.stopped_because,
            "error": self.error,
        }


def outcome_of(case: Case, record: Mapping[str, Any], times: Mapping[str, float] | None = None) -> Outcome:
    """Return the outcome of a case's record, and what planning it took, seconds."""
    if record.get("error"):
        return Outcome(case, np.zeros(0), np.zeros(0), error=str(record["error"]))
    views, coverage, bound = record["views"], record["coverage"], record["lower_bound"]
    shares = record["inference"][-1] if record["inference"] else None
    return Outcome(
        case,
        np.array([view["met_fraction"] for view in views], dtype=np.float64),
        np.array([view["gain_m2"] for view in views], dtype=np.float64),
        total_m2=float(coverage["total_m2"]),
        reachable=float(coverage["reachable"]),
        n_candidates=int(record["n_candidates"]),
        n_samples=int(record["n_samples"]),
        modelled=float(shares["modelled"]) if shares else 0.0,
        inferred=float(shares["inferred"]) if shares else 0.0,
        unknown=float(shares["unknown"]) if shares else 1.0 - float(coverage["met"]),
        lower_bound=int(bound["views"]) if bound else None,
        tour_m=record["tour_m"],
        legs_without_way=record.get("legs_without_way"),
        met_standard_error=float(coverage.get("standard_error", {}).get("met", np.nan)),
        times=times or {},
        stopped_because=str(record["stopped_because"]),
    )


@dataclass(frozen=True, slots=True, eq=False)
class OutcomeGroup(Value):
    """Outcomes of one scene, sensor, requirement and planner.

    Attributes
    ----------
    scene, sensor, requirement, planner : str
        Labels.
    outcomes : tuple of Outcome
        One a seed, those that could be planned.
    n_failed : int
        How many could not.
    """

    scene: str
    sensor: str
    requirement: str
    planner: str
    outcomes: tuple[Outcome, ...]
    n_failed: int

    @property
    def setting(self) -> tuple[str, str, str]:
        """Scene, sensor and requirement."""
        return self.scene, self.sensor, self.requirement

    def views_to(self, share: float) -> FloatArray:
        """Views (n,) of each outcome until `share` of the reachable area is measured; inf for never."""
        numbers = [outcome.views_to(share) for outcome in self.outcomes]
        return np.array([np.inf if views is None else views for views in numbers], dtype=np.float64)

    def values(self, name: str) -> FloatArray:
        """Values (n,) of a column of the results; nan for none."""
        column = [outcome.row()[name] for outcome in self.outcomes]
        return np.array([np.nan if value is None else value for value in column], dtype=np.float64)

    def curves(self) -> FloatArray:
        """Share of the reachable area (n, n_most + 1) measured before the first and after each view.

        A plan that has ended stays where it was.
        """
        curves = [outcome.of_reachable for outcome in self.outcomes]
        n_most = max((len(curve) for curve in curves), default=1)
        padded = [np.concatenate([curve, np.full(n_most - len(curve), curve[-1])]) for curve in curves]
        return np.array(padded).reshape(len(curves), n_most)


def groups_of(outcomes: Sequence[Outcome]) -> tuple[OutcomeGroup, ...]:
    """Return the outcomes in groups, in the order of the study file."""
    members: dict[tuple[str, str, str, str], list[Outcome]] = {}
    for outcome in outcomes:
        labels = outcome.case.labels()
        key = (labels["scene"], labels["sensor"], labels["requirement"], labels["planner"])
        members.setdefault(key, []).append(outcome)
    return tuple(
        OutcomeGroup(
            *key,
            outcomes=tuple(outcome for outcome in member if not outcome.error),
            n_failed=sum(bool(outcome.error) for outcome in member),
        )
        for key, member in members.items()
    )


def run_study(
    spec: StudySpec,
    folder: Path,
    *,
    first_seed: int = 0,
    workers: Workers | None = None,
    progress: Progress | None = None,
) -> tuple[Outcome, ...]:
    """Run a study and return the outcome of each case, in the order of the study file.

    Parameters
    ----------
    spec : StudySpec
        What to plan.
    folder : Path
        Keeps a plan for each case; those that are there already and were made of the same are not made again.
    first_seed : int
        Added to every seed of the study.
    workers : Workers, optional
        Who plans; this process when not given. The outcomes do not depend on it.
    progress : callable, optional
        Called with ("cases", done, total).

    Raises
    ------
    InputError
        A scene or sensor that cannot be used; nothing has been planned then. A single case that cannot be
        planned has an outcome that says why.
    """
    cases, archive = cases_of(spec, first_seed), RecordArchive(folder)
    times = do_missing(cases, archive, run_case, workers=workers or ThisProcess(), progress=progress)
    return tuple(outcome_of(case, archive.read(case), times.get(case.name, {})) for case in cases)


Rows = Sequence[Mapping[str, Any]]
Columns = Mapping[str, type]
CURVE_COLUMNS: Columns = {"case": str, "view": int, "gain_m2": float, "met": float, "met_of_reachable": float}


def write_results(
    outcomes: Sequence[Outcome], folder: Path, kind: Literal["csv", "parquet"]
) -> tuple[Path, Path]:
    """Write `results`, one row a case, and `curves`, one row a view; return their paths.

    Raises
    ------
    InputError
        The folder cannot be written, or Parquet is asked for and pyarrow is missing.
    """
    curves = [row for outcome in outcomes for row in _curve(outcome)]
    tables: dict[str, tuple[Rows, Columns]] = {
        "results": ([outcome.row() for outcome in outcomes], COLUMNS),
        "curves": (curves, CURVE_COLUMNS),
    }
    first, second = write_tables(tables, folder, kind)
    return first, second


def write_tables(
    tables: Mapping[str, tuple[Rows, Columns]], folder: Path, kind: Literal["csv", "parquet"]
) -> tuple[Path, ...]:
    """Write tables by name, each its rows and columns; return their paths. Raises as `write_results`."""
    write, paths = (_write_csv if kind == "csv" else _write_parquet), list[Path]()
    for name, (rows, columns) in tables.items():
        paths.append(folder / f"{name}.{kind}")
        write(rows, columns, paths[-1])
    return tuple(paths)


def check_results(kind: Literal["csv", "parquet"]) -> None:
    """Raise InputError when results could not be written, before anything is planned."""
    if kind == "parquet":
        _pyarrow()


def _curve(outcome: Outcome) -> Iterator[dict[str, Any]]:
    of_reachable = outcome.of_reachable[1:]
    for number, (met, gain, share) in enumerate(
        zip(outcome.met, outcome.gain_m2, of_reachable, strict=True), start=1
    ):
        yield {
            "case": outcome.case.name,
            "view": number,
            "gain_m2": float(gain),
            "met": float(met),
            "met_of_reachable": float(share),
        }


def _write_csv(rows: Rows, columns: Columns, path: Path) -> None:
    write_text(path, csv_text(list(columns), ([row[name] for name in columns] for row in rows)))


def _write_parquet(rows: Rows, columns: Columns, path: Path) -> None:
    pyarrow = _pyarrow()
    from pyarrow import parquet

    kinds = {str: pyarrow.string(), int: pyarrow.int64(), float: pyarrow.float64()}
    schema = pyarrow.schema([(name, kinds[kind]) for name, kind in columns.items()])
    table = pyarrow.table({name: [row[name] for row in rows] for name in columns}, schema=schema)
    buffer = io.BytesIO()
    parquet.write_table(table, buffer)
    write_bytes(path, buffer.getvalue())


def _pyarrow() -> ModuleType:
    try:
        import pyarrow
    except ImportError as error:
        raise InputError(
            'Parquet needs pyarrow: pip install "unseen[parquet]", or put results = "csv" in the study file'
        ) from error
    module: ModuleType = pyarrow
    return module
