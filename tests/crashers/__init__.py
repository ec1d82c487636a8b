# SPDX-License-Identifier: MIT
"""Crashers: the smallest files for what fuzzing found, made by functions, each with what was wrong."""

from tests.crashers.crasher import Crasher
from tests.crashers.numbers import NUMBERS
from tests.crashers.structures import STRUCTURES

CRASHERS: tuple[Crasher, ...] = (*STRUCTURES, *NUMBERS)
