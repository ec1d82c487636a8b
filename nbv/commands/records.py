# SPDX-License-Identifier: MIT
"""Records: what the JSON files that unseen writes say, in a few lines for `unseen info`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from scenes.checks import InputError
from scenes.formats.documents import parse_json, read_text
from scenes.formats.guard import reading

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


def describe_record(content: Content) -> dict[str, Any] | None:
    """Return kind and headline numbers of what a file of ours holds, None for files of others.

    Raises
    ------
    InputError
        A file of ours in which an entry is missing or of the wrong kind.
    """
    for keys, describer in _DESCRIBERS:
        if keys <= content.keys():
            try:
                return describer(content)
            except (KeyError, TypeError, AttributeError, IndexError) as error:
                raise InputError(f"looks like a file of unseen, but is damaged: {error!r}") from error
    return None


def _manifest(content: Content) -> dict[str, Any]:
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
    return {
        "kind": "stations",
        "stations": len(content["tour"]["order"]),
        "tour_m": content["tour"]["length_m"],
        "overlaps": len(content["overlaps"]),
        "groups": content["groups"],
    }


def _fit(content: Content) -> dict[str, Any]:
    names = ("shape", "parameters", "standard_deviation", "rms", "n")
    return {"kind": "fit", **{name: content[name] for name in names}}


def _camera(content: Content) -> dict[str, Any]:
    return {"kind": "camera", **{key: value for key, value in content.items() if not isinstance(value, dict)}}


_DESCRIBERS: tuple[tuple[set[str], Callable[[Content], dict[str, Any]]], ...] = (
    ({"command", "versions", "outputs"}, _manifest),
    ({"views", "method", "sensor"}, _plan),
    ({"met", "surfaces", "requirement"}, _coverage),
    ({"surface", "boundary", "voxel_m"}, _scan_coverage),
    ({"surfaces", "hypothesised_m2"}, _completion),
    ({"format", "unit", "surfaces"}, _polygons),
    ({"tour", "overlaps"}, _stations),
    ({"shape", "parameters"}, _fit),
    ({"fx", "fy"}, _camera),
    ({"intrinsic_matrix"}, _camera),
)
