# SPDX-License-Identifier: MIT
"""`unseen info`: what any file or output folder holds, with warnings.

The manifest beside a JSON file of unseen says which command wrote it.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from nbv.commands.options.shared import InfoOptions, Shared
from nbv.commands.process import start_run
from nbv.run.manifest import manifest_path
from scenes.checks import InputError
from scenes.io.checks.documents import parse_json, read_text, within_folder
from scenes.io.checks.guard import check_file, guard_reading
from scenes.io.clouds.npz import open_arrays
from scenes.io.describe import describe
from scenes.io.meshes.ply import read_mesh_ply
from scenes.io.scan_files import split_index
from scenes.run.atomic import to_plain, write_json

_DEEPEST = 8
_PAGE_HEAD = 20_000  # bytes of a report, in which its title stands
_STATES = ("observed", "hypothesised")
Content = Mapping[str, Any]


def run_info(shared: Shared, asked: InfoOptions) -> None:
    """Describe a file on stdout; with an output file also there, with a manifest."""
    file, camera = asked.file, asked.read.intrinsics
    default = Path(f"{Path(file.partition('#')[0]).name or 'input'}.info.json")
    with start_run(
        "info", shared, default=str(default), is_folder=False, writes=shared.out is not None
    ) as run:
        held = describe_output(split_index(file)[0])
        if held is None:
            intrinsics = None if camera is None else (camera[0], camera[1], camera[2], camera[3])
            held = describe(
                file,
                up=asked.up,
                units=asked.units,
                intrinsics=intrinsics,
                depth_scale=asked.read.depth_scale,
                trajectory=asked.read.trajectory,
            )
            held = with_states(held)
        lines = _lines(held)
        if shared.out is None:  # nothing is written, so there is nothing to make a manifest for
            run.say(held, lines)
            return
        run.read([file, *([asked.read.trajectory] if asked.read.trajectory else [])])
        write_json(run.path(), held)
        options = {
            "up": asked.up, "units": asked.units, "intrinsics": camera, "depth_scale": asked.read.depth_scale
        }  # fmt: skip
        run.finish(options, held, lines)


def _lines(held: dict[str, Any]) -> list[str]:
    """Return the description as lines of a table, warnings last."""
    rows = [(key, _text(value)) for key, value in held.items() if key not in ("warnings", "scans")]
    for scan in held.get("scans", []):
        rows.append((f"scan {scan['number']}", scan["name"]))
        rows += [(f"  {key}", _text(scan[key])) for key in scan if key not in ("number", "name", "bounds_m")]
    width = max(len(key) for key, _ in rows)
    lines = [f"{key:<{width}}  {text}" for key, text in rows]
    return lines + [f"warning: {text}" for text in held.get("warnings", [])]


def _text(value: Any, depth: int = 0) -> str:
    """Return a value in few characters; what lies deeper than people look as dots."""
    if depth > _DEEPEST:
        return "..."
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, dict):
        return ", ".join(f"{key} {_text(item, depth + 1)}" for key, item in value.items()) or "none"
    if isinstance(value, list):
        shown = ", ".join(
            f"[{_text(item, depth + 1)}]" if isinstance(item, list) else _text(item, depth + 1)
            for item in value[:8]
        )
        return shown + (f", ... ({len(value)})" if len(value) > 8 else "") or "none"
    return "none" if value is None else str(value)


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
        with guard_reading(path, "an output folder"):
            return _folder(path)
    describer = {
        ".json": _json, ".toml": _sensor, ".npz": _arrays, ".ply": _ply, ".csv": _csv, ".html": _html,
    }.get(path.suffix.lower())  # fmt: skip
    if describer is None or not path.is_file():
        return None
    with guard_reading(check_file(path), f"a {path.suffix[1:].upper()} file"):
        record = describer(path)
        return None if record is None else _order_record(path, record)


def with_states(held: dict[str, Any]) -> dict[str, Any]:
    """Add to the description of a scene that it is a completed model, where its surfaces' names say so."""
    names = [str(name).replace("_", " ").split() for name in held.get("surface_names", [])]
    is_ours = bool(names) and all(words and words[0] in _STATES for words in names)
    if held.get("kind") != "scene" or not is_ours:
        return held
    counts = {state: sum(words[0] == state for words in names) for state in _STATES}
    sentence = f"a completed model: {counts['hypothesised']} of its parts were inferred, nobody measured them"
    return {**held, "parts": counts, "warnings": [sentence, *held["warnings"]]}


def _order_record(path: Path, record: dict[str, Any]) -> dict[str, Any]:
    """Kind and path first, warnings last, all of it plain."""
    entries = {key: value for key, value in record.items() if key not in ("kind", "warnings")}
    ends = {"warnings": record.get("warnings", [])}
    plain = to_plain({"kind": record["kind"], "path": str(path), **entries, **ends})
    return dict(plain)


def _json(path: Path) -> dict[str, Any] | None:
    """A manifest, what the manifest beside it names, or a camera; None for others."""
    content = read_record(path)
    if content is None:
        return None
    if (record := describe_manifest(content) or describe_camera(content)) is not None:
        return record
    manifest = manifest_beside(path)
    return None if manifest is None else describe_record(path.name, content, manifest["command"])


def _folder(path: Path) -> dict[str, Any]:
    """An output folder: what made it, the headline of what it holds, and its files."""
    content = read_record(path / "manifest.json")
    manifest = describe_manifest(content) if content else None
    if content is None or manifest is None:
        raise InputError(f"{path / 'manifest.json'}: is no manifest of unseen")
    description = {**manifest, "kind": "output folder"}
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
            description[held.pop("kind")] = held
    sizes = {entry["name"]: entry["bytes"] for entry in content["outputs"]}
    changed = [name for name in files if (path / name).stat().st_size != sizes[name]]
    warnings += [f"{name} was changed since it was written" for name in changed]
    return _order_record(path, {**description, "warnings": warnings})


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
    record: dict[str, Any] = {"triangles": len(mesh.faces), "vertices": len(mesh.vertices), "area_m2": area}
    record["bounds_m"] = (
        [mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)] if len(mesh.vertices) else None
    )
    if "provenance" not in values:
        return {"kind": "coverage mesh", **record, "properties": list(values)}
    inferred = bool((values["provenance"] > 0).all()) and len(mesh.vertices) > 0
    sentences = ["nobody measured this surface: it was inferred"] if inferred else []
    return {
        "kind": "inferred surface" if inferred else "measured surface",
        **record,
        "surfaces": len(set(values["surface"].tolist()) - {0}),
        "sd_m": {"max": float(values["sd"].max())} if len(values["sd"]) else {},
        "provenance": _counts(values["provenance"], mesh.comments),
        "warnings": sentences,
    }


def _counts(provenance: Any, comments: tuple[str, ...]) -> dict[str, int]:
    """How many vertices have each provenance, by the names in the comments."""
    names = {int(words[1]): words[2] for line in comments if (words := line.split())[:1] == ["provenance"]}
    numbers, counts = np.unique(provenance, return_counts=True)
    return {names.get(int(k), str(k)): int(n) for k, n in zip(numbers, counts, strict=True)}


def _csv(path: Path) -> dict[str, Any] | None:
    """A table of stations or of coverage; None for others."""
    from nbv.plan.plan import COLUMNS
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


def read_record(path: Path) -> dict[str, Any] | None:
    """Return the content of a JSON file, None where it is a list.

    Raises
    ------
    InputError
        No such file, too large, or neither a JSON object nor a list.
    """
    with guard_reading(path, "JSON"):
        text = read_text(path)
        if text.lstrip().startswith("["):
            parse_json(text, list)
            return None
        return parse_json(text, dict)


def describe_manifest(content: Content) -> dict[str, Any] | None:
    """Return kind and headline numbers of a manifest, None for another file.

    Raises
    ------
    InputError
        An entry is missing or of the wrong kind.
    """
    if not {"command", "versions", "outputs"} <= content.keys():
        return None
    with _whole():
        return {
            "kind": "manifest",
            "command": content["command"],
            "unseen": content["versions"]["unseen"],
            "seed": content["seed"],
            "inputs": [entry["input"] for entry in content["inputs"]],
            "outputs": [entry["name"] for entry in content["outputs"]],
            "finished": content["times"]["finished"],
            "seconds": content["times"]["seconds"],
        }


def manifest_beside(path: Path) -> dict[str, Any] | None:
    """Return the described manifest that names a file as an output, None where there is none beside it."""
    for is_folder in (False, True):
        file = manifest_path(path.parent if is_folder else path, is_folder=is_folder)
        record = describe_manifest(read_record(file) or {}) if file.is_file() else None
        if record is not None and path.name in record["outputs"]:
            return record
    return None


def describe_record(name: str, content: Content, command: str) -> dict[str, Any] | None:
    """Return kind and headline numbers of an output of a command, None of one that has none.

    The name of a fit is free; of others it tells them apart, beside the command in their manifest.

    Raises
    ------
    InputError
        An entry is missing or of the wrong kind.
    """
    describer = _fit if command == "fit" else _DESCRIBERS.get(name)
    if describer is None:
        return None
    with _whole():
        return describer(content)


def describe_camera(content: Content) -> dict[str, Any] | None:
    """Return the intrinsics of a camera, which RGB-D folders keep as JSON; None for another file."""
    if not ({"fx", "fy"} <= content.keys() or "intrinsic_matrix" in content):
        return None
    return {"kind": "camera", **{key: value for key, value in content.items() if not isinstance(value, dict)}}


@contextmanager
def _whole() -> Iterator[None]:
    """Say of a file of ours that it is damaged, where an entry is not what it should be."""
    try:
        yield
    except (KeyError, TypeError, AttributeError, IndexError) as error:
        raise InputError(f"looks like a file of unseen, but is damaged: {error!r}") from error


def _plan(content: Content) -> dict[str, Any]:
    resumed = content.get("resumed_from")
    return {
        "kind": "plan",
        "method": content["method"],
        "sensor": content["sensor"]["name"],
        "requirement": {key: value for key, value in content["requirement"].items() if value is not None},
        "views": len(content["views"]),
        "resumed_from_scans": resumed["scans"] if resumed else 0,
        "coverage": content["coverage"],
        "lower_bound": content["lower_bound"],
        "stopped_because": content["stopped_because"],
    }


def _coverage(content: Content) -> dict[str, Any]:
    """Coverage of a scene; or of scans alone, which have a boundary of unseen space and no percentage."""
    if "boundary" in content:
        return _scan_coverage(content)
    names = ("total_m2", "met", "reachable", "unreachable", "inferred")
    return {
        "kind": "coverage",
        **{name: content[name] for name in names},
        "unreachable_because": content["unreachable_because"],
        "surfaces": len(content["surfaces"]),
    }


def _scan_coverage(content: Content) -> dict[str, Any]:
    return {
        "kind": "coverage of scans",
        "n_scans": content["scans"],
        "surface": content["surface"],
        "boundary": {key: value for key, value in content["boundary"].items() if isinstance(value, float)},
        "surfaces": len(content["surfaces"]),
    }


def _completion(content: Content) -> dict[str, Any]:
    kinds = [surface["kind"] for surface in content["surfaces"]]
    return {
        "kind": "completion",
        "mode": content["mode"],
        "n_scans": content["n_scans"],
        "surfaces": {kind: kinds.count(kind) for kind in sorted(set(kinds))},
        "observed_m2": content["observed_m2"],
        "hypothesised_m2": content["hypothesised_m2"],
        "free_space_violation_m2": content["free_space_violation_m2"],
        "openings": sum(len(surface["openings"]) for surface in content["surfaces"]),
        "edits": len(content["edits"]),
    }


def _polygons(content: Content) -> dict[str, Any]:
    surfaces = content["surfaces"]
    roles = [surface["role"] for surface in surfaces]
    openings = [opening["kind"] for surface in surfaces for opening in surface["openings"]]
    return {
        "kind": "polygons",
        "surfaces": {role: roles.count(role) for role in sorted(set(roles))},
        "area_m2": sum(surface["area_m2"] for surface in surfaces),
        "openings": {kind: openings.count(kind) for kind in sorted(set(openings))},
    }


def _things(content: Content) -> dict[str, Any]:
    things = content["things"]
    return {
        "kind": "things",
        "things": len(things),
        "closed": sum(one["closed"] is not None for one in things),
        "by_a_symmetry": sum(bool(one.get("sure")) for one in things),
        "inferred_m2": sum(one.get("inferred_m2", 0.0) for one in things),
        "least": content["least"],
    }


def _stations(content: Content) -> dict[str, Any]:
    """A tour, and where overlaps were asked after, as many and in how many groups."""
    tour, overlaps = content["tour"], content["overlaps"]
    record = {"kind": "stations", "stations": len(tour["order"]), "tour_m": tour["length_m"]}
    return record if overlaps is None else {**record, "overlaps": len(overlaps), "groups": content["groups"]}


def _fit(content: Content) -> dict[str, Any]:
    names = ("shape", "parameters", "standard_deviation", "rms", "n")
    return {"kind": "fit", **{name: content[name] for name in names}}


_DESCRIBERS: dict[str, Callable[[Content], dict[str, Any]]] = {
    "plan.json": _plan,
    "coverage.json": _coverage,
    "completion.json": _completion,
    "polygons.json": _polygons,
    "stations.json": _stations,
    "things.json": _things,
}
