# SPDX-License-Identifier: MIT
"""Crashers: the smallest files for what fuzzing found, made by functions, each with what was wrong."""

from tests.robustness.crashers.crasher import Crasher
from tests.robustness.crashers.numbers import NUMBERS
from tests.robustness.crashers.structures import STRUCTURES

CRASHERS: tuple[Crasher, ...] = (*STRUCTURES, *NUMBERS)
