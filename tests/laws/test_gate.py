# SPDX-License-Identifier: MIT
"""The gate: what `make test` puts first is there."""

from tests.conftest import LONGEST
from tests.helpers.data_paths import ROOT


def test_the_longest_files_are_there() -> None:
    assert [name for name in LONGEST if not (ROOT / "tests" / name).is_file()] == []
