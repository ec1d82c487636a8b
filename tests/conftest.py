# SPDX-License-Identifier: MIT
"""What holds for all tests: reports are small, packed quickly and not synced; the longest files run first."""

import gc
import os
from collections.abc import Iterator
from functools import cache

import pytest
import typer.main
import typer.testing
from hypothesis import settings

from nbv.report import scans_report as scan_coverage_blocks
from nbv.report.figures import completion_shots, part_drawing, picture, plots, surface_values
from nbv.report.viewer import encoding as byte_packing
from tests.helpers.data_paths import ROOT


@pytest.fixture(autouse=True, scope="session")
def small_reports() -> Iterator[None]:
    """Pictures half as wide, plots with half the dots and for light pages, images packed fast."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(picture, "_PNG_LEVEL", 1)
        patch.setattr(byte_packing, "_METHOD", 0)
        patch.setattr(plots, "_DPI", 90)
        patch.setattr(plots, "_DARK", plots.LIGHT)  # what is equal is drawn once
        for module in (completion_shots, part_drawing, scan_coverage_blocks, surface_values):
            patch.setattr(module, "_WIDTH", 380)
        patch.setattr(part_drawing, "_SHARP", 600)
        yield


@pytest.fixture(autouse=True, scope="session")
def unsynced_files() -> Iterator[None]:
    """No file of a test outlives the machine, so nobody waits until the disk has it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", lambda _: None)
        yield


@pytest.fixture(autouse=True, scope="session")
def made_once() -> Iterator[None]:
    """The command line is put together once a process and not for each command, as it is outside tests."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(typer.testing, "_get_command", cache(typer.main.get_command))
        yield


# beside thousands of tests and all modules, looking for circles as often as usual takes a tenth of the time
gc.set_threshold(100_000, 50, 100)

settings.register_profile("seeded", derandomize=True, deadline=None, max_examples=30)
settings.load_profile("seeded")

LONGEST = (
    "nbv/commands/test_cli.py", "nbv/commands/test_cli_scans.py", "robustness/test_bad_input.py",
    "completion/test_pipeline.py", "completion/evidence/test_reach.py", "completion/export/test_ifc.py",
    "completion/export/test_ifc_rules.py", "scenes/io/test_ifc_scenes.py", "completion/room/test_up.py",
    "nbv/commands/test_cli_register.py", "robustness/test_mutated_files.py", "docs/test_guides.py",
    "nbv/study/test_study.py", "completion/fitting/test_robust.py", "texture/test_pipeline.py",
    "nbv/commands/test_cli_part.py", "completion/edits/test_edits.py", "laws/test_house.py",
)  # fmt: skip
"""Files that take longest, from `pytest --durations=0`; two workers that begin with them end together."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the longest files first; the order within a file stays."""
    ranks = {ROOT / "tests" / name: rank for rank, name in enumerate(LONGEST)}
    items.sort(key=lambda item: ranks.get(item.path, len(LONGEST)))
