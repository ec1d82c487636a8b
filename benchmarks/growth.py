# SPDX-License-Identifier: MIT
"""Growth: how a figure grows with a number, each number measured in a process of its own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np


def print_growth(
    module: str, numbers: Sequence[int], words: Sequence[str], folder: Path, columns: Mapping[str, str]
) -> None:
    """Measure each number; print a line each, and the exponent of seconds in it.

    A process runs `module` with the number and `words`, and MEASURE, its variable, names the `folder`. It
    prints what it found as JSON: `seconds`, `stages` (seconds by name), and what `columns` name, with the
    format of each. The exponent is that of a least-squares line through the logarithms.
    """
    seconds = []
    for number in numbers:
        told = subprocess.run(
            [sys.executable, "-m", module, str(number), *words],
            env={**os.environ, "MEASURE": str(folder)}, check=True, capture_output=True, text=True,
        ).stdout  # fmt: skip
        found: dict[str, Any] = json.loads(told)
        seconds.append(found["seconds"])
        line = " ".join(format(found[name], form) for name, form in columns.items())
        spent = ", ".join(f"{name} {value:.1f}" for name, value in found["stages"].items())
        print(f"{number:8} {line}  {spent}", flush=True)
    if len(numbers) > 1:
        slope = np.polyfit(np.log(numbers), np.log(seconds), 1)[0]
        print(f"CPU seconds grow with the number to the power of {slope:.2f}")


def peak() -> int:
    """Return the most memory that this process has held, bytes; `getrusage` would count its parent's too."""
    held = Path("/proc/self/status").read_text().partition("VmHWM:")[2]
    return int(held.split()[0]) * 1024
