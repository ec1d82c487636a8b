# SPDX-License-Identifier: MIT
"""Manifest: what made an output, from what, with which options, and when; the only file that holds times."""

from __future__ import annotations

import hashlib
import os
import platform
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any

from scenes.run.atomic import json_text, write_json

_PACKAGES = ("numpy", "scipy", "embreex", "numba", "trimesh", "opencv-python-headless", "shapely")
_BLOCK = 1 << 20


def version_of(distribution: str) -> str:
    """Return the installed version of a distribution, "unknown" where it is not installed."""
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return "unknown"


def versions() -> dict[str, str]:
    """Return the versions that results depend on: ours, Python's, and those of the numeric packages."""
    versions_here = {"unseen": version_of("unseen"), "python": platform.python_version()}
    return versions_here | {name: version_of(name) for name in _PACKAGES}


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file, hexadecimal."""
    digest = hashlib.sha256()
    with path.open("rb") as stream:
        while block := stream.read(_BLOCK):
            digest.update(block)
    return digest.hexdigest()


@dataclass(frozen=True, slots=True)
class Inputs:
    """What a run reads, hashed once.

    Attributes
    ----------
    records : tuple of dict
        For each input its name, and the bytes and SHA-256 of its files; of what is no file the name alone.
    """

    records: tuple[dict[str, Any], ...] = ()

    def digests(self) -> tuple[tuple[str, str], ...]:
        """Return name and SHA-256 of each input that is a file; of a folder, of the list of its files' own.

        Names have no folders: a report is the same wherever its inputs lie.
        """
        digests = []
        for record in self.records:
            name = Path(record["input"]).name
            if "sha256" in record:
                digests.append((name, record["sha256"]))
            elif "files" in record:
                lines = "".join(f"{file['sha256']}  {file['name']}\n" for file in record["files"])
                digests.append((f"{name}/", hashlib.sha256(lines.encode()).hexdigest()))
        return tuple(dict.fromkeys(digests))

    def key(self, options: Mapping[str, Any], seed: int) -> str:
        """Return what tells a run by what it is made of: the SHA-256 of versions, inputs, options, seed."""
        made_of = {"versions": versions(), "inputs": self.records, "options": dict(options), "seed": seed}
        return hashlib.sha256(json_text(made_of).encode()).hexdigest()


def read_inputs(given: Iterable[str]) -> Inputs:
    """Hash inputs: each file once, of a folder every file in it.

    `builtin:NAME` and other things that are no files are named alone; `PATH#k` stands for PATH.

    Examples
    --------
    >>> read_inputs(["builtin:two_occluders"]).records
    ({'input': 'builtin:two_occluders'},)
    """
    known: dict[Path, dict[str, Any]] = {}
    records = []
    for text in given:
        before, mark, _number = text.rpartition("#")
        path = Path(text) if Path(text).exists() or not mark else Path(before)
        if path not in known:
            known[path] = _record(path)
        records.append({"input": text, **known[path]})
    return Inputs(tuple(records))


def _record(path: Path) -> dict[str, Any]:
    if path.is_file():
        return _file_record(path)
    if path.is_dir():
        held = sorted(file for file in path.rglob("*") if file.is_file())
        return {"files": [{"name": file.relative_to(path).as_posix(), **_file_record(file)} for file in held]}
    return {}


def _file_record(path: Path) -> dict[str, Any]:
    return {"bytes": path.stat().st_size, "sha256": sha256_of(path)}


@dataclass(slots=True, eq=False)
class Stopwatch:
    """Wall-clock times of a run: when it began, and how long its stages took; `heard` is told of each."""

    started: datetime = field(default_factory=lambda: datetime.now(UTC))
    _begin: float = field(default_factory=time.perf_counter)
    _stage: str = ""
    _stage_begin: float = 0.0
    stages: dict[str, float] = field(default_factory=dict)
    heard: Callable[[str], None] | None = None

    def enter(self, stage: str) -> None:
        """Note that `stage` runs from now on; the same name again adds up."""
        if stage == self._stage:
            return
        now = time.perf_counter()
        if self._stage:
            spent = self.stages.get(self._stage, 0.0) + now - self._stage_begin
            self.stages[self._stage] = round(spent, 3)
        self._stage, self._stage_begin = stage, now
        if self.heard is not None and stage:
            self.heard(stage)

    def record(self) -> dict[str, Any]:
        """Return the times for the manifest; the last stage ends now."""
        self.enter("")
        return {
            "started": self.started.isoformat(timespec="seconds"),
            "finished": datetime.now(UTC).isoformat(timespec="seconds"),
            "seconds": round(time.perf_counter() - self._begin, 3),
            "stages_s": dict(self.stages),
        }


def manifest_path(out: Path, *, is_folder: bool) -> Path:
    """Return where the manifest of an output goes: into a folder, beside a file as `FILE.manifest.json`.

    Examples
    --------
    >>> manifest_path(Path("a/scan.npz"), is_folder=False).name
    'scan.npz.manifest.json'
    """
    return out / "manifest.json" if is_folder else out.with_name(f"{out.name}.manifest.json")


def write_manifest(
    path: Path,
    *,
    command: str,
    seed: int,
    inputs: Inputs,
    options: Mapping[str, Any],
    threads: int | None,
    outputs: Mapping[str, Path],
    times: Mapping[str, Any],
) -> None:
    """Write a manifest.

    Parameters
    ----------
    path : Path
        Where to.
    command : str
        The command that ran.
    seed : int
        Its seed.
    inputs : Inputs
        What was read.
    options : mapping
        Every option with the value that was used, defaults included.
    threads : int, optional
        As asked for; None means one for each core.
    outputs : mapping of str to Path
        What was written: its name in the output folder, and where it lies now.
    times : mapping
        `Stopwatch.record()`.
    """
    content = {
        "command": command,
        "versions": versions(),
        "seed": seed,
        "inputs": inputs.records,
        "options": dict(options),
        "threads": threads if threads is not None else os.cpu_count(),
        "platform": platform.platform(),
        "outputs": [{"name": name, **_file_record(file)} for name, file in outputs.items()],
        "times": dict(times),
    }
    write_json(path, content)
