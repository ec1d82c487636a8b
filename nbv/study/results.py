# SPDX-License-Identifier: MIT
"""Results: the tables of a study, as CSV or Parquet; the same outcomes give the same bytes."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any, Literal

from nbv.run.csv_table import csv_text
from nbv.study.outcome import COLUMNS, Outcome
from scenes.checks import InputError
from scenes.run.atomic import write_bytes, write_text

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
    write = _write_csv if kind == "csv" else _write_parquet
    results, curves = folder / f"results.{kind}", folder / f"curves.{kind}"
    write([outcome.row() for outcome in outcomes], COLUMNS, results)
    write([row for outcome in outcomes for row in _curve(outcome)], CURVE_COLUMNS, curves)
    return results, curves


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
