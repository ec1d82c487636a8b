# SPDX-License-Identifier: MIT
"""Sweep scenes scanned with few pixels, for the tests of the evaluation."""

from dataclasses import replace

from benchmarks.cases.rooms import Case
from benchmarks.cases.sweeps import column_case
from nbv.scanning.sensor import PinholeSensor, View

FEW = PinholeSensor(fov_deg=62.7, width=160, height=120, max_range_m=12.0)


def with_few_pixels(case: Case) -> Case:
    views = tuple(View(view.world_from_sensor, FEW) for view in case.views)
    return replace(case, views=views)


def small_column(arc_deg: float, seed: int = 0) -> Case:
    return with_few_pixels(column_case(arc_deg, seed))
