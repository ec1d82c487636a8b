# SPDX-License-Identifier: MIT
"""A relation: what surfaces are to each other, what became of it, and relations that a person states."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from os import PathLike
from pathlib import Path
from typing import Any, Generic, Literal, TypeVar, get_args

import numpy as np

from completion.edits.edit import Anchor
from completion.edits.file import anchors_of, named_anchor
from scenes.checks import InputError, Value
from scenes.io.checks.documents import parse_json, read_text
from scenes.io.checks.guard import guard_reading

RelationKind = Literal[
    "parallel",
    "perpendicular",
    "angle",
    "coplanar",
    "coaxial",
    "distance",
    "equal_distance",
    "radius",
    "equal_radius",
    "equal_ring_radius",
    "half_angle",
    "axis_in_plane",
    "tangent",
    "vertical",
    "horizontal",
    "symmetric",
    "regular",
]
KINDS: tuple[RelationKind, ...] = get_args(RelationKind)
VALUED = ("angle", "distance", "radius", "half_angle")
_N_SURFACES = {"radius": 1, "half_angle": 1, "vertical": 1, "horizontal": 1, "equal_distance": 4}
_LEAST = {"regular": 3, "symmetric": 4}  # surfaces, of which there may be more


def kind_text(kind: RelationKind) -> str:
    """A kind of relation in words."""
    return kind.replace("_", " ")


class RelationStatus(Enum):
    """What became of a relation."""

    ACCEPTED = "accepted"
    IMPLIED = "implied"  # inferred, and others say it already
    REDUNDANT = "redundant"  # stated, and others say it already
    REJECTED = "rejected"
    UNDECIDED = "undecided"


@dataclass(frozen=True, slots=True, kw_only=True)
class Relation(Value):
    """A geometric relation between surfaces, for example that two planes are parallel.

    Attributes
    ----------
    kind : str
        "parallel", "perpendicular": plane normals or axes. "angle": angle between them, `value` in radians.
        "coplanar", "coaxial". "distance": between two parallel planes or axes, `value` in metres.
        "equal_distance": the first two are as far apart as the last two. "radius", "half_angle": `value` in
        metres or radians. "equal_radius" (for tori, of the tube); "equal_ring_radius": of the circle at the
        centre of a torus's tube. "axis_in_plane": a plane, then a surface with an axis. "tangent": a plane
        and a cylinder, or two parallel cylinders, that touch. "vertical", "horizontal": a plane or an axis,
        by gravity. "regular": three or more parallel planes or axes at equal distances. "symmetric": two or
        more pairs, listed one after the other; one mirror plane maps the surfaces of each pair onto each
        other (planes, cylinders, spheres).
    surfaces : tuple of int
        Numbers of the surfaces, from 0.
    value : float, optional
        See `kind`.
    is_given : bool
        True if a person stated it, False if it was proposed from the fits.
    is_forbidden : bool
        True if a person stated that it does not hold: it is neither proposed nor imposed.
    status : RelationStatus
        Accepted, rejected, undecided, ...
    p : float
        p-value of the misfit under the relation, given the relations accepted before.
    log_evidence : float
        Log likelihood ratio of the misfit: the relation against unrelated surfaces.
    chi2, rank : float, int
        Squared Mahalanobis norm of the misfit, and the degrees of freedom that the relation removes.
    n_tried : float
        Number of sets of surfaces that were tried for it; more trials lower its evidence.
    reason : str
        Reason for the status, in words.
    conflicts : tuple of int
        Accepted relations that it contradicts, as positions in `RelationGraph.relations`.

    Raises
    ------
    InputError
        An unknown kind, a wrong number of surfaces, a surface named twice, a missing or superfluous value.
    """

    kind: RelationKind
    surfaces: tuple[int, ...]
    value: float | None = None
    is_given: bool = False
    is_forbidden: bool = False
    status: RelationStatus = RelationStatus.UNDECIDED
    p: float = float("nan")
    log_evidence: float = float("nan")
    chi2: float = float("nan")
    rank: int = 0
    n_tried: float = 1.0
    reason: str = ""
    conflicts: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise InputError(f"a relation is one of {', '.join(KINDS)}; got {self.kind!r}")
        self._check_surfaces()
        if (self.value is not None) != (self.kind in VALUED):
            need = "needs a value" if self.kind in VALUED else "has no value"
            raise InputError(f"{self.kind} {need}, got {self.value}")
        if self.value is not None and not (np.isfinite(self.value) and self.value >= 0):
            raise InputError(f"the value of {self.kind} must be a number from 0, got {self.value}")

    def _check_surfaces(self) -> None:
        number = len(self.surfaces)
        different = f"{self.kind} relates different surfaces, got {list(self.surfaces)}"
        if self.kind in _LEAST:
            least = _LEAST[self.kind]
            if number < least or (self.kind == "symmetric" and number % 2):
                need = "pairs of surfaces, two or more" if self.kind == "symmetric" else "3 or more surfaces"
                raise InputError(f"{self.kind} is a relation of {need}, got {number}")
            if len(set(self.surfaces)) < number:
                raise InputError(different)
            return
        n = _N_SURFACES.get(self.kind, 2)
        if number != n:
            raise InputError(f"{self.kind} is a relation of {n} surfaces, got {number}")
        pairs = (self.surfaces[:2], self.surfaces[2:])
        if any(len(set(pair)) < len(pair) for pair in pairs) or (n == 4 and set(pairs[0]) == set(pairs[1])):
            raise InputError(different)

    @property
    def holds(self) -> bool:
        """Whether the surfaces are so in the end."""
        return self.status in (RelationStatus.ACCEPTED, RelationStatus.IMPLIED, RelationStatus.REDUNDANT)


FORMAT = "unseen-relations/1"
_ANGLES = ("angle", "half_angle")
_FIELDS = ("type", "surfaces", "value", "forbidden", "note")
_Named = TypeVar("_Named")


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class StatedRelation(Value, Generic[_Named]):
    """What a person says that surfaces are, or are not, to each other.

    Attributes
    ----------
    kind : str
        See `Relation`.
    surfaces : tuple
        Which: anchors of scans, labels (int) of a part.
    value : float, optional
        Metres or radians; see `Relation`.
    is_forbidden : bool
        Whether it does not hold.
    source : str
        Where it was said, for messages.
    """

    kind: RelationKind
    surfaces: tuple[_Named, ...]
    value: float | None = None
    is_forbidden: bool = False
    source: str = "a stated relation"

    def of(self, numbers: Sequence[int]) -> Relation:
        """Return it as a relation of surfaces by their numbers from 0.

        Raises InputError, with where it was said: a kind or number of surfaces that does not go with it.
        """
        try:
            return Relation(
                kind=self.kind,
                surfaces=tuple(numbers),
                value=self.value,
                is_given=True,
                is_forbidden=self.is_forbidden,
            )
        except InputError as error:
            raise InputError(f"{self.source}: {error}") from error


def read_scan_relations(path: str | PathLike[str]) -> tuple[StatedRelation[Anchor], ...]:
    """Return the relations of a JSON file whose surfaces are places of scans, as `read_edits` takes them.

    Raises InputError: not such a file; the message names the file, the relation and the cure.
    """
    return _read(path, _anchors_in)


def scan_relations_of(held: Mapping[str, Any], source: str) -> tuple[StatedRelation[Anchor], ...]:
    """Return the relations of such an object; `source` is what messages call it.

    Raises InputError: it is none; the message says which relation, counted from 1, and the cure.
    """
    return _relations_of(held, source, _anchors_in)


def relation_record(stated: StatedRelation[Anchor]) -> dict[str, Any]:
    """Return a stated relation as files hold it, its surfaces named by points."""
    places = [{"point": anchor.point.tolist(), "kind": anchor.kind} for anchor in stated.surfaces]
    record: dict[str, Any] = {"type": stated.kind, "surfaces": places}
    if stated.value is not None:
        record["value"] = float(np.degrees(stated.value)) if stated.kind in _ANGLES else stated.value
    return {**record, **({"forbidden": True} if stated.is_forbidden else {})}


def _anchors_in(held: Mapping[str, Any]) -> Callable[[object, str], Anchor]:
    anchors = anchors_of(held.get("surfaces", []))
    return lambda name, source: named_anchor(name, anchors, source)


def read_part_relations(path: str | PathLike[str]) -> tuple[StatedRelation[int], ...]:
    """Return the relations of a JSON file whose surfaces are labels of a part.

    Raises InputError: not such a file; the message names the file, the relation and the cure.
    """

    def label(name: object, source: str) -> int:
        if not isinstance(name, int) or isinstance(name, bool) or name < 1:
            raise InputError(f"{source}: surfaces are labels, whole numbers from 1; got {name!r}")
        return name

    return _read(path, lambda _: label)


def _read(
    path: str | PathLike[str], naming: Callable[[Mapping[str, Any]], Callable[[object, str], _Named]]
) -> tuple[StatedRelation[_Named], ...]:
    file = Path(path)
    with guard_reading(file, "a file of relations (JSON)"):
        text = read_text(file)
        is_list = text.lstrip().startswith("[")
        document = {"relations": parse_json(text, list)} if is_list else parse_json(text, dict)
        if document.get("format", FORMAT) != FORMAT:
            raise InputError(f'its format is {document["format"]!r}; write "format": "{FORMAT}"')
        if document.get("units", "m") != "m":
            raise InputError(f'its units are {document["units"]!r}; values are in metres: write "units": "m"')
        return _relations_of(document, str(file), naming)


def _relations_of(
    document: Mapping[str, Any],
    source: str,
    naming: Callable[[Mapping[str, Any]], Callable[[object, str], _Named]],
) -> tuple[StatedRelation[_Named], ...]:
    relations = document.get("relations")
    if not isinstance(relations, list):
        raise InputError('holds no list "relations"; write [{"type": "parallel", "surfaces": [1, 2]}]')
    name = naming(document)
    every = [
        _parse_relation(relation, name, f"{source}: relation {number}")
        for number, relation in enumerate(relations, start=1)
    ]
    return tuple(relation for relation in every if relation is not None)


def _parse_relation(
    entry: object, name: Callable[[object, str], _Named], source: str
) -> StatedRelation[_Named] | None:
    """A relation of a file; None where it was written by `unseen`, which found that it does not hold."""
    if not isinstance(entry, dict) or entry.get("type") not in KINDS:
        sentence = f", not {entry['type']!r}" if isinstance(entry, dict) and "type" in entry else ""
        raise InputError(f'{source}: needs a "type" of {", ".join(KINDS)}{sentence}')
    strange = [field for field in entry if field not in _KNOWN]
    if strange:
        raise InputError(f"{source}: a relation knows no {strange[0]!r}, only {', '.join(_FIELDS)}")
    if entry.get("status") in ("rejected", "undecided") and not entry.get("given"):
        return None
    kind, surfaces, value = entry["type"], entry.get("surfaces"), entry.get("value")
    if not isinstance(surfaces, list):
        raise InputError(f'{source}: "surfaces" are a list, got {surfaces!r}')
    if value is not None:
        if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
            raise InputError(f'{source}: "value" is a number, got {value!r}')
        value = None if kind not in VALUED else float(np.radians(value)) if kind in _ANGLES else float(value)
    forbidden = entry.get("forbidden", False)
    if not isinstance(forbidden, bool):
        raise InputError(f'{source}: "forbidden" is true or false, got {forbidden!r}')
    return StatedRelation(
        kind=kind,
        surfaces=tuple(name(surface, source) for surface in surfaces),
        value=value,
        is_forbidden=forbidden,
        source=source,
    )


_WRITTEN = ("status", "p", "log_evidence", "given", "reason", "conflicts", "before", "after",
            "spacing_m", "mirror")  # fmt: skip
_KNOWN = (*_FIELDS, *_WRITTEN)
