# SPDX-License-Identifier: MIT
"""Tables that benchmarks write after the run, beside pytest-benchmark's own."""

from collections.abc import Callable, Iterable
from typing import Any

import pytest

collect_ignore = ["rays.py", "scans.py", "textures.py"]  # programs of their own, without tests

_TABLES = pytest.StashKey[list[Callable[[], Iterable[str]]]]()


@pytest.fixture(scope="session")
def final_tables(pytestconfig: pytest.Config) -> list[Callable[[], Iterable[str]]]:
    """Return the list of functions whose lines are printed when all benchmarks have run."""
    return pytestconfig.stash.setdefault(_TABLES, [])


def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> None:
    """Print the tables."""
    for lines in config.stash.get(_TABLES, []):
        terminalreporter.write_line("")
        for line in lines():
            terminalreporter.write_line(line)
