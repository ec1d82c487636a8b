# SPDX-License-Identifier: MIT
"""What holds for all tests: reports are drawn small and packed quickly, which is most of what they cost."""

from collections.abc import Iterator

import pytest

from nbv.report.blocks import scan_coverage_blocks, state_pictures
from nbv.report.figures import plots
from nbv.report.pictures import completion_shots, picture


@pytest.fixture(autouse=True, scope="session")
def small_reports() -> Iterator[None]:
    """Pictures half as wide, plots with half the dots, PNG without zlib's highest level."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(picture, "_PNG_LEVEL", 1)
        patch.setattr(plots, "_DPI", 90)
        for module in (completion_shots, scan_coverage_blocks, state_pictures):
            patch.setattr(module, "_WIDTH", 380)
        yield
