# SPDX-License-Identifier: MIT
"""Records: what JSON files of unseen say, for `unseen info`; their manifest tells which is which."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from nbv.run.manifest import manifest_path
from scenes.checks import InputError
from scenes.io.documents import parse_json, read_text
from scenes.io.guard import reading

Content = Mapping[str, Any]


def read_record(path: Path) -> dict[str, Any] | None:
    """Return the content of a JSON file, None where it is a list.

    Raises
    ------
    InputError
        No such file, too large, or neither a JSON object nor a list.
    """
    with reading(path, "JSON"):
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
        found = describe_manifest(read_record(file) or {}) if file.is_file() else None
        if found is not None and path.name in found["outputs"]:
            return found
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
    """Of a scene, or of scans alone, whose unseen surface is told by its boundary."""
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


def _stations(content: Content) -> dict[str, Any]:
    """A tour, and where overlaps were asked after, as many and in how many groups."""
    tour, overlaps = content["tour"], content["overlaps"]
    found = {"kind": "stations", "stations": len(tour["order"]), "tour_m": tour["length_m"]}
    return found if overlaps is None else {**found, "overlaps": len(overlaps), "groups": content["groups"]}


def _fit(content: Content) -> dict[str, Any]:
    names = ("shape", "parameters", "standard_deviation", "rms", "n")
    return {"kind": "fit", **{name: content[name] for name in names}}


_DESCRIBERS: dict[str, Callable[[Content], dict[str, Any]]] = {
    "plan.json": _plan,
    "coverage.json": _coverage,
    "completion.json": _completion,
    "polygons.json": _polygons,
    "stations.json": _stations,
}
