# SPDX-License-Identifier: MIT
"""Cost: time and memory that a method takes, for the manifest; results never depend on it."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median
from typing import Any, TypeVar

_RESET_PEAK = "5"  # what proc(5) says resets the peak of resident memory
_T = TypeVar("_T")


@dataclass(frozen=True, slots=True)
class Cost:
    """What one run of a method took.

    Attributes
    ----------
    wall_s, cpu_s : float
        Seconds that passed, and seconds of all threads together.
    peak_bytes : int, optional
        Largest resident memory of the process meanwhile; None where the system does not tell.
    """

    wall_s: float
    cpu_s: float
    peak_bytes: int | None

    def record(self) -> dict[str, Any]:
        """Return it for JSON."""
        return asdict(self)


def measured(work: Callable[[], _T]) -> tuple[_T, Cost]:
    """Return what `work` returns, and what it took.

    Examples
    --------
    >>> total, cost = measured(lambda: sum(range(1000)))
    >>> total, cost.wall_s > 0
    (499500, True)
    """
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text(_RESET_PEAK)
    wall, cpu = time.perf_counter(), time.process_time()
    result = work()
    return result, Cost(time.perf_counter() - wall, time.process_time() - cpu, _peak_bytes())


def _peak_bytes() -> int | None:
    """Peak of resident memory since it was reset, by Linux's proc(5)."""
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
    except OSError:
        return None
    return next((1024 * int(line.split()[1]) for line in lines if line.startswith("VmHWM:")), None)


def cost_summary(costs: Sequence[Cost]) -> dict[str, Any]:
    """Return count, totals, medians and largest peak of one method's costs; the first run compiles."""
    peaks = [cost.peak_bytes for cost in costs if cost.peak_bytes is not None]
    return {
        "n": len(costs),
        "wall_s": round(sum(cost.wall_s for cost in costs), 3),
        "cpu_s": round(sum(cost.cpu_s for cost in costs), 3),
        "median_wall_s": round(median(cost.wall_s for cost in costs), 3),
        "median_cpu_s": round(median(cost.cpu_s for cost in costs), 3),
        "peak_bytes": max(peaks, default=None),
    }


def cost_line(method: str, summary: dict[str, Any]) -> str:
    """Return a summary as a line for people.

    Examples
    --------
    >>> cost_line("standard", cost_summary([Cost(2.0, 3.0, 5_000_000)]))
    'standard: 2.00 s, CPU 3.00 s a case (median of 1), peak 5 MB'
    """
    peak = "unknown" if summary["peak_bytes"] is None else f"{summary['peak_bytes'] / 1e6:.0f} MB"
    return (
        f"{method}: {summary['median_wall_s']:.2f} s, CPU {summary['median_cpu_s']:.2f} s a case "
        f"(median of {summary['n']}), peak {peak}"
    )
