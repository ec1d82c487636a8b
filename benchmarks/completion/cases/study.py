# SPDX-License-Identifier: MIT
"""Study: which cases are evaluated, and the methods: modes of ours, modes without a cue, baselines."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from benchmarks.completion.cases.task import Method, Task
from benchmarks.completion.scenes.cases import Case
from benchmarks.completion.scenes.rooms import random_case
from completion.boundary.continuation import ALL_CUES, Cue
from completion.extension.extent import Mode
from completion.options import CompletionOptions
from nbv.scanning.effects.effects import named_effects
from nbv.scanning.sensors.sensor import PinholeSensor
from nbv.scanning.view import View
from scenes.checks import InputError
from scenes.pose import Pose
from scenes.world.builtin import builtin_scene

BENCH_CAMERA = PinholeSensor(
    fov_deg=math.degrees(2 * math.atan(320 / 525)), width=640, height=480, name="f = 525 px"
)
_OFFICE_EYES = (
    ((0.45, 0.6, 1.55), (3.7424, 2.75502, 0.83166)),
    ((0.71612, 0.51565, 1.72088), (4.00293, 2.72641, 1.16466)),
    ((0.24599, 0.65157, 1.7443), (3.4606, 2.83511, 0.79644)),
    ((0.33761, 0.43459, 1.35921), (3.53624, 2.7204, 0.62176)),
    ((0.65314, 0.71529, 1.37965), (3.91099, 3.0128, 1.05122)),
    ((0.53292, 0.89488, 1.30804), (3.99809, 2.73904, 0.53885)),
    ((0.73944, 0.32424, 1.32367), (3.50836, 3.11063, 0.56923)),
    ((0.53912, 0.58661, 1.55164), (3.79315, 2.64995, 0.47742)),
    ((0.6636, 0.67937, 1.32074), (3.95374, 2.73864, 0.35412)),
    ((0.47625, 0.80485, 1.70005), (3.67282, 2.87233, 0.47226)),
)  # of the benchmark's frames, and what is 4 m ahead of them


def office_cases(n: int = 10) -> list[Case]:
    """Return the office from ten places, each a case of its own."""
    scene = builtin_scene("office")
    views = [View(Pose.looking_at(eye, goal), BENCH_CAMERA) for eye, goal in _OFFICE_EYES[:n]]
    return [Case(f"office {index}", scene, (view,)) for index, view in enumerate(views)]


def generated_cases(n: int, first_seed: int = 0) -> list[Case]:
    """Return rooms with the seeds `first_seed` and following."""
    return [random_case(first_seed + index) for index in range(n)]


def tasks_of(cases: Sequence[Case], noise: str, methods: Mapping[str, Method], seed: int) -> list[Task]:
    """Return a task for each case, with a noise model by name and noise of its own.

    Raises
    ------
    InputError
        No noise model of that name.
    """
    effects = named_effects(noise)
    return [Task(case, methods, noise, effects, seed + 1000 * k) for k, case in enumerate(cases)]


def mode_methods(modes: Sequence[Mode]) -> dict[str, Method]:
    """Return our completion in some modes, by name."""
    return {mode: CompletionOptions(mode=mode, texture=False) for mode in modes}


def ablations() -> dict[str, CompletionOptions]:
    """Return our standard mode with one cue left out, by the cue's name."""
    standard = CompletionOptions(mode="standard", texture=False)
    return {
        str(cue): replace(standard, cues=tuple(other for other in ALL_CUES if other != cue)) for cue in Cue
    }


def ablation_methods(cues: Sequence[str]) -> dict[str, Method]:
    """Return the methods that leave out one of these cues each, by the names that reports use.

    Raises
    ------
    InputError
        No such cue.
    """
    known = ablations()
    for cue in cues:
        if cue not in known:
            raise InputError(f"{cue!r} is no cue that can be left out; there are {', '.join(known)}")
    return {without(cue): known[cue] for cue in cues}


def without(cue: str) -> str:
    """Return what reports call our standard mode without a cue."""
    return f"standard without {cue}"
