# SPDX-License-Identifier: MIT
"""Length units of coordinate reference systems: WKT 1 and 2, and the GeoKeys of GeoTIFF."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from scenes.checks import InputError

_FOOT, _US_FOOT = 0.3048, 1200 / 3937
_EPSG_UNITS = {9001: ("metre", 1.0), 9002: ("foot", _FOOT), 9003: ("US survey foot", _US_FOOT)}
_MODEL, _GEOGRAPHIC_MODEL, _PROJECTED_UNIT, _VERTICAL_UNIT = 1024, 2, 3076, 4099
_PROJECTED, _USER_DEFINED = 3072, 32767
_UTM = (range(32601, 32661), range(32701, 32761), range(25828, 25839), range(26901, 26924))  # EPSG
_CARTESIAN = {
    "PROJCS", "PROJCRS", "PROJECTEDCRS", "LOCAL_CS", "ENGCRS", "ENGINEERINGCRS", "GEOCCS",
}  # fmt: skip
_ELLIPSOIDAL = {"GEOGCS", "GEOGCRS", "GEOGRAPHICCRS", "GEODCRS", "GEODETICCRS"}
_VERTICAL = {"VERT_CS", "VERTCRS", "VERTICALCRS"}
_TOKEN = re.compile(
    r'"(?P<name>(?:[^"]|"")*)"|(?P<keyword>[A-Za-z]\w*)\s*[\[(]|(?P<number>(?<!\w)[-+]?\.?\d[\d.eE+-]*)|(?P<end>[\])])'
)


@dataclass(frozen=True, slots=True)
class LengthUnit:
    """Unit of a file's coordinates.

    Attributes
    ----------
    name : str
        As the file states it.
    metres : tuple of 3 float, optional
        Metres of one unit along x, y and z; heights may be in another unit than the plan. None where the file
        names a system or unit by an EPSG code whose length it does not state.
    """

    name: str
    metres: tuple[float, float, float] | None


@dataclass(slots=True)
class _Node:
    keyword: str
    values: list[str] = field(default_factory=list)
    nodes: list[_Node] = field(default_factory=list)


def unit_of_wkt(text: str) -> LengthUnit | None:
    """Return the unit of a coordinate reference system in WKT, None where it states none.

    Heights are in the unit of the vertical system, or else in that of the plan.

    Raises InputError: geographic coordinates, which are degrees.
    """
    root = _parse(text)
    plan = next(_systems(root, _CARTESIAN | _ELLIPSOIDAL), None)
    unit = None if plan is None else _stated(plan)
    if plan is not None and plan.keyword in _ELLIPSOIDAL and unit is None:
        raise degrees_error(plan.values[0] if plan.values else "no name")
    vertical = next(_systems(root, _VERTICAL), None)
    return _joined(unit, None if vertical is None else _stated(vertical))


def unit_of_geokeys(keys: Mapping[int, int]) -> LengthUnit | None:
    """Return the unit that GeoKeys, values by number, state, None where they state none.

    A code of a system alone (ProjectedCSTypeGeoKey) has no unit here, but those of UTM are in metres.

    Raises InputError: geographic coordinates, which are degrees.
    """
    if keys.get(_MODEL) == _GEOGRAPHIC_MODEL:
        raise degrees_error("GTModelType 2")
    plan, vertical = (_EPSG_UNITS.get(keys.get(key, 0)) for key in (_PROJECTED_UNIT, _VERTICAL_UNIT))
    code = keys.get(_PROJECTED_UNIT) or keys.get(_PROJECTED, 0)
    if plan is None and 0 < code < _USER_DEFINED and not any(code in codes for codes in _UTM):
        return LengthUnit(f"EPSG:{code}", None)
    return _joined(plan, vertical)


def degrees_error(name: str) -> InputError:
    """Return the refusal of coordinates in degrees, with what says that they are."""
    return InputError(
        f"its coordinates are degrees of longitude and latitude ({name}); project them to metres first, "
        "as with `pdal translate IN OUT reprojection --filters.reprojection.out_srs=EPSG:CODE`"
    )


def _joined(plan: tuple[str, float] | None, vertical: tuple[str, float] | None) -> LengthUnit | None:
    """One unit of those of the plan and of heights; heights alone say nothing of the plan."""
    if plan is None:
        return None
    up = plan if vertical is None else vertical
    name = plan[0] if up[1] == plan[1] else f"{plan[0]}, heights in {up[0]}"
    return LengthUnit(name, (plan[1], plan[1], up[1]))


def _parse(text: str) -> _Node:
    """The tree of nodes below a nameless root."""
    opened = [_Node("")]
    for token in _TOKEN.finditer(text):
        if token["keyword"]:
            opened[-1].nodes.append(_Node(token["keyword"].upper()))
            opened.append(opened[-1].nodes[-1])
        elif not token["end"]:
            opened[-1].values.append(token["name"] or token["number"] or "")
        elif len(opened) > 1:
            opened.pop()
    return opened[0]


def _systems(root: _Node, keywords: set[str]) -> Iterator[_Node]:
    """The nodes of those keywords, the outermost first: a projected system holds its geographic one."""
    level = [root]
    while level:
        level = [node for parent in level for node in parent.nodes]
        yield from (node for node in level if node.keyword in keywords)


def _stated(system: _Node) -> tuple[str, float] | None:
    """Name and metres of a system's own length unit, or of that of its axes."""
    axes = [node for axis in system.nodes if axis.keyword == "AXIS" for node in axis.nodes]
    length = {"LENGTHUNIT"} if system.keyword in _ELLIPSOIDAL else {"LENGTHUNIT", "UNIT"}
    for node in [*system.nodes, *axes]:
        if node.keyword in length and len(node.values) > 1:
            metres = float(node.values[1])
            if not 0 < metres < float("inf"):
                raise InputError(f"damaged: its unit {node.values[0]!r} has {metres:g} m")
            return node.values[0], metres
    return None
