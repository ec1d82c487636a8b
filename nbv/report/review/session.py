# SPDX-License-Identifier: MIT
"""Review session: what a person says of a completion, one statement after the other, and what follows.

A statement is an edit or a relation as `--edits` and `--relations` read them. It is tried first: the
completion is made again from the surfaces of the scans, which no statement changes, and compared with the one
before. What is taken is kept in a file at once, so that a server that was killed goes on where it was.
"""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from hashlib import sha256
from io import BytesIO
from os import PathLike
from pathlib import Path
from typing import Any, TypeVar

from completion.edits.file import edit_record, edits_of
from completion.extension.bounded import BoundedSurfaces
from completion.merging.scan_surfaces import ScanSurfaces, find_surfaces
from completion.options import CompletionOptions
from completion.pipeline import bound_surfaces, complete_surfaces
from completion.relations.relation import relation_record, scan_relations_of
from completion.result.completion import Completion
from nbv.report.review.consequence import Consequence, compare
from scenes.checks import InputError
from scenes.io.checks.documents import read_json
from scenes.io.checks.guard import guard_reading
from scenes.pose import Pose
from scenes.run.atomic import write_json
from scenes.run.journal import NO_JOURNAL, Journal, pack
from scenes.run.steps import Progress, Steps
from scenes.scan.range_image import RangeImage

Statement = Mapping[str, Any]
_Held = TypeVar("_Held")
_SHAPING = ("merge", "split")  # edits that make other surfaces
_KEPT = 6  # completions that are kept, so that undo and redo show at once


def document_of(said: Sequence[Statement]) -> dict[str, Any]:
    """Return the file that `--edits` and `--relations` read, of statements in order."""
    return {
        "edits": [dict(one) for one in said if "do" in one],
        "relations": [dict(one) for one in said if "do" not in one],
    }


@dataclass(slots=True, eq=False)
class ReviewSession:
    """What is said of a completion, and what it is by now.

    Attributes
    ----------
    surfaces : ScanSurfaces
        What the scans show, working frame; statements do not change it.
    world_from_reference : Pose
        From the working frame to the world.
    options : CompletionOptions
        Those that the completion was made with, without its edits and without texture.
    file : Path
        Where the history is kept.
    said : list of Statement
        What holds, in order.
    undone : list of Statement
        What was taken back, the last one last.
    n_threads : int, optional
        Threads; results do not depend on it.
    """

    surfaces: ScanSurfaces
    world_from_reference: Pose
    options: CompletionOptions
    file: Path
    said: list[Statement] = field(default_factory=list)
    undone: list[Statement] = field(default_factory=list)
    n_threads: int | None = None
    version: int = 0
    tried: tuple[Statement, Completion] | None = None
    _known: dict[str, Completion] = field(default_factory=dict)
    _bounded: dict[str, BoundedSurfaces] = field(default_factory=dict)
    _extended: _Extended = field(default_factory=lambda: _Extended())
    _lock: threading.RLock = field(default_factory=threading.RLock)

    def __post_init__(self) -> None:
        """Go on with the history of an earlier session, if there is one."""
        if self.file.exists():
            with guard_reading(self.file, "the history of a review (JSON); move it away to begin anew"):
                held = read_json(self.file, dict)
                self.said, self.undone = (_statements(held[name]) for name in ("said", "undone"))

    @property
    def completion(self) -> Completion:
        """The completion as all that was said makes it."""
        with self._lock:
            return self._completed(self.said)

    def try_out(self, statement: Statement) -> Consequence:
        """Return what follows from a statement, which is not taken yet.

        Raises
        ------
        InputError
            It cannot be meant so: no such surface, a line off the surface, a relation of too few surfaces.
        """
        with self._lock:
            start = time.perf_counter()
            before = self.completion
            after = self._completed([*self.said, statement])
            self.tried = statement, after
            found = compare(before, after, statement)
            return replace(found, seconds=time.perf_counter() - start)

    def take(self, statement: Statement) -> None:
        """Take a statement: it holds from now on. Raises InputError as `try_out` does."""
        with self._lock:
            self._completed([*self.said, statement])
            self._become([*self.said, statement], [])

    def undo(self) -> None:
        """Take the last statement back. Raises InputError: there is none."""
        with self._lock:
            if not self.said:
                raise InputError("nothing to undo: there is no correction yet")
            self._become(self.said[:-1], [*self.undone, self.said[-1]])

    def redo(self) -> None:
        """Let hold again what was taken back last. Raises InputError: nothing was."""
        with self._lock:
            if not self.undone:
                raise InputError("nothing to redo: nothing was undone")
            self._become([*self.said, self.undone[-1]], self.undone[:-1])

    def _become(self, said: Sequence[Statement], undone: Sequence[Statement]) -> None:
        write_json(self.file, {"said": [*said], "undone": [*undone]})
        self.said, self.undone, self.tried = list(said), list(undone), None
        self.version += 1

    def _completed(self, said: Sequence[Statement]) -> Completion:
        key = json.dumps(document_of(said), sort_keys=True)
        if key not in self._known:
            document = document_of(said)
            stated = (*self.options.stated_relations, *scan_relations_of(document, "what you said"))
            edits = edits_of(document, "what you said")
            options = replace(self.options, edits=edits, stated_relations=stated)
            sizes = [seen.scan.ranges.size for seen in self.surfaces.observations]
            with Steps.over(sizes, self.n_threads, None, NO_JOURNAL) as steps:
                bounded = self._bound(document, options, steps)
                journal = self._extended.of(bounded)
                made = complete_surfaces(
                    self.surfaces, self.world_from_reference, options, replace(steps, journal=journal),
                    seed=0, bounded=bounded,
                )  # fmt: skip
            _remember(self._known, key, made)
        return self._known[key]

    def _bound(
        self, document: Mapping[str, Any], options: CompletionOptions, steps: Steps
    ) -> BoundedSurfaces:
        """What is known before surfaces are continued: anew only where surfaces or relations are others."""
        key = _shape_of(document)
        if key not in self._bounded:
            found = bound_surfaces(self.surfaces, self.world_from_reference, options, steps)
            _remember(self._bounded, key, found)
        return self._bounded[key].restated(options.edits, self.world_from_reference)


def open_scans(
    scans: Sequence[RangeImage],
    options: CompletionOptions,
    file: str | PathLike[str],
    *,
    n_threads: int | None = None,
    journal: Journal = NO_JOURNAL,
    progress: Progress | None = None,
) -> ReviewSession:
    """Return a session on scans; its history goes on where the file has one.

    Parameters
    ----------
    scans : sequence of RangeImage
        As `complete` takes them.
    options : CompletionOptions
        Of the completion; edits and stated relations are statements, texture and flattening are left out.
    file : str or path
        Where the history is kept.
    n_threads : int, optional
        Threads; results do not depend on it.
    journal : Journal
        Remembers the surfaces of the scans.
    progress : callable, optional
        Called with a stage's name, steps done and steps in all.
    """
    plain = replace(options, edits=(), stated_relations=(), texture=False, flattening=None)
    with Steps.over([scan.ranges.size for scan in scans], n_threads, progress, journal) as steps:
        surfaces = find_surfaces(list(scans), plain.of_surfaces, steps)
    history = Path(file)
    first = [*map(edit_record, options.edits), *map(relation_record, options.stated_relations)]
    if first and not history.exists():
        write_json(history, {"said": first, "undone": []})
    return ReviewSession(surfaces, scans[0].world_from_sensor, plain, history, n_threads=n_threads)


def _shape_of(document: Mapping[str, Any]) -> str:
    """What of a document makes other surfaces, or moves them."""
    shaping = [one for one in document["edits"] if one.get("do") in _SHAPING]
    return json.dumps([shaping, document["relations"]], sort_keys=True)


@dataclass(slots=True, eq=False)
class _Extended:
    """Surfaces as they were continued before: one is continued anew only where its own edits are others.

    It is a journal of steps in memory; `keys` are those of the surfaces that are continued now.
    """

    known: dict[str, Any] = field(default_factory=dict)
    keys: list[str] = field(default_factory=list)
    before: list[list[str]] = field(default_factory=list)

    def of(self, bounded: BoundedSurfaces) -> _Extended:
        """Return it for these surfaces; forget what the last few completions had no use for.

        How far one goes depends on all of them, as they were fitted and moved, and on its own edits.
        """
        related = bounded.related
        every = _digest(([one.surface for one in related.surfaces], related.stated, bounded.features))
        self.keys = [f"{k} {_digest(one.edits)} {every}" for k, one in enumerate(related.surfaces)]
        self.before = [*self.before[1 - _KEPT :], self.keys]
        used = {key for keys in self.before for key in keys}
        self.known = {key: value for key, value in self.known.items() if key in used}
        return self

    def step(self, name: str, work: Callable[[], _Held]) -> _Held:
        """Return what a step came to; all but those of single surfaces are done."""
        stage, _, number = name.rpartition("-")
        if stage != "extend":
            return work()
        key = self.keys[int(number) - 1]
        if key not in self.known:
            self.known[key] = work()
        held: _Held = self.known[key]
        return held

    def turn(self, n_steps: int) -> Sequence[int]:  # noqa: ARG002 - nobody else does any
        """Return nothing."""
        return ()

    def offer(self, name: str, work: Callable[[], object]) -> None:
        """Do nothing: `step` will."""


def _statements(held: object) -> list[Statement]:
    if not isinstance(held, list) or not all(isinstance(one, dict) for one in held):
        raise InputError("what was said is a list of objects")
    return held


def _digest(value: object) -> str:
    held = BytesIO()
    pack(value, held)
    return sha256(held.getvalue()).hexdigest()


def _remember(known: dict[str, _Held], key: str, value: _Held) -> None:
    known[key] = value
    while len(known) > _KEPT:
        known.pop(next(iter(known)))
