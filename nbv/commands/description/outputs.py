# SPDX-License-Identifier: MIT
"""Outputs: what a file or folder that unseen wrote, or that only it reads, holds, for `unseen info`."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np

from nbv.commands.description.records import (
    describe_camera,
    describe_manifest,
    describe_record,
    manifest_beside,
    read_record,
)
from scenes.checks import InputError
from scenes.io.documents import within_folder
from scenes.io.guard import check_file, reading
from scenes.io.npz import open_arrays
from scenes.io.ply import read_mesh_ply
from scenes.run.atomic import to_plain

_PAGE_HEAD = 20_000  # bytes of a report, in which its title stands
_STATES = ("observed", "hypothesised")


def describe_output(path: Path) -> dict[str, Any] | None:
    """Return what a file or folder of ours holds, as plain values for JSON; None for others.

    Raises
    ------
    InputError
        A file of ours that is damaged; a sensor profile that is not usable.
    """
    if path.is_dir():
        if not (path / "manifest.json").is_file() or (path / "depth").is_dir():
            return None
        with reading(path, "an output folder"):
            return _folder(path)
    describer = {
        ".json": _json, ".toml": _sensor, ".npz": _arrays, ".ply": _ply, ".csv": _csv, ".html": _html,
    }.get(path.suffix.lower())  # fmt: skip
    if describer is None or not path.is_file():
        return None
    with reading(check_file(path), f"a {path.suffix[1:].upper()} file"):
        found = describer(path)
        return None if found is None else _ordered(path, found)


def with_states(held: dict[str, Any]) -> dict[str, Any]:
    """Add to the description of a scene that it is a completed model, where its surfaces' names say so."""
    names = [str(name).replace("_", " ").split() for name in held.get("surface_names", [])]
    is_ours = bool(names) and all(words and words[0] in _STATES for words in names)
    if held.get("kind") != "scene" or not is_ours:
        return held
    counts = {state: sum(words[0] == state for words in names) for state in _STATES}
    said = f"a completed model: {counts['hypothesised']} of its parts were inferred, nobody measured them"
    return {**held, "parts": counts, "warnings": [said, *held["warnings"]]}


def _ordered(path: Path, found: dict[str, Any]) -> dict[str, Any]:
    """Kind and path first, warnings last, all of it plain."""
    rest = {key: value for key, value in found.items() if key not in ("kind", "warnings")}
    ends = {"warnings": found.get("warnings", [])}
    plain = to_plain({"kind": found["kind"], "path": str(path), **rest, **ends})
    return dict(plain)


def _json(path: Path) -> dict[str, Any] | None:
    """A manifest, what the manifest beside it names, or a camera; None for others."""
    content = read_record(path)
    if content is None:
        return None
    if (found := describe_manifest(content) or describe_camera(content)) is not None:
        return found
    manifest = manifest_beside(path)
    return None if manifest is None else describe_record(path.name, content, manifest["command"])


def _folder(path: Path) -> dict[str, Any]:
    """An output folder: what made it, the headline of what it holds, and its files."""
    content = read_record(path / "manifest.json")
    manifest = describe_manifest(content) if content else None
    if content is None or manifest is None:
        raise InputError(f"{path / 'manifest.json'}: is no manifest of unseen")
    found = {**manifest, "kind": "output folder"}
    warnings, files = [], []
    for name in manifest["outputs"]:
        file = within_folder(path, name)
        if not file.is_file():
            warnings.append(f"{name} is missing")
            continue
        files.append(name)
        held = None
        if file.suffix == ".json" and (record := read_record(file)) is not None:
            held = describe_record(name, record, manifest["command"])
        if held is not None:
            found[held.pop("kind")] = held
    sizes = {entry["name"]: entry["bytes"] for entry in content["outputs"]}
    changed = [name for name in files if (path / name).stat().st_size != sizes[name]]
    warnings += [f"{name} was changed since it was written" for name in changed]
    return _ordered(path, {**found, "warnings": warnings})


def _sensor(path: Path) -> dict[str, Any]:
    from nbv.scanning.sensor_profile import load_profile

    profile = load_profile(path)
    held = dict(profile.sensor.to_json())
    return {**held, "geometry": held["kind"], "kind": "sensor", "sources": dict(profile.sources)}


def _arrays(path: Path) -> dict[str, Any] | None:
    """Candidates, or other arrays; None for scans and points."""
    with open_arrays(path) as arrays:
        names = set(arrays.files)
        if {"header", "ranges"} <= names or "range_tenth_mm" in names or "points" in names:
            return None
        shapes = {name: [str(arrays[name].dtype), *arrays[name].shape] for name in sorted(names)}
        if not {"positions", "directions"} <= names:
            return {"kind": "arrays", "arrays": shapes}
        positions = np.asarray(arrays["positions"], dtype=np.float64)
    n_directions = int(shapes["directions"][1])
    return {
        "kind": "candidates",
        "positions": len(positions),
        "directions": n_directions,
        "poses": len(positions) * n_directions,
        "bounds_m": [positions.min(axis=0), positions.max(axis=0)] if len(positions) else None,
        "arrays": shapes,
    }


def _ply(path: Path) -> dict[str, Any] | None:
    """A mesh of a completion or of coverage; None for others."""
    with path.open("rb") as file:
        head = file.read(1 << 16).partition(b"end_header")[0]
    if b"comment provenance 0 measured" not in head and b"comment state 0 " not in head:
        return None
    from completion.result.labelled_points import mesh_area

    mesh = read_mesh_ply(path)
    values = mesh.vertex_properties
    area = mesh_area(mesh.vertices, mesh.faces)
    found: dict[str, Any] = {"triangles": len(mesh.faces), "vertices": len(mesh.vertices), "area_m2": area}
    found["bounds_m"] = [mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)] if len(mesh.vertices) else None
    if "provenance" not in values:
        return {"kind": "coverage mesh", **found, "properties": list(values)}
    inferred = bool((values["provenance"] > 0).all()) and len(mesh.vertices) > 0
    said = ["nobody measured this surface: it was inferred"] if inferred else []
    return {
        "kind": "inferred surface" if inferred else "measured surface",
        **found,
        "surfaces": len(set(values["surface"].tolist()) - {0}),
        "sd_m": {"max": float(values["sd"].max())} if len(values["sd"]) else {},
        "provenance": _counts(values["provenance"], mesh.comments),
        "warnings": said,
    }


def _counts(provenance: Any, comments: tuple[str, ...]) -> dict[str, int]:
    """How many vertices have each provenance, by the names in the comments."""
    names = {int(words[1]): words[2] for line in comments if (words := line.split())[:1] == ["provenance"]}
    numbers, counts = np.unique(provenance, return_counts=True)
    return {names.get(int(k), str(k)): int(n) for k, n in zip(numbers, counts, strict=True)}


def _csv(path: Path) -> dict[str, Any] | None:
    """A table of stations or of coverage; None for others."""
    from nbv.plan.plan_files import COLUMNS
    from nbv.plan.station_list import STATION_COLUMNS

    with path.open(encoding="utf-8", newline="") as file:
        rows = csv.reader(file)
        names = next(rows, [])
        if tuple(names) in (COLUMNS, STATION_COLUMNS):
            return {"kind": "stations of a plan", "stations": sum(1 for _ in rows), "columns": names}
        if names[:3] == ["id", "name", "area_m2"] or names[:2] == ["id", "kind"]:
            return {"kind": "table of coverage", "surfaces": sum(1 for _ in rows), "columns": names}
    return None


def _html(path: Path) -> dict[str, Any] | None:
    """A report."""
    with path.open("rb") as file:
        text = file.read(_PAGE_HEAD).decode("utf-8", errors="replace")
    title = text.partition("<title>")[2].partition("</title>")[0]
    if "unseen" not in text or not title:
        return None
    return {"kind": "report", "title": title, "bytes": path.stat().st_size, "advice": "open it in a browser"}
