# SPDX-License-Identifier: MIT
"""Archive: every outcome in a file of its own, so that an interrupted evaluation goes on where it was.

A file is named by a digest of all that its outcome depends on, sources and versions included; what it took
stands beside it in `FILE.manifest.json`, so that outcomes are the same bytes however they came about.
"""

from __future__ import annotations

import hashlib
import json
import re
import types
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any, get_args, get_origin, get_type_hints

import numpy as np

import completion
import nbv
import scenes
from benchmarks.completion.cases.cost import Cost
from benchmarks.completion.cases.outcome import Outcome
from nbv.run.manifest import manifest_path, versions
from scenes.checks import InputError
from scenes.run.atomic import json_text, write_json, write_text

_NBV_SOURCES = ("scanning",)  # the others do not enter into outcomes, nor do these of benchmarks:
_PRESENTATION = (
    "archive", "bootstrap", "command", "cost", "page", "plots", "study", "summary", "sweep_page", "tables"
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Archive:
    """Outcomes in a folder."""

    folder: Path

    def find(self, key: Mapping[str, Any]) -> tuple[Outcome, Cost | None] | None:
        """Return the outcome with this key and what it took, None where it is not there.

        Raises
        ------
        InputError
            Its file is none of this archive's.
        """
        path = self.path(key)
        if not path.is_file():
            return None
        try:
            outcome = from_record(Outcome, json.loads(path.read_text("utf-8"))["outcome"])
        except (ValueError, KeyError, TypeError) as error:
            raise InputError(f"{path}: is no outcome of this evaluation; remove it ({error})") from error
        beside = manifest_path(path, is_folder=False)
        cost = Cost(**json.loads(beside.read_text("utf-8"))) if beside.is_file() else None
        return outcome, cost

    def keep(self, key: Mapping[str, Any], outcome: Outcome, cost: Cost) -> None:
        """Write an outcome, whole or not at all, and what it took beside it."""
        self.folder.mkdir(parents=True, exist_ok=True)
        path = self.path(key)
        write_json(manifest_path(path, is_folder=False), cost.record())
        write_text(path, json_text({"key": key, "outcome": to_record(outcome)}, indent=None) + "\n")

    def path(self, key: Mapping[str, Any]) -> Path:
        """Return where the outcome with this key stands."""
        digest = hashlib.sha256(json_text({**key, "made_by": fingerprint()}).encode()).hexdigest()[:16]
        words = "-".join(str(key[name]) for name in ("case", "method", "noise") if name in key)
        return self.folder / f"{re.sub(r'[^a-z0-9.]+', '-', words.lower())}-{digest}.json"


@cache
def fingerprint() -> str:
    """Digest of the sources and versions that outcomes depend on."""
    roots = [Path(str(package.__file__)).parent for package in (scenes, completion)]
    nbv_root = Path(str(nbv.__file__)).parent
    here = Path(__file__).parents[1]
    roots += [nbv_root / name for name in _NBV_SOURCES] + [here]
    files = sorted(file for root in roots for file in ([root] if root.is_file() else root.rglob("*.py")))
    digest = hashlib.sha256(json_text(versions()).encode())
    for file in files:
        if file.is_relative_to(here) and file.stem in _PRESENTATION:
            continue
        digest.update(file.name.encode() + file.read_bytes())
    return digest.hexdigest()


def to_record(value: Any) -> Any:
    """Return frozen values, arrays and tuples as JSON that `from_record` turns back exactly.

    Examples
    --------
    >>> to_record((np.array([1.5, np.inf]), "a", float("nan")))
    [{'shape': [2], 'type': 'float64', 'values': [1.5, 'inf']}, 'a', 'nan']
    """
    if is_dataclass(value):
        return {field.name: to_record(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, np.ndarray):
        values = [to_record(item) for item in value.ravel().tolist()]
        return {"shape": list(value.shape), "type": str(value.dtype), "values": values}
    if isinstance(value, tuple):
        return [to_record(item) for item in value]
    if isinstance(value, float | np.floating):
        return float(value) if np.isfinite(value) else str(float(value))
    return value.item() if isinstance(value, np.generic) else value


def from_record(kind: Any, record: Any) -> Any:
    """Return the value of a type, by its annotations, whose record this is.

    Examples
    --------
    >>> from_record(tuple[float, ...], [1.0, "nan"])
    (1.0, nan)
    """
    origin = get_origin(kind)
    if is_dataclass(kind) and isinstance(kind, type):
        hints = get_type_hints(kind)
        return kind(
            **{field.name: from_record(hints[field.name], record[field.name]) for field in fields(kind)}
        )
    if isinstance(record, Mapping):  # an array, whatever numpy's alias for its type is made of
        return np.array(record["values"], dtype=record["type"]).reshape(record["shape"])
    if origin is tuple:
        inner = get_args(kind)
        kinds = inner[:1] * len(record) if inner[-1] is Ellipsis else inner
        return tuple(from_record(of, item) for of, item in zip(kinds, record, strict=True))
    if origin is types.UnionType:
        return None if record is None else from_record(get_args(kind)[0], record)
    return float(record) if kind is float else record
