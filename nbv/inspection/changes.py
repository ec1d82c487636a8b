# SPDX-License-Identifier: MIT
"""Changes between two checks of one design: of verdicts, of offsets beyond both intervals, and of extras."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from completion.asbuilt.findings import DesignCheck, Extra, Interval
from nbv.inspection.record import FORMAT, check_record, element_label
from scenes.checks import InputError, Value
from scenes.mesh.design import Element

_UNMEASURED = ("hidden", "not seen")
_PARALLEL = 0.9  # cosine of directions of one offset
_NEAR_M = 0.05  # a cell of extras: boxes that are so close overlap
_SAME_BOX = 0.3  # of the smaller box, in the larger: one extra


@dataclass(frozen=True, slots=True, eq=False)
class Change(Value):
    """What is no more as it was.

    Attributes
    ----------
    element : str
        Class and name of an element, or the name of an extra.
    before, now : str
        Verdicts; "extra" of extras; "" where it is not there.
    difference : Interval, optional
        Of the offset, now minus before, metres. It is 0 nowhere if the two intervals have nothing in common.
    sentence : str
        What changed, in numbers.
    surface : int
        Surface id in the design of now, -1 for none.
    """

    element: str
    before: str
    now: str
    difference: Interval | None
    sentence: str
    surface: int = -1


def changes_since(before: Mapping[str, Any], check: DesignCheck) -> list[Change]:
    """Return what changed since an earlier check: elements in the design's order, those gone, extras.

    Elements are the same by their GlobalId, else by class, name and order; extras where boxes share more than
    0.3 of the smaller one. `before` is the JSON of an earlier `check_record`.

    Raises
    ------
    InputError
        `before` is none, or is damaged.
    """
    if before.get("format") != FORMAT:
        raise InputError(
            f"is no check of a design: its format is {before.get('format')!r}, not {FORMAT!r}; "
            "name the check.json of an earlier check"
        )
    try:
        changes = list(_changes(before, check))
    except (KeyError, TypeError, ValueError, AttributeError, IndexError) as error:
        raise InputError(
            f"is a damaged check: {type(error).__name__} at {error}; check that design again"
        ) from error
    if (
        check.elements
        and changes
        and {one.surface for one in changes if not one.before} >= {one.surface for one in check.elements}
    ):
        raise InputError(f"is of another design: none of its elements is in {check.design.name}")
    return changes


def _changes(before: Mapping[str, Any], check: DesignCheck) -> Iterator[Change]:
    earlier, now = (_by_identity(held["elements"]) for held in (before, check_record(check)))
    for key, held in now.items():
        change = _element_change(earlier.get(key), held)
        if change is not None:
            yield change
    for key, held in earlier.items():
        if key not in now:
            label, was = _label(held), str(held["verdict"])
            yield Change(label, was, "", None, f"{label}: not checked any more, {was} before.")
    yield from _extra_changes(before["extra"], check.extra)


def _by_identity(elements: list[dict[str, Any]]) -> dict[tuple[str, ...], dict[str, Any]]:
    """Elements by what they are known by: their GlobalId where they have one of their own."""
    found: dict[tuple[str, ...], dict[str, Any]] = {}
    for held in elements:
        key: tuple[str, ...] = (str(held["global_id"]),)
        if not key[0] or key in found:
            kind = (str(held["class"]), str(held["name"]))
            key = (*kind, str(sum(one[:2] == kind for one in found)))
        found[key] = held
    return found


def _label(held: Mapping[str, Any]) -> str:
    return element_label(Element(str(held["name"]), str(held["class"])))


def _element_change(earlier: Mapping[str, Any] | None, held: Mapping[str, Any]) -> Change | None:
    """What changed of one element, None for nothing."""
    label, now, surface = _label(held), str(held["verdict"]), int(held["surface"])
    if earlier is None:
        return Change(label, "", now, None, f"{label}: not checked before, {now} now.", surface=surface)
    was, difference = str(earlier["verdict"]), _difference(earlier["offset_m"], held["offset_m"])
    is_other = difference is not None and not difference.low <= 0 <= difference.high
    if was == now and not is_other:
        return None
    sentence = f"{was} before, {now} now"
    if was == now:
        sentence = f"{now} as before"
    elif was in _UNMEASURED and now not in _UNMEASURED:
        sentence = f"measured for the first time, {sentence}"
    elif now in _UNMEASURED and was not in _UNMEASURED:
        sentence = f"not measured any more, {sentence}"
    if difference is not None:
        told = "its offset changed by" if is_other else "its offset may be the same, difference"
        sentence += f"; {told} {difference.sentence()}"
    return Change(label, was, now, difference, f"{label}: {sentence}.", surface=surface)


def _difference(earlier: Mapping[str, Any] | None, now: Mapping[str, Any] | None) -> Interval | None:
    """How much an offset grew; None where two along one direction are not known."""
    if earlier is None or now is None:
        return None
    old, new = (np.array([held[key] for key in ("value", "low", "high")], float) for held in (earlier, now))
    along = now.get("along")
    if along is not None and earlier.get("along") is not None:
        cosine = float(np.dot(along, earlier["along"]))
        if abs(cosine) < _PARALLEL:
            return None
        old = old if cosine > 0 else -old[[0, 2, 1]]
    value, low, high = (new - old[[0, 2, 1]]).tolist()
    if not np.isfinite([value, low, high]).all():
        return None
    return Interval(value, low, high, None if along is None else (along[0], along[1], along[2]))


def _extra_changes(earlier: list[dict[str, Any]], extras: tuple[Extra, ...]) -> Iterator[Change]:
    """Extras that are new, and those that were found before alone."""
    old = np.array([held["box_m"] for held in earlier], float).reshape(-1, 2, 3)
    new = np.array([extra.box_m for extra in extras], float).reshape(-1, 2, 3)
    is_same = _same_boxes(old, new)
    for extra in np.array(extras, object)[~is_same.any(axis=0)]:
        near = f", near {extra.near}" if extra.near else ""
        yield Change(
            extra.name, "", "extra", None, f"{extra.name} is new: {extra.area_m2:.2f} m2 of no element{near}."
        )
    for k in np.flatnonzero(~is_same.any(axis=1)):
        name, area = str(earlier[k]["id"]), float(earlier[k]["area_m2"])
        yield Change(
            name, "extra", "", None, f"{name} of the earlier check ({area:.2f} m2) was not found again."
        )


def _same_boxes(old: Any, new: Any) -> Any:
    """Whether boxes (n, 2, 3) and (m, 2, 3) are of one extra (n, m)."""
    grown = [boxes + np.array([[-_NEAR_M], [_NEAR_M]]) for boxes in (old, new)]
    low = np.maximum(grown[0][:, None, 0], grown[1][None, :, 0])
    high = np.minimum(grown[0][:, None, 1], grown[1][None, :, 1])
    shared = np.prod(np.maximum(high - low, 0.0), axis=2)
    sizes = [np.prod(boxes[:, 1] - boxes[:, 0], axis=1) for boxes in grown]
    return shared > _SAME_BOX * np.minimum(sizes[0][:, None], sizes[1][None, :])
