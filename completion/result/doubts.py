# SPDX-License-Identifier: MIT
"""Doubts: in plain words, what a reader should know before trusting a completion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from completion.extension.patch import Patch
from completion.observe.observation import Observation

_ROUGH_M = 0.01  # root mean square from which residuals are centimetres
_TIMES = 3.0  # the range noise, beyond which it does not explain them
_NAMED = 5  # surfaces that are named; more are counted
_FEW_PX = 1000  # of a surface that are looked at


def doubts_of(observations: Sequence[Observation], patches: Sequence[Patch]) -> tuple[str, ...]:
    """Return what was left out of the scans or assumed, with each scan's name, and what came out doubtful.

    Steps between ranges that are wider than their noise; surfaces that their own points do not lie on, by
    centimetres and several times the noise.
    """
    told = [f"{seen.scan.name}: {text}" for seen in observations for text in _of_scan(seen)]
    rough = [
        (number, patch, times)
        for number, patch in enumerate(patches, start=1)
        if patch.source.fit.rms >= _ROUGH_M and (times := _times_noise(patch, observations)) >= _TIMES
    ]
    return (*told, *([_rough_text(rough)] if rough else []))


def _of_scan(seen: Observation) -> tuple[str, ...]:
    step = seen.noise.step_m
    if step == 0:
        return seen.scan.warnings
    text = (
        f"its ranges come in steps of {1000 * step:.3g} mm, which hide the noise: surfaces are no more exact "
        "than the steps; if the file was rounded, take the original"
    )
    return (*seen.scan.warnings, text)


def _times_noise(patch: Patch, observations: Sequence[Observation]) -> float:
    """How many times the range noise of its pixels a surface's residuals are."""
    squares = [np.zeros(0)]
    for seen, pixels in zip(observations, patch.source.pixels, strict=True):
        some = pixels.flat[:: max(1, len(pixels.flat) // _FEW_PX)]
        squares.append(np.square(seen.noise.sigma(seen.scan.ranges.ravel()[some])))
    known = np.concatenate(squares)
    noise = float(np.sqrt(known.mean())) if len(known) else 0.0
    return patch.source.fit.rms / noise if noise > 0 else np.inf


def _rough_text(rough: Sequence[tuple[int, Patch, float]]) -> str:
    largest = sorted(rough, key=lambda one: -one[1].observed_m2)[:_NAMED]
    named = ", ".join(_name(*one) for one in largest)
    more = f" and {len(rough) - _NAMED} more" if len(rough) > _NAMED else ""
    return (
        "points lie centimetres off their surface (rms), far more than the range noise: surface "
        f"{named}{more}; is it bent or rough, or are the poses of several scans off (--registration)?"
    )


def _name(number: int, patch: Patch, times: float) -> str:
    noise = f", {times:.0f} times the noise" if times < np.inf else ""
    kind, area = patch.grid.surface.kind, patch.observed_m2
    return f"{number} ({kind}, {area:.2g} m2, {1000 * patch.source.fit.rms:.0f} mm{noise})"
