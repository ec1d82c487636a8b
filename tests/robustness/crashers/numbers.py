# SPDX-License-Identifier: MIT
"""Crashers whose numbers are none that can be: not finite, beyond any place, or of another type."""

from __future__ import annotations

import io
import json
from functools import partial
from typing import Any

import numpy as np

from tests.robustness.crashers.crasher import Crasher, replaced
from tests.robustness.fuzzing import seeds_of_scans, seeds_of_scenes
from tests.robustness.fuzzing.case import Case


def _arrays(case: Case, **changes: Any) -> Case:
    """An archive of arrays, some of them replaced."""
    with np.load(io.BytesIO(case.files[case.entry])) as arrays:
        held = {name: arrays[name] for name in arrays.files} | changes
    data = io.BytesIO()
    np.savez(data, **held)
    return case.changed(case.entry, data.getvalue())


def _scan(**changes: Any) -> Case:
    """A scan of ours whose header says other things."""
    case = seeds_of_scans.scan_files(".npz")[0]
    with np.load(io.BytesIO(case.files[case.entry])) as arrays:
        header = json.loads(str(arrays["header"]))
    for name, value in changes.items():
        header["projection" if name in header["projection"] else name] = (
            header["projection"] | {name: value} if name in header["projection"] else value
        )
    return _arrays(case, header=np.array(json.dumps(header)))


def _contradiction() -> Case:
    """A panorama whose ranges are not how far its points are."""
    case = seeds_of_scans.scan_files(".npz")[1]
    with np.load(io.BytesIO(case.files[case.entry])) as arrays:
        return _arrays(case, ranges=arrays["ranges"] * 2)


def _record(case: Case, *path: Any, value: Any) -> Case:
    """A JSON file with another value at a place."""
    content = json.loads(case.files[case.entry])
    holder = content
    for key in path[:-1]:
        holder = holder[key]
    holder[path[-1]] = value
    return case.changed(case.entry, json.dumps(content).encode())


def _deep_record(depth: int) -> Case:
    """What unseen complete wrote, with lists within objects within lists for its mode."""
    value: Any = 1
    for _ in range(depth):
        value = {"a": [value]}
    case = next(case for case in seeds_of_scenes.record_files() if case.entry == "completion.json")
    return _record(case, "mode", value=value)


def _far_pose() -> Case:
    return Case({"pose.txt": b"1e200 0 0 0 0 0 1\n"}, "pose.txt")


def _scaled_pose() -> Case:
    """A matrix of huge numbers, whose product with itself is not a number."""
    rows = "1e200 -1e200 0 0\n1e200 1e200 0 0\n0 0 1 0\n0 0 0 1\n"
    return Case({"t.log": f"0 0 1\n{rows}".encode()}, "t.log")


def _off(corner: str, more: str = "") -> Case:
    return Case({"m.off": f"OFF\n3 1 0\n0 0 0\n1 0 0\n{corner}\n3{more} 0 1 2\n".encode()}, "m.off")


def _ptx(old: bytes, new: bytes) -> Case:
    return replaced(seeds_of_scans.scan_files(".ptx")[1], old, new)


def _ptx_light() -> Case:
    """A return whose intensity is no number."""
    case = seeds_of_scans.scan_files(".ptx")[1]
    lines = case.files[case.entry].split(b"\n")
    k = next(k for k, line in enumerate(lines) if k > 10 and not line.startswith(b"0"))
    lines[k] = b" ".join([*lines[k].split()[:3], b"nan"])
    return case.changed(case.entry, b"\n".join(lines))


def _ptx_beside() -> Case:
    """Points of which one lies at the scanner's side, so that its slope is infinite."""
    case = seeds_of_scans.scan_files(".ptx")[0]
    lines = case.files[case.entry].split(b"\n")
    k = next(k for k, line in enumerate(lines) if k > 10 and not line.startswith(b"0"))
    lines[k] = b" ".join([b"1e-320", *lines[k].split()[1:]])
    return case.changed(case.entry, b"\n".join(lines))


_plan, _edits = (lambda: seeds_of_scenes.plan_files()[0]), (lambda: seeds_of_scenes.edit_files()[0])
_candidates = lambda: seeds_of_scenes.candidate_files()[0]  # noqa: E731
_sensor = lambda: seeds_of_scenes.sensor_files()[0]  # noqa: E731


def _toml(line: str) -> Case:
    case = _sensor()
    return case.changed(case.entry, b"\n".join([line.encode(), case.files[case.entry]]))


NUMBERS = (
    Crasher("info", "deep JSON was shown by recursion", lambda: _deep_record(50), ""),
    Crasher(
        "info",
        "deeper JSON too, without an error of ours",
        lambda: _deep_record(400),
        "maximum recursion depth",
    ),
    Crasher("scan ptx", "warnings: a line through an infinite slope is none", _ptx_beside, ""),
    Crasher("scan npz", "rays of length NaN", partial(_scan, fx=1e-320), "focal lengths must be in"),
    Crasher(
        "scan npz", "rays of another length than one", _contradiction, "not as far away as their ranges say"
    ),
    Crasher("poses", "a place beyond any number", _far_pose, "pose 1 is not usable: poses reach 1e"),
    Crasher(
        "poses", "inf - inf passed as orthonormal", _scaled_pose, "pose 1 is not usable: pose is not rigid"
    ),
    Crasher("mesh off", "areas that overflow", lambda: _off("0 1e300 0"), "vertices reach 1e"),
    Crasher("mesh off", "a message of 5000 digits", lambda: _off("0 1 0", "9" * 3000), "line 6 announces"),
    Crasher(
        "scan ptx", "an intensity that is no number", _ptx_light, "intensities of returns are not finite"
    ),
    Crasher(
        "plan json",
        "texts as areas",
        lambda: _record(_plan(), "coverage", "met", value="all"),
        "met must be a number",
    ),
    Crasher(
        "plan json",
        "lists as gains",
        lambda: _record(_plan(), "views", 0, "gain_m2", value=[1]),
        "gain_m2 must be a num",
    ),
    Crasher(
        "plan json",
        "null as an area",
        lambda: _record(_plan(), "coverage", "met", value=None),
        "met must be a number",
    ),
    Crasher(
        "edits json",
        "a kind of surface that is no text",
        lambda: _record(_edits(), "surfaces", 0, "kind", value=[1]),
        'the "kind" of a surface is a text',
    ),
    Crasher(
        "candidates npz",
        "patches without normals",
        lambda: _arrays(_candidates(), patch_normals=np.ones((3, 3))),
        "20 patch_points need as many patch_normals, got 3",
    ),
)
