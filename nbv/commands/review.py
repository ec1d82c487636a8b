# SPDX-License-Identifier: MIT
"""`unseen review`: a page on this machine to correct a finished completion, and to see what follows."""

from __future__ import annotations

import json
import sys
import webbrowser
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, redirect_stdout
from dataclasses import fields, replace
from io import StringIO
from pathlib import Path
from typing import Any

import typer

from completion.observe.tiles import solve_plane
from nbv.commands.complete import completion_options, load_scans, run_complete
from nbv.commands.options.scans import CompleteOptions, ReviewOptions
from nbv.commands.options.shared import ReadOptions, Shared
from nbv.commands.process import Run, start_run
from nbv.report.review.server import ReviewServer
from nbv.report.review.session import ReviewSession, document_of, open_scans
from nbv.run.manifest import read_inputs
from nbv.scanning.sensor_profile import load_sensor
from scenes.checks import InputError
from scenes.io.checks.documents import read_json
from scenes.io.checks.guard import guard_reading
from scenes.run.atomic import make_folder, write_json
from scenes.run.journal import FileJournal

EDITS = "edits.json"
"""What was said, in the folder of the outputs: `--edits` and `--relations` of `complete` read it."""
_OWN = ".review"  # folder of history and journal in that of the outputs
_FILES = ("poses", "trajectory", "edits", "relations", "features")  # in the manifest's order, after the scans
_WORDS = ("auto", "off", None)  # what they are where they are no files


def run_review(shared: Shared, asked: ReviewOptions) -> None:
    """Serve the page until interrupted."""
    with start_run("review", shared, default=".", is_folder=True, writes=False) as run:
        folder = Path(asked.folder)
        run.watch.enter("load")
        how = restored(folder)
        session = open_session(run, shared, how, folder)
        server = ReviewServer(
            session,
            how.request().title,
            load_sensor(asked.sensor),
            lambda: save(shared, how, session, folder),
        )
        http = server.listen(asked.port)
        address = server.address(http.port)
        run.watch.enter("")
        run.say({"address": address, "statements": len(session.said)}, [f"open {address}", "end with Ctrl-C"])
        sys.stdout.flush()
        if asked.open == "yes":
            webbrowser.open(address)
        try:
            http.serve_forever()
        finally:
            http.server_close()


def restored(folder: Path) -> CompleteOptions:
    """Return the options that a finished completion was made with, files where its manifest names them.

    Raises
    ------
    InputError
        No finished completion is there, a file has changed since, or is no longer where it was.
    """
    file = folder / "manifest.json"
    if not file.is_file():
        raise InputError(f"{folder}: holds no finished completion; run `unseen complete SCAN -o {folder}`")
    with guard_reading(file, "a manifest of `unseen complete` (JSON)"):
        manifest = read_json(file, dict)
    if manifest.get("command") != "complete":
        raise InputError(
            f"{folder}: was written by `unseen {manifest.get('command')}`; review opens completions"
        )
    with guard_reading(file, "a manifest of `unseen complete` (JSON)"):
        inputs = list(manifest["inputs"])
        how = _options_of(manifest["options"], [str(entry["input"]) for entry in inputs])
    _check_inputs(folder, inputs)
    return how


def _options_of(known: Mapping[str, Any], named: list[str]) -> CompleteOptions:
    """The options of a manifest; `named` are its inputs: scans, then the other files that there are."""
    n_scans = len(known["scans"])
    values: dict[str, Any] = {"scans": tuple(named[:n_scans])}
    rest = iter(named[n_scans:])
    for name in _FILES:
        values[name] = known[name] if known[name] in _WORDS else next(rest)
    values["search"] = known["search"] if known["texture"] else "off"
    read = {entry.name for entry in fields(ReadOptions)}
    mine = {entry.name for entry in fields(CompleteOptions)} - {"read", "scheduler", "texture"}
    for name in (mine | read) - {*values}:
        if name in known:
            values[name] = _tuples(known[name])
    return CompleteOptions(
        **{name: value for name, value in values.items() if name not in read},
        read=ReadOptions(**{name: value for name, value in values.items() if name in read}),
    )


def _tuples(value: Any) -> Any:
    return tuple(map(_tuples, value)) if isinstance(value, list) else value


def _check_inputs(folder: Path, inputs: list[dict[str, Any]]) -> None:
    """Refuse inputs that are not what the completion was made of."""
    for entry in inputs:
        name = str(entry["input"])
        path = Path(name.rpartition("#")[0] or name)
        if not (Path(name).exists() or path.exists()):
            raise InputError(
                f"{name}: does not exist, but {folder} was made from it; start review in the folder in which "
                "`unseen complete` was run"
            )
    for entry, now in zip(inputs, read_inputs(str(one["input"]) for one in inputs).records, strict=True):
        if entry != now:
            raise InputError(f"{entry['input']}: has changed since {folder} was made; complete it again")


def open_session(run: Run, shared: Shared, how: CompleteOptions, folder: Path) -> ReviewSession:
    """The session of a folder: the surfaces of its scans, found once and then remembered."""
    own = folder / _OWN
    make_folder(own)
    request, plain = how.request(), _plain(how)
    run.read(request.inputs)
    journal = FileJournal(own / "journal", run.key({**request.options(), **plain.record()}))
    run.will_call(solve_plane, 40)
    given, options, _ = load_scans(run, shared, plain, request, journal)
    run.warn(given.doubts)
    said = completion_options(how)
    options = replace(options, edits=said.edits, stated_relations=said.stated_relations)
    return open_scans(
        given.scans, options, own / "history.json",
        n_threads=shared.threads, journal=journal, progress=run.progress,
    )  # fmt: skip


def _plain(how: CompleteOptions) -> CompleteOptions:
    """The options without what a person said."""
    return replace(how, edits=None, relations="off" if how.relations == "off" else "auto")


def save(shared: Shared, how: CompleteOptions, session: ReviewSession, folder: Path) -> list[str]:
    """Write what was said as `EDITS`, then all outputs as `unseen complete` does with it; their names."""
    document = document_of(session.said)
    file = folder / EDITS
    write_json(file, document)
    relations = str(file) if document["relations"] else _plain(how).relations
    asked = replace(how, edits=str(file), relations=relations)
    with _in_silence():
        run_complete(replace(shared, out=folder, as_json=False, quiet=True), asked)
    written = json.loads((folder / "manifest.json").read_text("utf-8"))["outputs"]
    return [EDITS, *(str(one["name"]) for one in written)]


@contextmanager
def _in_silence() -> Iterator[None]:
    """Keep a command's lines from the terminal, and turn its end with an error into that error."""
    told = StringIO()
    try:
        with redirect_stdout(told):
            yield
    except typer.Exit as error:
        raise InputError("the outputs could not be written; the terminal says why") from error
