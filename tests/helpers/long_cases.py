# SPDX-License-Identifier: MIT
"""Cases of a law: the first stay in the gate, the others are long."""

from collections.abc import Iterable
from typing import Any

import pytest


def first_in_gate(n_quick: int, cases: Iterable[Any]) -> list[Any]:
    """Cases for `parametrize`: all but the first `n_quick` carry the marker `long`.

    A tuple holds the values of several arguments.
    """
    listed = list(cases)
    long = []
    for case in listed[n_quick:]:
        values, name = (
            (case.values, case.id) if hasattr(case, "values") and hasattr(case, "id") else (case, None)
        )
        long.append(
            pytest.param(
                *(values if isinstance(values, tuple) else (values,)), id=name, marks=pytest.mark.long
            )
        )
    return [*listed[:n_quick], *long]
