# SPDX-License-Identifier: MIT
"""Stairs: a straight flight of equal steps, from levels at equal rises whose middles move on equally."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from completion.templates.engine.measured import Measured
from completion.templates.solids.upright import Upright, UprightSample, levels
from scenes.checks import FloatArray, IntArray

_LEAST_STEPS = 3
_LEAST_SHARE = 0.01  # of the flat points, on a level
_SAME = 0.12  # of a rise: how far a level may be from where the row has it
_SIDES = (2.0, 98.0)  # percentiles of points across that a flight's width spans


class Stairs:
    """A straight flight of n treads and the n risers before them, without sides.

    Parameters: heading (of the way up), forward and height (of the nose of the first tread, along the way
    and up), going, rise; in an upright frame.
    """

    kind = "stairs"
    names = ("heading", "forward", "height", "going", "rise")

    def __init__(self, frame: Upright, count: int, about: FloatArray) -> None:
        self.frame, self.count, self.about = frame, count, about
        numbers = range(1, count + 1)
        self.faces = (*(f"tread {k}" for k in numbers), *(f"riser {k}" for k in numbers))

    def bounds(self, measured: Measured) -> tuple[FloatArray, FloatArray]:
        """Return (5,) and (5,): a step round what structure says; steps longer than the spacing of points."""
        _, _, _, going, rise = self.about
        reach = np.array([np.pi / 6, going, rise, 0.4 * going, 0.3 * rise])
        lower = self.about - reach
        lower[3:] = np.maximum(lower[3:], np.minimum(measured.spacing, self.about[3:]))
        return lower, self.about + reach

    def distance(self, points: FloatArray, x: FloatArray) -> tuple[FloatArray, IntArray]:
        """Return the distance of points (n, 3) from the nearest tread or riser (n,), and its number (n,)."""
        heading, forward, height, going, rise = x
        local = self.frame.local(points)
        along = local[:, :2] @ [np.cos(heading), np.sin(heading)] - forward
        up = local[:, 2] - height
        near = np.round((along / going + up / rise) / 2).astype(np.int64)
        step = np.clip(near[:, None] + np.arange(-1, 2), 0, self.count - 1)
        u, v = along[:, None] - step * going, up[:, None] - step * rise
        each = np.hstack([np.hypot(v, u - np.clip(u, 0.0, going)), np.hypot(u, v - np.clip(v, -rise, 0.0))])
        numbers = np.hstack([step + 1, step + 1 + self.count])
        best = each.argmin(axis=1)[:, None]
        return np.take_along_axis(each, best, 1)[:, 0], np.take_along_axis(numbers, best, 1)[:, 0]


class Flight(NamedTuple):
    """Where structure sees a flight, in an upright frame."""

    x: FloatArray  # (5,) as the template's
    n_steps: int
    sides: FloatArray  # (2,) least and greatest place across the way


def find_flight(local: FloatArray, measured: Measured, given: dict[str, float]) -> Flight | str:
    """Return the flight that most levels among points (n, 3) of an upright frame belong to, or why none is.

    Levels are where flat points gather; the rise is that of the longest row of levels, less those it misses;
    the way and the going are how the middles of these levels move on.
    """
    flat = UprightSample.of(local).flat
    width = max(2 * measured.noise, 0.35 * measured.spacing, 1e-4 * measured.diagonal)
    heights = levels(flat[:, 2], width, max(12, round(_LEAST_SHARE * len(flat))))
    row = _longest_row(heights, width, given.get("rise"))
    if len(row) < _LEAST_STEPS:
        return f"{len(heights)} levels, of which {len(row)} rise equally; a flight has {_LEAST_STEPS}"
    rise = given.get("rise", float(np.median(np.diff(heights[row[:, 0]]) / np.diff(row[:, 1]))))
    on = [flat[np.abs(flat[:, 2] - heights[k]) < 1.5 * width] for k, _ in row]
    middles = np.array([np.median(one[:, :2], axis=0) for one in on])
    move = np.median(np.diff(middles, axis=0) / np.diff(row[:, 1])[:, None], axis=0)
    going = given.get("going", float(np.linalg.norm(move)))
    if going < 2 * width:
        return f"{len(row)} levels rise equally by {rise:.3g}, but lie above each other"
    way = move / max(float(np.linalg.norm(move)), 1e-12)
    first = float(np.median(middles @ way - row[:, 1] * going)) - going / 2
    height = float(np.median(heights[row[:, 0]] - row[:, 1] * rise))
    across = np.concatenate(on)[:, :2] @ [-way[1], way[0]]
    x = np.array([np.arctan2(way[1], way[0]), first, height, going, rise])
    return Flight(x, int(row[-1, 1]) + 1, np.percentile(across, _SIDES))


def trimmed(flight: Flight, x: FloatArray, seen: list[int]) -> Flight:
    """Return the flight from the first to the last step that was seen, with parameters x (5,) of before."""
    first, last = min(seen), max(seen)
    moved = x + first * np.array([0.0, x[3], x[4], 0.0, 0.0])
    return Flight(moved, last - first + 1, flight.sides)


def _longest_row(heights: FloatArray, width: float, rise: float | None) -> IntArray:
    """Level and step (m, 2) of the row with the most levels less misses; two misses in turn end it."""
    best, most = np.zeros((0, 2), dtype=np.int64), 0
    for i in range(len(heights)):
        for r in [rise] if rise else heights[i + 1 :] - heights[i]:
            row, missed, step = [(i, 0)], 0, 0
            while missed - (row[-1][1] - len(row) + 1) < 2 and len(heights):
                step += 1
                k = int(np.argmin(np.abs(heights - heights[i] - step * r)))
                if abs(heights[k] - heights[i] - step * r) < max(_SAME * r, width):
                    row.append((k, step))
                elif step - row[-1][1] >= 2:
                    break
            missed = row[-1][1] + 1 - len(row)
            if len(row) - missed > most:
                best, most = np.array(row), len(row) - missed
    return best
