# SPDX-License-Identifier: MIT
"""Products: elements with geometry, colours, properties, quantities, openings and what fills these."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from completion.export.building.limits import MEASURED_SHARE
from completion.export.building.model import BuildingElement, OpeningOutline
from completion.export.ifc_entities import Ref, Shapes, StepText, TypedValue, Word
from scenes.checks import FloatArray

State = Literal["measured", "inferred", "partly"]
_RATIO = "IfcNormalisedRatioMeasure"
_MEASURES = {
    "Length": ("IfcQuantityLength", 1),
    "Area": ("IfcQuantityArea", 2),
    "Volume": ("IfcQuantityVolume", 3),
}


@dataclass(frozen=True, slots=True, eq=False)
class ProductEvidence:
    """What is known of an element.

    Attributes
    ----------
    surfaces : tuple of int
        Numbers of the surfaces that it consists of, as in completion.json.
    measured_share : float or None
        Of its area; None of what is no surface.
    sd_m : float or None
        Standard deviation of what it says most about: a thickness, a radius, or the place of a surface along
        its normal; None where it is not known.
    confidence : float or None
        Probability that it is there, by area; 1 where it was measured. None where nobody reckoned it.
    more : mapping
        Further properties: texts and numbers by name.
    """

    surfaces: tuple[int, ...]
    measured_share: float | None
    sd_m: float | None
    confidence: float | None
    more: Mapping[str, str | float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Quantity:
    """A length, an area or a volume: its name in the set of quantities, and its value in metres."""

    name: str
    measure: Literal["Length", "Area", "Volume"]
    value: float


def state_of(share: float) -> State:
    """Return what a measured share is called."""
    return "measured" if share >= MEASURED_SHARE else "inferred" if share <= 1 - MEASURED_SHARE else "partly"


def mean_confidence(element: BuildingElement) -> float:
    """Return the mean confidence of a surface's cells."""
    patch = element.patch
    known = patch.observed | patch.hypothesised
    return float(patch.confidence[known].mean()) if known.any() else 0.0


def deviation_at(element: BuildingElement, place: FloatArray) -> float | None:
    """Return a surface's standard deviation along its normal at a place (3,); None where it is not known."""
    sd = element.sd_m(place)
    return sd if np.isfinite(sd) else None


def property_set(file: StepText, key: str, known: ProductEvidence) -> Ref:
    """Return the property set of what is known of an element."""
    values = [("Surfaces", TypedValue("IfcText", ", ".join(map(str, known.surfaces))))]
    if known.measured_share is not None:
        values.append(("State", TypedValue("IfcLabel", state_of(known.measured_share))))
        values.append(("MeasuredShare", TypedValue(_RATIO, _ratio(known.measured_share))))
    if known.confidence is not None:
        values.append(("Confidence", TypedValue(_RATIO, _ratio(known.confidence))))
    if known.sd_m is not None and np.isfinite(known.sd_m):
        values.append(("StandardDeviation_mm", TypedValue("IfcReal", 1e3 * known.sd_m)))
    for name, value in known.more.items():
        typed = (
            TypedValue("IfcText", value) if isinstance(value, str) else TypedValue("IfcReal", float(value))
        )
        values.append((name, typed))
    single = [file.add("IfcPropertySingleValue", [name, None, value, None]) for name, value in values]
    identifier = file.guid(f"{key} evidence")
    return file.add("IfcPropertySet", [identifier, None, "Unseen_Evidence", None, single])


def quantity_set(shapes: Shapes, key: str, name: str, quantities: Sequence[Quantity]) -> Ref:
    """Return a set of quantities, in the file's units."""
    file, refs = shapes.file, []
    for quantity in quantities:
        entity, power = _MEASURES[quantity.measure]
        values = [quantity.name, None, None, quantity.value * shapes.metre**power, None]
        refs.append(file.add(entity, values, alone=True))
    identifier = file.guid(f"{key} quantities")
    return file.add("IfcElementQuantity", [identifier, None, name, None, "BaseQuantities", refs])


def _ratio(share: float) -> float:
    return min(max(share, 0.0), 1.0)


COLOURS: dict[str, tuple[tuple[float, float, float], float]] = {
    "measured": ((0.80, 0.78, 0.74), 0.0),
    "inferred": ((0.12, 0.37, 0.75), 0.0),
    "partly": ((0.46, 0.58, 0.75), 0.0),
    "unknown": ((0.86, 0.86, 0.86), 0.5),
    "space": ((0.55, 0.75, 0.55), 0.8),
}
"""Red, green, blue, and transparency: what was inferred is blue in all pictures of a completion."""

Representation = Literal["SweptSolid", "Tessellation", "Curve3D"]


@dataclass(frozen=True, slots=True, eq=False)
class ProductPiece:
    """Geometry of one colour."""

    items: Sequence[Ref]
    state: State | Literal["space", "unknown"]


@dataclass(frozen=True, slots=True, eq=False)
class Hole:
    """An opening in an element.

    Attributes
    ----------
    outline : OpeningOutline
        What it is.
    items : sequence of Ref
        What the body, or the surface, leaves out.
    representation : str
        "SweptSolid" of a body, "Curve3D" of an outline.
    depth_m : float or None
        Thickness of the body; None where it is not known.
    filling : str or None
        Class of what closes it; None where that is not known.
    """

    outline: OpeningOutline
    items: Sequence[Ref]
    representation: Representation
    depth_m: float | None
    filling: Literal["IfcDoor", "IfcWindow"] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Product:
    """An element.

    Attributes
    ----------
    key : str
        What it is and which, unique in the file; its name, too.
    entity, predefined : str
        Its class, and its kind in that.
    described : str
        A sentence.
    representation : str
        What its items are.
    pieces : tuple of Piece
        Geometry by colour.
    evidence : Evidence
        What is known of it.
    quantities_of : str
        Name of the set of quantities.
    quantities : tuple of Quantity
        In it.
    holes : tuple of Hole
        Openings.
    """

    key: str
    entity: str
    predefined: str
    described: str
    representation: Representation
    pieces: tuple[ProductPiece, ...]
    evidence: ProductEvidence
    quantities_of: str
    quantities: tuple[Quantity, ...]
    holes: tuple[Hole, ...] = field(default=())


@dataclass(frozen=True, slots=True, eq=False)
class Contexts:
    """Where geometry belongs: bodies, outlines on the floor and upright, and what is only referred to."""

    body: Ref
    foot_print: Ref
    reference: Ref
    profile: Ref


def write_product(shapes: Shapes, contexts: Contexts, above: Ref, product: Product) -> list[Ref]:
    """Return a product below a placement, and the doors and windows in it."""
    file = shapes.file
    items = [item for piece in product.pieces for item in piece.items]
    for piece in product.pieces:
        for item in piece.items:
            file.add("IfcStyledItem", [item, [_style(file, piece.state)], None])
    shape = product_shape(file, [(contexts.body, "Body", product.representation, items)])
    tag = "-".join(map(str, product.evidence.surfaces))
    placement = shapes.placement(above)
    values = [*_product_attributes(file, product.key, product.described), placement, shape, tag]
    element = file.add(product.entity, [*values, Word(product.predefined)])
    define(shapes, product.key, element, product.evidence, (product.quantities_of, product.quantities))
    written = [element]
    for k, hole in enumerate(product.holes, start=1):
        key = f"{product.key} opening {k}"
        opening_at = shapes.placement(placement)
        opening = _write_hole(shapes, contexts, opening_at, (element, hole), key)
        if hole.filling is not None:
            written.append(_write_filling(shapes, contexts, opening_at, (opening, hole), key))
    return written


def product_shape(
    file: StepText, representations: Sequence[tuple[Ref, str, Representation, Sequence[Ref]]]
) -> Ref | None:
    """Return a product's shape of representations: context, identifier, type, items; None of nothing."""
    shapes = [
        file.add("IfcShapeRepresentation", [context, identifier, kind, list(items)], alone=True)
        for context, identifier, kind, items in representations
        if items
    ]
    return file.add("IfcProductDefinitionShape", [None, None, shapes]) if shapes else None


def define(
    shapes: Shapes,
    key: str,
    element: Ref,
    known: ProductEvidence,
    quantities: tuple[str, Sequence[Quantity]],
) -> None:
    """Attach what is known of an element, and its quantities where there are any."""
    file = shapes.file
    definitions = [property_set(file, key, known)]
    if quantities[1]:
        definitions.append(quantity_set(shapes, key, *quantities))
    for k, definition in enumerate(definitions):
        identifier = file.guid(f"{key} definition {k}")
        file.add("IfcRelDefinesByProperties", [identifier, None, None, None, [element], definition])


def _write_hole(shapes: Shapes, contexts: Contexts, placement: Ref, of: tuple[Ref, Hole], key: str) -> Ref:
    """An opening, whose shape is only referred to: that of its element leaves it out already."""
    element, hole = of
    file, outline = shapes.file, hole.outline
    shape = product_shape(file, [(contexts.reference, "Reference", hole.representation, hole.items)])
    sentence = f"{outline.kind} by its place and size; nothing else says so"
    values = [*_product_attributes(file, key, sentence), placement, shape, None, Word("OPENING")]
    opening = file.add("IfcOpeningElement", values)
    file.add("IfcRelVoidsElement", [file.guid(f"{key} voids"), None, None, None, element, opening])
    known = ProductEvidence((outline.surface,), None, None, None, more={"Guess": outline.kind})
    lengths = [("Width", outline.width_m), ("Height", outline.height_m)]
    if hole.depth_m is not None:
        lengths.append(("Depth", hole.depth_m))
    quantities = [Quantity(name, "Length", value) for name, value in lengths]
    define(shapes, key, opening, known, ("Qto_OpeningElementBaseQuantities", quantities))
    return opening


_FILLINGS = {
    "IfcDoor": ("DOOR", "Qto_DoorBaseQuantities"),
    "IfcWindow": ("WINDOW", "Qto_WindowBaseQuantities"),
}


def _write_filling(
    shapes: Shapes, contexts: Contexts, opening_at: Ref, of: tuple[Ref, Hole], key: str
) -> Ref:
    """The door or window of an opening: its outline, since beams saw the hole and no leaf."""
    opening, hole = of
    file, outline, entity = shapes.file, hole.outline, str(hole.filling)
    predefined, quantities_of = _FILLINGS[entity]
    lines = [shapes.world_loop(outline.points)]
    shape = product_shape(file, [(contexts.profile, "Profile", "Curve3D", lines)])
    key = f"{key} {predefined.lower()}"
    sizes = [shapes.metre * size for size in (outline.height_m, outline.width_m)]
    values = [
        *_product_attributes(file, key, "inferred from its opening; no leaf or pane was measured"),
        shapes.placement(opening_at), shape, None, *sizes, Word(predefined), Word("NOTDEFINED"), None,
    ]  # fmt: skip
    element = file.add(entity, values)
    file.add("IfcRelFillsElement", [file.guid(f"{key} fills"), None, None, None, opening, element])
    basis = "reaches down to the floor" if entity == "IfcDoor" else "begins above a sill"
    known = ProductEvidence((outline.surface,), 0.0, None, None, more={"Basis": f"the opening {basis}"})
    lengths = [Quantity("Width", "Length", outline.width_m), Quantity("Height", "Length", outline.height_m)]
    area = Quantity("Area", "Area", outline.width_m * outline.height_m)
    define(shapes, key, element, known, (quantities_of, [*lengths, area]))
    return element


def _product_attributes(file: StepText, key: str, sentence: str) -> list[Ref | str | None]:
    """The attributes that all products begin with."""
    return [file.guid(key), None, key, sentence, None]


def _style(file: StepText, state: str) -> Ref:
    colour, transparency = COLOURS[state]
    rgb = file.add("IfcColourRgb", [None, *colour])
    shading = file.add("IfcSurfaceStyleShading", [rgb, transparency])
    return file.add("IfcSurfaceStyle", [state, Word("BOTH"), [shading]])
