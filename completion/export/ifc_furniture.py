# SPDX-License-Identifier: MIT
"""Furniture for IFC: a thing that stands in a room, closed: measured, inferred and unknown faces."""

from __future__ import annotations

import numpy as np

from completion.export.building.things import STATES, BuildingThing
from completion.export.ifc_entities import Shapes
from completion.export.ifc_products import Product, ProductEvidence, ProductPiece, Quantity


def furniture_product(shapes: Shapes, thing: BuildingThing) -> Product:
    """Return a thing as one object with its closed shape: measured, inferred and unknown faces."""
    corners = thing.vertices[thing.faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    known = {state: float(area[thing.state == k].sum()) for k, state in enumerate(STATES)}
    more: dict[str, str | float] = {
        "Thing": str(thing.number),
        "InferredShare": known["inferred"] / sum(known.values()),
        "UnknownShare": known["unknown"] / sum(known.values()),
        "VolumeLeast_m3": thing.volume.least,
        "VolumeMost_m3": thing.volume.most,
    }
    quantities = []
    for name in ("Width", "Depth", "Height"):
        extent = getattr(thing.extents, name.lower())
        more |= {f"{name}Why": extent.why, f"{name}Least_mm": 1e3 * extent.least}
        if extent.most is not None:
            more[f"{name}Most_mm"] = 1e3 * extent.most
            quantities.append(Quantity(name, "Length", extent.estimate))
    return Product(
        key=f"Thing {thing.number}",
        entity="IfcFurniture",
        predefined="NOTDEFINED",
        described="stands in a room; closed by symmetry where one is sure, else by what bounds it",
        representation="Tessellation",
        pieces=tuple(
            ProductPiece(shapes.triangles(thing.vertices, thing.faces[thing.state == k]), state)
            for k, state in enumerate(STATES)
        ),
        evidence=ProductEvidence(
            surfaces=thing.surfaces,
            measured_share=known["measured"] / sum(known.values()),
            sd_m=None,
            confidence=None,
            more=more,
        ),
        quantities_of="Unseen_FurnitureQuantities",
        quantities=(*quantities, Quantity("GrossVolume", "Volume", thing.volume.closed)),
    )
