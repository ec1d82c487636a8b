# SPDX-License-Identifier: MIT
"""Store: every result in a file of its own, so that an interrupted benchmark continues where it stopped.

A file is named by a digest of everything its result depends on, sources and versions included; the time and
memory that it took stand beside the result and never enter it.
"""

from __future__ import annotations

import hashlib
import json
import re
import time
import types
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from contextvars import ContextVar
from dataclasses import asdict, dataclass, field, fields, is_dataclass
from functools import cache
from pathlib import Path
from statistics import median
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

import completion
import nbv
import scenes
from nbv.run.manifest import versions
from scenes.checks import InputError
from scenes.run.atomic import json_text, write_text

_SKIPPED = ("__main__", "run", "plots", "summary")  # presentation: results do not depend on it
_RESET_PEAK = "5"  # proc(5): resets the peak of resident memory
_T = TypeVar("_T")


@dataclass(frozen=True, slots=True)
class Cost:
    """Time and memory of one measurement."""

    wall_s: float
    cpu_s: float  # of all threads together
    peak_bytes: int | None  # largest resident memory of the process meanwhile; None where unknown


def measured(work: Callable[[], _T]) -> tuple[_T, Cost]:
    """Return what `work` returns, and its cost.

    Examples
    --------
    >>> total, cost = measured(lambda: sum(range(1000)))
    >>> total, cost.wall_s > 0
    (499500, True)
    """
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text(_RESET_PEAK)
    wall, cpu = time.perf_counter(), time.process_time()
    result = work()
    return result, Cost(time.perf_counter() - wall, time.process_time() - cpu, peak_bytes())


def peak_bytes() -> int | None:
    """Return the peak of resident memory since its reset, by Linux's proc(5); `getrusage` counts parents."""
    with suppress(OSError):
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return 1024 * int(line.split()[1])
    return None


@dataclass(slots=True, eq=False)
class Store:
    """Results in a folder; without a folder nothing is kept."""

    folder: Path | None = None
    costs: dict[str, list[Cost]] = field(default_factory=dict)  # by label

    def get(self, key: Mapping[str, Any], make: Callable[[], _T], kind: Any, label: str = "") -> _T:
        """Return the result with this key, of type `kind`; `make` measures it where it is not there.

        Raises InputError: the file with this key holds no such result.
        """
        path = self.path(key)
        if path is not None and path.is_file():
            try:
                held = json.loads(path.read_text("utf-8"))
                result: _T = from_record(kind, held["result"])
                cost = Cost(**held["cost"])
            except (ValueError, KeyError, TypeError) as error:
                raise InputError(f"{path}: holds no result of this benchmark; remove it ({error})") from error
        else:
            result, cost = measured(make)
            if path is not None:
                path.parent.mkdir(parents=True, exist_ok=True)
                record = {"key": key, "result": to_record(result), "cost": asdict(cost)}
                write_text(path, json_text(record, indent=None) + "\n")
        self.costs.setdefault(label, []).append(cost)
        return result

    def path(self, key: Mapping[str, Any]) -> Path | None:
        """Return the file of the result with this key."""
        if self.folder is None:
            return None
        digest = hashlib.sha256(json_text({**key, "made_by": fingerprint()}).encode()).hexdigest()[:16]
        words = "-".join(str(value) for value in key.values() if isinstance(value, str | int))[:60]
        return self.folder / f"{re.sub(r'[^a-z0-9.]+', '-', words.lower())}-{digest}.json"

    def lines(self) -> Iterator[str]:
        """Yield a line on the costs of each label."""
        for label, costs in self.costs.items():
            peak = max((cost.peak_bytes or 0 for cost in costs), default=0) / 1e6
            wall, cpu = (median(getattr(cost, name) for cost in costs) for name in ("wall_s", "cpu_s"))
            yield f"{label}: {wall:.2f} s, CPU {cpu:.2f} s a case (median of {len(costs)}), {peak:.0f} MB"


STORE: ContextVar[Store] = ContextVar("store")


def each(function: Callable[..., _T], *arguments: Any) -> Iterator[_T]:
    """Like `map`: yield the results of a function for some arguments, from the store if they are there.

    An argument that is a range or a list varies, others are the same for all. The function's annotation says
    of which type results are: numbers, texts, arrays, dataclasses, named tuples, lists and dicts of these.
    """
    kind = get_type_hints(function).get("return", Any)
    varied = [argument for argument in arguments if isinstance(argument, range | list)]
    for k in range(len(varied[0]) if varied else 1):
        given = [argument[k] if isinstance(argument, range | list) else argument for argument in arguments]
        key = {"function": f"{function.__module__}.{function.__qualname__}", "arguments": to_record(given)}
        store = STORE.get(Store())
        yield store.get(key, lambda given=given: function(*given), kind, function.__name__)  # type: ignore[misc]


@cache
def fingerprint() -> str:
    """Return the digest of the sources and versions that results depend on."""
    here = Path(__file__).parent
    roots = [Path(str(package.__file__)).parent for package in (scenes, completion)]
    roots += [Path(str(nbv.__file__)).parent / "scanning", here]
    digest = hashlib.sha256(json_text(versions()).encode())
    for file in sorted(file for root in roots for file in root.rglob("*.py")):
        if not (file.is_relative_to(here) and file.stem in _SKIPPED):
            digest.update(file.name.encode() + file.read_bytes())
    return digest.hexdigest()


def to_record(value: Any) -> Any:
    """Return values, arrays and tuples as JSON that `from_record` turns back exactly.

    Examples
    --------
    >>> to_record((np.array([1.5, np.inf]), "a", float("nan")))
    [{'shape': [2], 'type': 'float64', 'values': [1.5, 'inf']}, 'a', 'nan']
    """
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: to_record(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, np.ndarray):
        values = [to_record(item) for item in value.ravel().tolist()]
        return {"shape": list(value.shape), "type": str(value.dtype), "values": values}
    if isinstance(value, Mapping):
        return {str(name): to_record(item) for name, item in value.items()}
    if isinstance(value, tuple | list):
        return [to_record(item) for item in value]
    if isinstance(value, float | np.floating):
        return float(value) if np.isfinite(value) else str(float(value))
    if callable(value):
        return value.__qualname__
    return value.item() if isinstance(value, np.generic) else str(value) if isinstance(value, Path) else value


def from_record(kind: Any, record: Any) -> Any:
    """Return the value of a type, by its annotations, whose record this is.

    Examples
    --------
    >>> from_record(tuple[float, ...], [1.0, "nan"])
    (1.0, nan)
    """
    origin, inner = get_origin(kind), get_args(kind)
    if isinstance(record, Mapping) and set(record) == {"shape", "type", "values"}:  # an array
        return np.array(record["values"], dtype=record["type"]).reshape(record["shape"])
    if is_dataclass(kind) and isinstance(kind, type):
        hints = get_type_hints(kind)
        names = [field.name for field in fields(kind)]
        return kind(**{name: from_record(hints[name], record[name]) for name in names})
    if hasattr(kind, "_fields"):  # a named tuple
        hints = get_type_hints(kind)
        return kind(*(from_record(hints[n], item) for n, item in zip(kind._fields, record, strict=True)))
    if origin is tuple:
        kinds = inner[:1] * len(record) if inner[-1] is Ellipsis else inner
        return tuple(from_record(of, item) for of, item in zip(kinds, record, strict=True))
    if origin is list:
        return [from_record(inner[0], item) for item in record]
    if origin is dict:
        return {inner[0](name): from_record(inner[1], item) for name, item in record.items()}
    if origin in (types.UnionType, Union):
        return None if record is None else from_record(inner[0], record)
    return float(record) if kind is float else record
