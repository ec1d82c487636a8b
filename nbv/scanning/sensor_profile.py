# SPDX-License-Identifier: MIT
"""Sensor profiles: instruments by name, as TOML that says where each of its numbers comes from.

A profile is one table: `kind`, the fields of that sensor, and a table for each effect that it has
(`footprint`, `intensity`, `dropout`, `noise` with its `model`, `pointing`, `quantisation`). Beside them
stands `[sources]`, with one line for each number, in tables of the same names. With `like = "NAME"` it is a
built-in profile but for the entries and tables that it states itself: the same instrument at another setting.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields
from importlib import resources
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from nbv.scanning.beam import Dropout, Footprint, Intensity
from nbv.scanning.effects import NOISE_MODELS, Effects, PointingNoise, Quantisation
from nbv.scanning.sensor import PinholeSensor, Sensor, SphericalSensor
from nbv.scanning.triangulation import LineSensor, TriangulationSensor
from scenes.checks import MOST_M, InputError
from scenes.io.checks.documents import parse_toml, read_toml
from scenes.io.checks.guard import check_size, guard_reading

_KINDS: dict[str, type[Any]] = {
    kind.kind: kind for kind in (PinholeSensor, SphericalSensor, LineSensor, TriangulationSensor)
}
_OFFERED = "unseen.sensors"  # entry points of other packages: a name, and the path of its TOML file
_STAGES: dict[str, type[Any]] = {
    "footprint": Footprint,
    "intensity": Intensity,
    "dropout": Dropout,
    "pointing": PointingNoise,
    "quantisation": Quantisation,
}
_CALLED = {
    "tuple[tuple": "a list of lists of numbers",
    "tuple": "a list of numbers",
    "float": "a number",
    "int": "an integer",
    "": "a text",
}  # types of fields, the first that fits
_EFFECTS = tuple(field.name for field in fields(Effects))


@dataclass(frozen=True, slots=True, eq=False)
class SensorProfile:
    """An instrument.

    Attributes
    ----------
    sensor : Sensor
        Its geometry and effects.
    sources : mapping
        Where its numbers come from, by entry; those of an effect as a mapping of their own.
    """

    sensor: Sensor
    sources: Mapping[str, Any]


def sensor_names() -> tuple[str, ...]:
    """Return the names of the shipped profiles, and of those that other packages offer."""
    files = resources.files("nbv.scanning").joinpath("sensors").iterdir()
    shipped = {file.name.removesuffix(".toml") for file in files if file.name.endswith(".toml")}
    return tuple(sorted(shipped | entry_points(group=_OFFERED).names))


def load_sensor(name_or_path: str | Path) -> Sensor:
    """Return the sensor of a shipped profile, by name, or of a TOML file.

    Parameters
    ----------
    name_or_path : str or path
        One of `sensor_names()`, or a file that ends in `.toml`.

    Raises
    ------
    InputError
        No such profile or file, a file that is not TOML, a missing, unknown or impossible entry.

    Examples
    --------
    >>> load_sensor("generic60").projection.shape
    (320, 320)
    """
    return load_profile(name_or_path).sensor


def load_profile(name_or_path: str | Path) -> SensorProfile:
    """Return a shipped profile, by name, or that of a TOML file; raises as `load_sensor`."""
    name = str(name_or_path)
    if name in sensor_names():
        return _profile_of(_shipped(name), name)
    path = Path(name)
    if path.suffix != ".toml":
        raise InputError(f"no sensor named {name!r}; there are {', '.join(sensor_names())}, or give a .toml")
    with guard_reading(path, "a sensor"):
        return _profile_of(read_toml(path), name)


def sensor_from_profile(profile: Mapping[str, Any], source: str = "sensor") -> Sensor:
    """Return the sensor of a parsed profile; `source` is named in errors.

    Raises
    ------
    InputError
        A missing, unknown or impossible entry.
    """
    kind = profile.get("kind")
    if not isinstance(kind, str) or kind not in _KINDS:
        raise InputError(f"{source}: kind must be one of {', '.join(_KINDS)}, got {kind!r}")
    stages = {key: value for key, value in profile.items() if key in _EFFECTS}
    entries = {key: value for key, value in profile.items() if key != "kind" and key not in _EFFECTS}
    sensor: Sensor = _built(_KINDS[kind], {**entries, "effects": _effects(stages, source)}, source, "")
    try:
        check_size(getattr(sensor, "height", 1), getattr(sensor, "width", 1))
    except InputError as error:
        raise InputError(f"{source}: {error}") from error
    return sensor


def _effects(tables: Mapping[str, Any], source: str) -> Effects:
    """Return the effects of a profile's tables."""
    stages: dict[str, Any] = {}
    for name, table in tables.items():
        if not isinstance(table, Mapping):
            raise InputError(f"{source}: {name} must be a table like [{name}], got {table!r}")
        if name != "noise":
            stages[name] = _built(_STAGES[name], table, source, f"{name}.")
            continue
        model = table.get("model")
        if not isinstance(model, str) or model not in NOISE_MODELS:
            raise InputError(f"{source}: noise.model must be one of {', '.join(NOISE_MODELS)}, got {model!r}")
        numbers = {key: value for key, value in table.items() if key != "model"}
        stages[name] = _built(NOISE_MODELS[model], numbers, source, "noise.")
    return Effects(**stages)


def _built(option: type[Any], table: Mapping[str, Any], source: str, within: str) -> Any:
    """Return `option` made of a table, its entries checked by name and type."""
    known = {field.name: str(field.type) for field in fields(option)}
    named = ", ".join(name for name in known if name != "effects")
    for key, value in table.items():
        if key not in known:
            raise InputError(f"{source}: unknown entry {within + key!r}; there are {named}")
        if key != "effects" and not _fits(value, known[key]):
            kind = next(text for wanted, text in _CALLED.items() if wanted in known[key])
            raise InputError(f"{source}: {within}{key} must be {kind}, got {value!r}")
    required = [field.name for field in fields(option) if field.default is MISSING]
    if missing := [name for name in required if name not in table]:
        raise InputError(f"{source}: {within}{missing[0]} is missing; add {missing[0]} = <number>")
    try:
        return option(**table)
    except InputError as error:
        raise InputError(f"{source}: {within}{error}") from error


def _fits(value: Any, wanted: str) -> bool:
    """Tell whether a TOML value is of the type of a field."""
    if wanted.startswith("tuple["):
        inner = wanted.removeprefix("tuple[").removesuffix(", ...]")
        return isinstance(value, list | tuple) and all(_fits(one, inner) for one in value)
    if isinstance(value, bool):
        return False
    if "float" in wanted:
        return isinstance(value, int | float) and abs(value) <= MOST_M
    if wanted.startswith("int"):
        return isinstance(value, int) and abs(value) < 2**31
    return isinstance(value, str)


def _shipped(name: str) -> dict[str, Any]:
    """Return the table of a built-in profile, or of the file that another package names."""
    file = resources.files("nbv.scanning") / "sensors" / f"{name}.toml"
    if file.is_file():
        return parse_toml(file.read_text("utf-8"))
    return read_toml(Path(entry_points(group=_OFFERED)[name].load()))


def _profile_of(table: dict[str, Any], name: str) -> SensorProfile:
    """Return the profile that a table describes."""
    source = f"sensor {name}"
    sources = table.pop("sources", {})
    _check_sources(sources, table, source, "sources")
    while (like := table.pop("like", None)) is not None:
        if like not in sensor_names():
            raise InputError(f"{source}: like must be one of {', '.join(sensor_names())}, got {like!r}")
        other = _shipped(like)
        kept = {key: text for key, text in other.pop("sources").items() if key not in table}
        table, sources = {**other, "name": Path(name).stem, **table}, {**kept, **sources}
    return SensorProfile(sensor_from_profile({"name": Path(name).stem, **table}, source), sources)


def _check_sources(sources: Any, table: Mapping[str, Any], source: str, within: str) -> None:
    """Raise InputError for a source that is no text or belongs to no entry."""
    if not isinstance(sources, Mapping):
        raise InputError(f"{source}: {within} must be a table, got {sources!r}")
    for key, text in sources.items():
        if key not in table:
            raise InputError(f"{source}: {within}.{key} is the source of no entry; is it spelt as the entry?")
        if isinstance(table[key], Mapping):
            _check_sources(text, table[key], source, f"{within}.{key}")
        elif not isinstance(text, str) or not text.strip():
            raise InputError(f"{source}: {within}.{key} must be a text that names the source, got {text!r}")
