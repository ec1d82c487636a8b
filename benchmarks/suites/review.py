# SPDX-License-Identifier: MIT
"""Review: ten corrections of real scans, the clicks, seconds and CPU until each consequence shows.

At the end the outputs are saved, and compared with those of `unseen complete --edits` of the same statements.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from benchmarks.cases.frames import DATA
from benchmarks.run import head, row, suite
from completion.result.completion import Completion
from nbv.commands.complete import run_complete
from nbv.commands.options.scans import CompleteOptions
from nbv.commands.options.shared import ReadOptions, Shared
from nbv.commands.process import start_run
from nbv.commands.review import EDITS, open_session, restored, save
from nbv.report.review.asking import rectangle, snaps_at
from nbv.report.review.session import ReviewSession, Statement
from nbv.report.review.view import first_view, view_after
from nbv.report.viewer.encoding import encode_view
from scenes.checks import FloatArray, InputError
from scenes.surfaces.plane import Plane

_SCANS: dict[str, tuple[str, ReadOptions]] = {
    "office1": ("range/pcl/office1.pcd", ReadOptions()),
    "pcl_room": ("range/pcl_room/room_scan1.pcd", ReadOptions(origins=((0.0, 0.0, 0.0),))),
}
_NOT_SAME = ("manifest.json", "report.html")  # they hold times and the names of files


def _number(completion: Completion, rank: int) -> int:
    """Number of the surface with the `rank`-th most inferred area."""
    return 1 + int(np.argsort([-patch.hypothesised_m2 for patch in completion.patches])[rank])


def _surface(completion: Completion, number: int) -> FloatArray:
    return completion.anchor(number)


def _reject(rank: int) -> Callable[[Completion], Statement]:
    def said(completion: Completion) -> Statement:
        return {"do": "reject", "surface": _surface(completion, _number(completion, rank)).tolist()}

    return said


def _accept(completion: Completion) -> Statement:
    return {"do": "accept", "surface": _surface(completion, _number(completion, 2)).tolist()}


def _planes(completion: Completion) -> list[tuple[int, FloatArray]]:
    """Numbers and normals of the planes, the most measured first."""
    found = []
    for k in np.argsort([-patch.observed_m2 for patch in completion.patches]).tolist():
        surface = completion.patches[k].grid.surface
        if isinstance(surface, Plane):
            found.append((k + 1, surface.normal_direction))
    return found


def _cut(action: str) -> Callable[[Completion], Statement]:
    def said(completion: Completion) -> Statement:
        number = _planes(completion)[1][0]
        place = _surface(completion, number)
        upright = snaps_at(completion, number, place)[-1].cut
        return {"do": action, "surface": place.tolist(), **upright}

    return said


def _door(completion: Completion) -> Statement:
    number = _planes(completion)[0][0]
    place = _surface(completion, number)
    plane = completion.patches[number - 1].grid.surface
    across = completion.world_from_reference.rotate(
        plane.from_uv(np.array([[0.9, 2.0]])) - plane.from_uv(np.zeros((1, 2)))
    )
    outline = rectangle(completion, number, np.stack([place, place + across[0]]))
    return {"do": "opening", "surface": place.tolist(), "outline": outline.tolist()}


def _pair(kind: str, cosine: Callable[[float], bool]) -> Callable[[Completion], Statement]:
    def said(completion: Completion) -> Statement:
        planes = _planes(completion)
        first, second = next(
            (one, two)
            for k, two in enumerate(planes)
            for one in planes[:k]
            if cosine(abs(float(one[1] @ two[1])))
        )
        places = [_surface(completion, one[0]).tolist() for one in (first, second)]
        return {"type": kind, "surfaces": places}

    return said


_TEN: tuple[tuple[str, int, Callable[[Completion], Statement]], ...] = (  # name, clicks up to its consequence
    ("reject an inferred patch", 2, _reject(0)),
    ("reject another", 2, _reject(1)),
    ("end a wall by hand", 3, _cut("end")),
    ("draw a door", 4, _door),
    ("accept what is hidden", 2, _accept),
    ("state: perpendicular", 6, _pair("perpendicular", lambda cosine: cosine < 0.2)),
    ("state: parallel", 5, _pair("parallel", lambda cosine: cosine > 0.97)),
    ("state: parallel, of two at an angle", 5, _pair("parallel", lambda cosine: cosine < 0.5)),
    ("split a wall", 3, _cut("split")),
    ("merge what was split", 4, lambda completion: _halves(completion)),
)


def _halves(completion: Completion) -> Statement:
    """Merge two surfaces in one plane, as a split leaves them."""
    split = [k for k, patch in enumerate(completion.patches, start=1) if "split" in patch.verdict.actions]
    return {"do": "merge", "surfaces": [_surface(completion, k).tolist() for k in split[:2]]}


def _ten(session: ReviewSession) -> Iterator[str]:
    """Say ten things, each on what those before came to; a row each."""
    start = time.process_time()
    first = first_view(session.completion)
    yield f"first view: {time.process_time() - start:.1f} s of CPU"
    yield ""
    yield from head("statement", "clicks", "s", "CPU s", "inferred m2", "what came of it")
    for name, clicks, make in _TEN:
        try:
            statement = make(session.completion)
        except (StopIteration, InputError) as error:
            yield row(name, clicks, "-", "-", "-", str(error) or "no such surfaces here")
            continue
        wall, cpu = time.perf_counter(), time.process_time()
        try:
            found = session.try_out(statement)
            encode_view(view_after(first, session.tried[1] if session.tried else session.completion))
            spent = time.perf_counter() - wall, time.process_time() - cpu
            told = " ".join(found.sentences)
            change = f"{found.inferred_m2[0]:.2f} -> {found.inferred_m2[1]:.2f}"
            if not ("type" in statement and found.is_refused):
                session.take(statement)
        except InputError as error:
            spent, told, change = (time.perf_counter() - wall, time.process_time() - cpu), str(error), "-"
        yield row(name, clicks, f"{spent[0]:.1f}", f"{spent[1]:.1f}", change, told)


def _differing(one: Path, other: Path) -> list[str]:
    """Names of files that differ between two output folders."""
    names = {file.relative_to(folder).as_posix() for folder in (one, other) for file in folder.rglob("*")}
    names = {name for name in names if not name.startswith(".") and name not in (EDITS, *_NOT_SAME)}
    files = [name for name in names if (one / name).is_file() or (other / name).is_file()]

    def data(file: Path) -> bytes:
        return file.read_bytes() if file.exists() else b""

    return sorted(name for name in files if data(one / name) != data(other / name))


@suite("review", smallest="--scan office1")
def review(scan: str = "") -> Iterator[str]:
    """Ten corrections on office1 and on pcl_room: clicks, seconds, CPU; saved outputs against `--edits`."""
    for name in [scan] if scan else _SCANS:
        path, read = _SCANS[name]
        asked = CompleteOptions(scans=(str(DATA / path),), read=read, search="off")
        with TemporaryDirectory() as made:
            folder, alone = Path(made) / "reviewed", Path(made) / "alone"
            quiet = Shared(out=folder, quiet=True, threads=2)
            run_complete(quiet, asked)
            how = restored(folder)
            with start_run("review", quiet, default="", is_folder=True, writes=False) as run:
                session = open_session(run, quiet, how, folder)
            yield f"{name}: {len(session.completion.patches)} surfaces"
            yield from _ten(session)
            yield ""
            save(quiet, how, session, folder)
            kept: dict[str, Any] = {"edits": str(folder / EDITS), "relations": str(folder / EDITS)}
            run_complete(replace(quiet, out=alone), replace(asked, **kept))
            apart = _differing(folder, alone)
            yield f"saved outputs that differ from those of --edits: {', '.join(apart) or 'none'}"
            yield ""
