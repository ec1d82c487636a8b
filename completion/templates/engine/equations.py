# SPDX-License-Identifier: MIT
"""Equations: parameters that are held or equal leave the search; gates stay as its constraints."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from scenes.checks import FloatArray, InputError


@dataclass(frozen=True, slots=True)
class Gate:
    """A constraint that holds within a tolerance: |value| <= tolerance.

    Attributes
    ----------
    value : callable
        From parameters (k,) to what ought to be 0.
    tolerance : float
        How far from 0 it may be, in its own unit.
    """

    value: Callable[[FloatArray], float]
    tolerance: float

    def breach(self, x: FloatArray) -> float:
        """Return by how many tolerances parameters (k,) are outside the gate, 0 within."""
        return max(abs(float(self.value(x))) / self.tolerance - 1.0, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class Equations:
    """All k parameters from the m that are sought, each of these a number in 0..1 between its bounds.

    x = base + spread z, so that what is held, or equal, is so exactly.

    Attributes
    ----------
    base : (k,) float
        The parameters at z = 0.
    spread : (k, m) float
        What each of the sought adds to them.
    held : tuple of str
        Names of those that were given.
    """

    base: FloatArray
    spread: FloatArray
    held: tuple[str, ...]

    @property
    def n_sought(self) -> int:
        """How many are sought."""
        return int(self.spread.shape[1])

    def full(self, z: FloatArray) -> FloatArray:
        """Return the parameters (..., k) at z (..., m)."""
        return np.asarray(self.base + z @ self.spread.T)

    def sought(self, x: FloatArray) -> FloatArray:
        """Return z (..., m), within the bounds, nearest to parameters (..., k)."""
        return np.clip((x - self.base) @ np.linalg.pinv(self.spread).T, 0.0, 1.0)


def equations(
    names: Sequence[str],
    bounds: tuple[FloatArray, FloatArray],
    given: Mapping[str, float],
    equal: Sequence[tuple[str, ...]] = (),
) -> Equations:
    """Return what is left to be sought of parameters, of which some are given and some equal.

    Parameters
    ----------
    names : sequence of str
        Of the k parameters.
    bounds : pair of (k,) float
        Least and greatest values; those that are equal share what bounds they have in common.
    given : mapping
        Values held exactly, within the bounds or not.
    equal : sequence of tuple of str
        Names of parameters that are one; each stands in one tuple at most.

    Raises
    ------
    InputError
        A name that is none of the parameters, a value that is not finite, two values for one parameter,
        bounds that are not finite or leave nothing.
    """
    lower, upper = (np.asarray(side, dtype=np.float64) for side in bounds)
    _check_names(names, [*given, *(name for group in equal for name in group)])
    wrong = [name for name, value in given.items() if not np.isfinite(value)]
    if wrong:
        raise InputError(f"{wrong[0]} is given as {given[wrong[0]]}; give a finite number")
    shape = (len(names),)
    if lower.shape != shape or upper.shape != shape or not np.isfinite([lower, upper]).all():
        raise InputError(f"bounds must be finite, one pair for each of {len(names)} parameters")
    base, columns = np.zeros(len(names)), []
    grouped = {name for group in equal for name in group}
    for group in [*equal, *((name,) for name in names if name not in grouped)]:
        which = np.array([names.index(name) for name in group])
        values = {float(given[name]) for name in group if name in given}
        if len(values) > 1:
            raise InputError(f"{' and '.join(group)} are equal, but given as {sorted(values)}")
        least, greatest = float(lower[which].max()), float(upper[which].min())
        base[which] = next(iter(values), least)
        if values:
            continue
        if least > greatest:
            raise InputError(f"the bounds of {' and '.join(group)} leave nothing: {least} to {greatest}")
        column = np.zeros(len(names))
        column[which] = greatest - least
        columns.append(column)
    spread = np.column_stack(columns) if columns else np.zeros((len(names), 0))
    return Equations(base, spread, tuple(name for name in names if name in given))


def _check_names(names: Sequence[str], asked: Sequence[str]) -> None:
    unknown = [name for name in asked if name not in names]
    if unknown:
        raise InputError(f"there is no parameter {unknown[0]}; there are {', '.join(names)}")
