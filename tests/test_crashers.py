# SPDX-License-Identifier: MIT
"""What fuzzing found stays mended: every file of `tests/crashers` is refused in one line, or read."""

import re
import time
from pathlib import Path

import pytest

from tests.crashers import CRASHERS
from tests.crashers.crasher import Crasher
from tests.fuzzing.targets import TARGETS
from tests.fuzzing.trial import attempt


@pytest.mark.parametrize("crasher", CRASHERS, ids=lambda one: f"{one.target}: {one.was}")
def test_what_was_found_is_mended(crasher: Crasher, tmp_path: Path) -> None:
    begun = time.monotonic()
    outcome = attempt(TARGETS[crasher.target], crasher.make(), tmp_path)
    assert time.monotonic() - begun < 5
    assert outcome.kind == ("refused" if crasher.says else "read"), outcome
    assert re.search(crasher.says, outcome.text), outcome.text
