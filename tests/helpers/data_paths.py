# SPDX-License-Identifier: MIT
"""Where the real data and the benchmark instances lie, and skips where they do not."""

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
"""The root of the checkout."""
_SHARED = ROOT.parent / "shared"


def data_path(name: str) -> Path:
    """Path of a real data file, e.g. "range/pcl/office1.pcd", under UNSEEN_DATA or ../shared/data."""
    return Path(os.environ.get("UNSEEN_DATA", _SHARED / "data")) / name


def bench_path(name: str) -> Path:
    """Path of a benchmark instance, e.g. "office.npz", under UNSEEN_BENCH or ../shared/bench."""
    return Path(os.environ.get("UNSEEN_BENCH", _SHARED / "bench")) / name


requires_data = pytest.mark.skipif(
    not data_path("README.md").exists(), reason=f"no real data at {data_path('')} (set UNSEEN_DATA)"
)
requires_bench = pytest.mark.skipif(
    not bench_path("README.md").exists(), reason=f"no benchmark data at {bench_path('')} (set UNSEEN_BENCH)"
)
