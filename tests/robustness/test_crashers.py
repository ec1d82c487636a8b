# SPDX-License-Identifier: MIT
"""What fuzzing found stays mended: each file of `tests.robustness.crashers` is refused in a line, or read."""

import re
from pathlib import Path

import pytest

from tests.robustness.crashers import CRASHERS
from tests.robustness.crashers.crasher import Crasher
from tests.robustness.fuzzing.targets import TARGETS
from tests.robustness.fuzzing.trial import attempt


@pytest.mark.parametrize("crasher", CRASHERS, ids=lambda one: f"{one.target}: {one.was}")
def test_what_was_found_is_mended(crasher: Crasher, tmp_path: Path) -> None:
    outcome = attempt(TARGETS[crasher.target], crasher.make(), tmp_path)
    assert outcome.kind == ("refused" if crasher.says else "read"), outcome
    assert re.search(crasher.says, outcome.text), outcome.text
