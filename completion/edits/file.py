# SPDX-License-Identifier: MIT
"""Edit files: what a person says of surfaces, as JSON; a `completion.json` with "edits" filled in is one."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any

from completion.edits.edit import ACTIONS, Anchor, Edit
from scenes.checks import InputError, check_coordinates
from scenes.io.checks.documents import read_json
from scenes.io.checks.guard import guard_reading
from scenes.surfaces.plane import Plane

_FIELDS = {
    "accept": ("surface", "outline"),
    "reject": ("surface", "outline"),
    "merge": ("surfaces",),
    "split": ("surface", "plane", "line"),
    "end": ("surface", "plane", "line"),
    "opening": ("surface", "outline"),
}


def read_edits(path: str | PathLike[str]) -> tuple[Edit, ...]:
    """Return the edits of a JSON file, in order.

    The file is an object with a list "edits"; a `completion.json` to which edits were added is such a file.
    Each edit is an object that says what to "do", and to which "surface" (merge: "surfaces")::

        {"do": "reject",  "surface": 3}                    perhaps only inside an "outline": [[x, y, z], ...]
        {"do": "accept",  "surface": 4}                    likewise
        {"do": "merge",   "surfaces": [3, 7]}
        {"do": "split",   "surface": 4, "line": [[x, y, z], [x, y, z]]}
        {"do": "end",     "surface": 5, "plane": {"point": [x, y, z], "normal": [x, y, z]}}
        {"do": "opening", "surface": 2, "outline": [[x, y, z], [x, y, z], [x, y, z], ...]}

    A surface is a point [x, y, z] where it was measured, or a number: the "id" of one of the file's own
    "surfaces", which says by its "anchor" where that is. World coordinates, metres. A "note" may be anything.

    Parameters
    ----------
    path : str or path
        The file.

    Raises
    ------
    InputError
        Not such a file; the message names the file, the edit, counted from 1, and the cure.
    """
    file = Path(path)
    with guard_reading(file, "a file of edits (JSON)"):
        return edits_of(read_json(file, dict), str(file))


def edits_of(held: Mapping[str, Any], source: str) -> tuple[Edit, ...]:
    """Return the edits of such an object, in order; `source` is what messages call it.

    Raises InputError: it is none; the message says which edit, counted from 1, and the cure.
    """
    if not isinstance(held.get("edits"), list):
        raise InputError('holds no list "edits"; write {"edits": [{"do": "reject", "surface": 3}]}')
    anchors = anchors_of(held.get("surfaces", []))
    return tuple(
        _edit(edit, anchors, f"{source}: edit {number}") for number, edit in enumerate(held["edits"], start=1)
    )


def edit_record(edit: Edit) -> dict[str, Any]:
    """Return an edit as files hold it, its surfaces named by points."""
    places = [{"point": anchor.point.tolist(), "kind": anchor.kind} for anchor in edit.surfaces]
    record: dict[str, Any] = {"do": edit.action}
    record |= {"surfaces": places} if edit.action == "merge" else {"surface": places[0]}
    if isinstance(edit.cut, Plane):
        record["plane"] = {"point": edit.cut.point.tolist(), "normal": edit.cut.normal_direction.tolist()}
    elif edit.cut is not None:
        record["line"] = edit.cut.tolist()
    if edit.outline is not None:
        record["outline"] = edit.outline.tolist()
    return record


def anchors_of(surfaces: object) -> dict[int, Anchor]:
    """Return a file's own surfaces by number.

    Raises InputError: they are not as `unseen complete` wrote them.
    """
    if not isinstance(surfaces, list):
        raise InputError('its "surfaces" are no list; leave them as unseen complete wrote them')
    try:
        return {
            int(surface["id"]): Anchor(
                check_coordinates(surface["anchor"]), _kind(surface.get("kind")), f"surface {surface['id']}"
            )
            for surface in surfaces
        }
    except (KeyError, TypeError, AttributeError) as error:
        raise InputError(
            'its "surfaces" have no "id" and "anchor" each; leave them as unseen complete wrote them'
        ) from error


def _edit(entry: object, anchors: Mapping[int, Anchor], source: str) -> Edit:
    if not isinstance(entry, dict) or entry.get("do") not in ACTIONS:
        sentence = f", not {entry['do']!r}" if isinstance(entry, dict) and "do" in entry else ""
        raise InputError(f'{source}: needs a "do" of {", ".join(ACTIONS)}{sentence}')
    action = entry["do"]
    known = _FIELDS[action]
    strange = [name for name in entry if name not in (*known, "do", "note")]
    if strange:
        raise InputError(f"{source}: {action} knows no {strange[0]!r}, only {', '.join(known)}")
    if known[0] not in entry:
        raise InputError(f'{source}: {action} needs "{known[0]}"')
    named = entry[known[0]]
    if action == "merge" and not isinstance(named, list):
        raise InputError(f'{source}: "surfaces" are a list, such as [3, 7], got {named!r}')
    surfaces = named if action == "merge" else [named]
    if "plane" in entry and "line" in entry:
        raise InputError(f"{source}: give a plane or a line, not both")
    try:
        return Edit(
            action=action,
            surfaces=tuple(named_anchor(name, anchors, source) for name in surfaces),
            cut=_cut(entry),
            outline=check_coordinates(entry["outline"]) if "outline" in entry else None,
            source=source,
        )
    except InputError as error:
        text = str(error)
        raise InputError(text if text.startswith(source) else f"{source}: {text}") from error


def named_anchor(name: object, anchors: Mapping[int, Anchor], source: str) -> Anchor:
    """Return the surface that is named by number, by point, or as `edit_record` does.

    Raises InputError, with where it was said: a number that the file does not list, no such point.
    """
    if isinstance(name, dict):
        return Anchor(check_coordinates(name.get("point")), _kind(name.get("kind")))
    if not isinstance(name, int) or isinstance(name, bool):
        return Anchor(check_coordinates(name))
    if name in anchors:
        return anchors[name]
    cure = f"it lists {', '.join(map(str, anchors))}" if anchors else (
        "it lists none; add the edits to the completion.json that the number is from, "
        "or name the surface by a point on it, [x, y, z]"
    )  # fmt: skip
    raise InputError(f"{source}: surface {name} is not among the surfaces of this file: {cure}")


def _cut(record: Mapping[str, Any]) -> Plane | Any | None:
    if "line" in record:
        return check_coordinates(record["line"])
    if "plane" not in record:
        return None
    plane = record["plane"]
    if not isinstance(plane, dict) or not {"point", "normal"} <= plane.keys():
        raise InputError(f'a plane is {{"point": [x, y, z], "normal": [x, y, z]}}, got {plane!r}')
    return Plane(check_coordinates(plane["point"]), check_coordinates(plane["normal"]))


def _kind(value: object) -> str | None:
    if value is not None and not isinstance(value, str):
        raise InputError(f'the "kind" of a surface is a text such as "plane", got {value!r}')
    return value
