# SPDX-License-Identifier: MIT
"""Showing: values show their reports, which stand above them and are loaded when one is asked for."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol

_REPORTS = "nbv.report.display"  # registers what shows; jinja2 and matplotlib load with it


class Show(Protocol):
    """Writes the report of a value and shows it; returns where it stands."""

    def __call__(
        self, thing: Any, scene: Any = None, stations: Sequence[Any] = (), /, *, n_threads: int | None = None
    ) -> Path:
        """Show it."""


_registered: list[Show] = []


def register(show: Show) -> None:
    """Let `show` show all values that have reports."""
    _registered[:] = [show]


def show_report(
    thing: object, scene: object = None, stations: Sequence[object] = (), *, n_threads: int | None = None
) -> Path:
    """Show the report of a value; see `nbv.show`."""
    if not _registered:
        import_module(_REPORTS)
    return _registered[0](thing, scene, stations, n_threads=n_threads)
