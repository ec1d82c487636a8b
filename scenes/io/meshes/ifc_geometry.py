# SPDX-License-Identifier: MIT
"""Geometry of an IFC file, or a copy with more properties, by ifcopenshell: a program that `ifc` starts.

A damaged file may make the geometry engine crash, hang or fill the memory; it is this process that then ends.
It imports nothing of ours. Arguments: the file, a folder for the results, and limits as JSON. It prints each
element before that is meshed. Where the folder holds `properties.json`, it writes the copy.
"""

from __future__ import annotations

import json
import sys
import uuid
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

_NO_ELEMENTS = ("IfcFeatureElementSubtraction", "IfcSurfaceFeature", "IfcVirtualElement")
_UPWARDS = (  # inverse attribute, and what it leads to: from an element towards its storey
    ("ContainedInStructure", "RelatingStructure"),
    ("Decomposes", "RelatingObject"),
    ("Nests", "RelatingObject"),
    ("FillsVoids", "RelatingOpeningElement"),
    ("VoidsElements", "RelatingBuildingElement"),
    ("ProjectsElements", "RelatingElement"),
)
_PREFIXES = {
    "EXA": 1e18, "PETA": 1e15, "TERA": 1e12, "GIGA": 1e9, "MEGA": 1e6, "KILO": 1e3, "HECTO": 100.0,
    "DECA": 10.0, "DECI": 0.1, "CENTI": 0.01, "MILLI": 1e-3, "MICRO": 1e-6, "NANO": 1e-9, "PICO": 1e-12,
    "FEMTO": 1e-15, "ATTO": 1e-18,
}  # fmt: skip
_DEEPEST = 50  # units that are defined by units, wholes of wholes
_SETTINGS = {"apply-default-materials": False, "no-normals": True}


def main(path: str, folder: str, most: dict[str, int]) -> None:
    """Write `facts.json` and `mesh.npz`, or `copy.ifc`, into a folder, or an error into `facts.json`."""
    _limit_process(most)
    arrays: dict[str, Any] = {}
    asked = Path(folder, "properties.json")
    try:
        import ifcopenshell

        model = ifcopenshell.open(path)
        if asked.is_file():
            facts: dict[str, Any] = {
                "written": _write_properties(model, **json.loads(asked.read_text("utf-8")))
            }
            model.write(str(Path(folder, "copy.ifc")))
        else:
            facts, arrays = _read(model, most["faces"])
    except Exception as error:
        facts = {"error": str(error) or type(error).__name__}
    np.savez(Path(folder, "mesh.npz"), **arrays)
    Path(folder, "facts.json").write_text(json.dumps(facts), "utf-8")


def _limit_process(most: dict[str, int]) -> None:
    """Have the system end this process when it takes more, where the system can."""
    try:
        import resource
    except ImportError:  # Windows
        return
    for which, bound in ((resource.RLIMIT_DATA, most["bytes"]), (resource.RLIMIT_CPU, most["seconds"])):
        hardest = resource.getrlimit(which)[1]
        resource.setrlimit(which, (bound if hardest < 0 else min(bound, hardest), hardest))


def _read(model: Any, most_faces: int) -> tuple[dict[str, Any], dict[str, Any]]:
    """Facts of a file and the arrays of its elements' mesh, metres in the file's own frame."""
    import ifcopenshell.geom

    settings = ifcopenshell.geom.settings()
    for name, value in _SETTINGS.items():
        settings.set(name, value)
    facts: dict[str, Any] = {
        "schema": model.schema_identifier,
        "unit": _unit(model),
        "conversion": _conversion(model),
        "elements": [],
        "bare": [],
        "faces": 0,
    }
    parts: list[tuple[Any, ...]] = []
    for product in _products(model):
        label = f"{product.is_a()} {product.Name or ''} (#{product.id()})"
        if product.Representation is None:
            facts["bare"] += [] if getattr(product, "IsDecomposedBy", ()) else [label]
            continue
        sys.stdout.write(label.encode("ascii", "replace").decode() + "\n")
        sys.stdout.flush()
        try:
            part = _mesh(ifcopenshell.geom.create_shape(settings, product))
        except RuntimeError:
            facts["bare"].append(label)
            continue
        if not len(part[1]):
            facts["bare"].append(label)
            continue
        parts.append(part)
        facts["elements"].append(_facts(product))
        facts["faces"] += len(part[1])
        if facts["faces"] > most_faces:
            return facts, {}
    return facts, _joined(parts)


def _products(model: Any) -> Iterator[Any]:
    """Elements of a model in the order of their numbers."""
    names = [name for name in ("IfcElement", "IfcProxy") if name in _declared(model)]
    for product in sorted((one for name in names for one in model.by_type(name)), key=lambda one: one.id()):
        if not any(product.is_a(name) for name in _NO_ELEMENTS if name in _declared(model)):
            yield product


def _declared(model: Any) -> set[str]:
    """Names of the schema's entities that matter here."""
    known = set()
    for name in ("IfcElement", "IfcProxy", *_NO_ELEMENTS, "IfcCoordinateOperation"):
        try:
            model.by_type(name)
        except RuntimeError:
            continue
        known.add(name)
    return known


def _mesh(shape: Any) -> tuple[Any, Any, Any, Any]:
    """Vertices (n, 3), faces (m, 3), their colours (m, 4), NaN for none, and the item (m,) of each."""
    geometry = shape.geometry
    vertices = np.frombuffer(geometry.verts_buffer, np.float64).reshape(-1, 3)
    faces = np.frombuffer(geometry.faces_buffer, np.int32).reshape(-1, 3)
    material = np.frombuffer(geometry.material_ids_buffer, np.int32)
    colours = np.frombuffer(geometry.colors_buffer, np.float64).reshape(-1, 4)
    colours = np.vstack([colours, np.full((1, 4), np.nan)])
    material = np.where((material >= 0) & (material < len(colours)), material, -1)
    matrix = np.array(shape.transformation.matrix, np.float64).reshape(4, 4).T
    placed = vertices @ matrix[:3, :3].T + matrix[:3, 3]
    items = np.frombuffer(geometry.item_ids_buffer, np.int32).copy()
    return placed, faces.copy(), colours[material].astype(np.float32), items


def _joined(parts: list[tuple[Any, ...]]) -> dict[str, Any]:
    """Arrays of all elements: vertices and faces one after the other, and how many each element has."""
    if not parts:
        return {}
    vertices, faces, colours, items = zip(*parts, strict=True)
    return {
        "vertices": np.concatenate(vertices),
        "faces": np.concatenate(faces),
        "colours": np.concatenate(colours),
        "items": np.concatenate(items),
        "n_vertices": np.array([len(one) for one in vertices]),
        "n_faces": np.array([len(one) for one in faces]),
    }


def _facts(product: Any) -> dict[str, str]:
    """What an element is, as text."""
    found = [getattr(one, "RelatingType", None) for one in _inverse(product, "IsTypedBy")]
    found += [getattr(one, "RelatingType", None) for one in _inverse(product, "IsDefinedBy")]
    kind = next((one.Name for one in found if one is not None and one.Name), None)
    storey = _storey(product)
    return {
        "ifc_class": product.is_a(),
        "name": product.Name or "",
        "global_id": product.GlobalId or "",
        "storey": "" if storey is None else storey.Name or f"#{storey.id()}",
        "type_name": kind or getattr(product, "ObjectType", None) or "",
    }


def _inverse(entity: Any, name: str) -> Any:
    return getattr(entity, name, None) or ()


def _storey(product: Any) -> Any:
    """The storey that an element is in, by its whole, its host or its room; None where it is in none."""
    for _ in range(_DEEPEST):
        if product is None or product.is_a("IfcBuildingStorey"):
            return product
        above = [getattr(one, far, None) for near, far in _UPWARDS for one in _inverse(product, near)[:1]]
        product = next((one for one in above if one is not None), None)
    return None


def _unit(model: Any) -> dict[str, Any] | None:
    """Name and metres of the unit of length of a file, None where it states none."""
    for project in [*model.by_type("IfcProject"), *_of(model, "IfcProjectLibrary")]:
        for unit in getattr(project.UnitsInContext, "Units", ()):
            if getattr(unit, "UnitType", None) == "LENGTHUNIT":
                return _named_unit(unit)
    return None


def _of(model: Any, name: str) -> Any:
    try:
        return model.by_type(name)
    except RuntimeError:  # unknown to the schema
        return ()


def _named_unit(unit: Any) -> dict[str, Any] | None:
    """Name and metres of a unit of length; None where it has no size."""
    factor = 1.0
    name = unit.Name or ""
    for depth in range(_DEEPEST):
        if unit.is_a("IfcSIUnit"):
            prefix = unit.Prefix or ""
            name = name if depth else (prefix + unit.Name).lower()
            return {"name": name, "metres": factor * _PREFIXES.get(prefix, 1.0)}
        if not unit.is_a("IfcConversionBasedUnit"):
            return None
        factor *= float(unit.ConversionFactor.ValueComponent.wrappedValue)
        unit = unit.ConversionFactor.UnitComponent
    return None


def _conversion(model: Any) -> dict[str, Any] | None:
    """What leads from the file's frame to a map: numbers as in the file; None where nothing does."""
    operations = _of(model, "IfcCoordinateOperation")
    ours = [one for one in operations if getattr(one.SourceCRS, "ContextType", None) == "Model"]
    for operation in [*ours, *operations][:1]:
        held = {name: _number(value) for name, value in operation.get_info().items()}
        system = operation.TargetCRS
        unit = getattr(system, "MapUnit", None)
        crs = {
            "name": getattr(system, "Name", None) or "",
            "unit": None if unit is None else _named_unit(unit),
        }
        return {"class": operation.is_a(), "values": held, "crs": crs}
    sets = {one.Name.lower(): one for one in model.by_type("IfcPropertySet") if one.Name}
    if "epset_mapconversion" not in sets:
        return None
    held, crs = (_properties(sets.get(f"epset_{name}")) for name in ("mapconversion", "projectedcrs"))
    crs = {"name": str(crs.get("Name") or ""), "unit": None, "unit_name": crs.get("MapUnit")}
    return {"class": "ePSet_MapConversion", "values": held, "crs": crs}


def _number(value: Any) -> Any:
    """A measure's number; None for what is none."""
    if getattr(value, "is_a", lambda: "")() == "IfcPlaneAngleMeasure":
        return None
    value = getattr(value, "wrappedValue", value)
    return float(value) if isinstance(value, (int, float)) and not isinstance(value, bool) else None


def _properties(held: Any) -> dict[str, Any]:
    """Values of a property set by name."""
    single = [one for one in getattr(held, "HasProperties", ()) if one.is_a("IfcPropertySingleValue")]
    return {one.Name: getattr(one.NominalValue, "wrappedValue", None) for one in single}


def _write_properties(model: Any, name: str, properties: dict[str, dict[str, tuple[str, Any]]]) -> int:
    """Give elements a property set, in place of one of that name; how many elements have it then."""
    unit = _unit(model)
    metres = 1.0 if unit is None else unit["metres"]
    chosen = [product for product in _products(model) if product.GlobalId in properties]
    for product in chosen:
        _remove_set(model, product, name)
    owner = next(iter(model.by_type("IfcOwnerHistory")), None)
    taken = {one.GlobalId for one in model.by_type("IfcRoot")}
    for product in chosen:
        single = []
        for key, (kind, value) in properties[product.GlobalId].items():
            held = model.create_entity(kind, value / metres if kind == "IfcLengthMeasure" else value)
            single.append(model.create_entity("IfcPropertySingleValue", Name=key, NominalValue=held))
        both = {"OwnerHistory": product.OwnerHistory or owner}
        guid = _guid(f"{name}/{product.GlobalId}", taken)
        given = model.create_entity("IfcPropertySet", guid, **both, Name=name, HasProperties=single)
        relation = {"RelatedObjects": [product], "RelatingPropertyDefinition": given}
        guid = _guid(f"{name}/{product.GlobalId}/relation", taken)
        model.create_entity("IfcRelDefinesByProperties", guid, **both, **relation)
    return len(chosen)


def _remove_set(model: Any, product: Any, name: str) -> None:
    """Take property sets of a name from an element, and out of the file where they are of no other."""
    for relation in list(_inverse(product, "IsDefinedBy")):
        held = getattr(relation, "RelatingPropertyDefinition", None)
        if held is None or not held.is_a("IfcPropertySet") or held.Name != name:
            continue
        others = [one for one in relation.RelatedObjects if one != product]
        if others:
            relation.RelatedObjects = others
            continue
        model.remove(relation)
        if not model.get_total_inverses(held):
            single = list(held.HasProperties)
            model.remove(held)
            for one in single:
                if not model.get_total_inverses(one):
                    model.remove(one)


def _guid(what: str, taken: set[str]) -> str:
    """A GlobalId that follows from what it is of, and is not taken; takes it."""
    import ifcopenshell.guid

    number, found = 0, ""
    while not found or found in taken:
        found = ifcopenshell.guid.compress(uuid.uuid5(uuid.NAMESPACE_URL, f"unseen/{what}/{number}").hex)
        number += 1
    taken.add(found)
    return found


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], json.loads(sys.argv[3]))
