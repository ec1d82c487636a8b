# SPDX-License-Identifier: MIT
"""Catalogue: what there is to furnish a room with, and what belongs in which."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from benchmarks.completion.scenes.houses.furniture import fittings, props, seats, storage, tables
from benchmarks.completion.scenes.houses.furniture.figures import figure
from benchmarks.completion.scenes.houses.furniture.parts import Piece
from benchmarks.completion.scenes.houses.furniture.plants import plant

Maker = Callable[[np.random.Generator], Piece]
Range = tuple[float, float]


def _cabinet(width: Range, depth: Range, height: Range) -> Maker:
    return lambda rng: storage.cabinet(rng, rng.uniform(*width), rng.uniform(*depth), rng.uniform(*height))


def _sized(make: Callable[[np.random.Generator, float], Piece], width: Range) -> Maker:
    return lambda rng: make(rng, rng.uniform(*width))


def _bookshelf(rng: np.random.Generator) -> Piece:
    w, d, h = rng.uniform([0.4, 0.24, 0.7], [1.6, 0.36, 2.2])
    return storage.bookshelf(rng, float(w), float(d), float(h))


def _wall_table(rng: np.random.Generator) -> Piece:
    return tables.table(rng, rng.uniform(0.7, 1.4), rng.uniform(0.4, 0.6))


def _tall_radiator(rng: np.random.Generator) -> Piece:
    return fittings.radiator(rng, rng.uniform(0.4, 0.6), rng.uniform(1.4, 1.8))


def _podium(rng: np.random.Generator) -> Piece:
    return fittings.podium(rng, rng.uniform(0.9, 2.0), rng.uniform(0.6, 1.4))


def _armchair(rng: np.random.Generator) -> Piece:
    return seats.sofa(rng, 1)


def _seated(rng: np.random.Generator) -> Piece:
    """A person on a chair."""
    own = seats.chair(rng)
    high = max(float(one.corners[..., 2].max()) for one in own.parts if one.name == "chair seat")
    return Piece((*own.parts, *figure(rng, seat_m=high).parts))


AT_WALLS: dict[str, Maker] = {
    "cabinet": _cabinet((0.5, 1.4), (0.32, 0.5), (0.6, 1.4)),
    "sideboard": _cabinet((1.0, 2.0), (0.38, 0.5), (0.5, 0.85)),
    "wardrobe": _cabinet((0.8, 2.4), (0.52, 0.64), (1.8, 2.25)),
    "nightstand": _cabinet((0.35, 0.5), (0.33, 0.42), (0.4, 0.6)),
    "bookshelf": _bookshelf,
    "bed": tables.bed,
    "sofa": seats.sofa,
    "desk": tables.desk,
    "wall table": _wall_table,
    "chair": seats.chair,
    "radiator": _sized(fittings.radiator, (0.4, 1.6)),
    "tall radiator": _tall_radiator,
    "counter": _sized(storage.counter, (1.2, 3.4)),
    "fridge": storage.fridge,
    "washing machine": storage.washing_machine,
    "toilet": fittings.toilet,
    "basin": fittings.basin,
    "bath": _sized(fittings.bath, (1.5, 1.8)),
    "shower": fittings.shower_screen,
    "coats": _sized(fittings.coats, (0.5, 1.3)),
    "boxes": props.boxes,
    "bag": props.bag,
    "bin": props.bin_,
    "podium": _podium,
    "parapet": _sized(fittings.parapet, (0.7, 1.5)),
    "floor lamp": fittings.floor_lamp,
    "plant": plant,
    "rack": fittings.drying_rack,
}
AMIDST: dict[str, Maker] = {
    "coffee table": tables.coffee_table,
    "armchair": _armchair,
    "office chair": seats.office_chair,
    "stool": seats.stool,
    "chair": seats.chair,
    "plant": plant,
    "figure": figure,
    "seated figure": _seated,
    "boxes": props.boxes,
    "bag": props.bag,
    "tub": props.tub,
    "rack": fittings.drying_rack,
}


def _words(text: str) -> tuple[str, ...]:
    return tuple(text.split(", "))


USES = {
    "living": _words(
        "sofa, sideboard, bookshelf, sofa, cabinet, floor lamp, plant, desk, bookshelf, radiator"
    ),
    "bedroom": _words(
        "bed, wardrobe, nightstand, cabinet, chair, nightstand, desk, bookshelf, bag, radiator"
    ),
    "kitchen": _words("counter, fridge, counter, cabinet, washing machine, bin, chair, radiator, wall table"),
    "study": _words("desk, bookshelf, bookshelf, cabinet, chair, boxes, plant, sofa, bookshelf, radiator"),
    "bath": _words("bath, basin, toilet, shower, washing machine, cabinet, tall radiator, bin, rack"),
    "hall": _words("coats, cabinet, nightstand, chair, boxes, bookshelf, bag, radiator, plant"),
    "storage": _words("bookshelf, boxes, bookshelf, boxes, cabinet, rack, washing machine, bag, wardrobe"),
}
AMIDST_BY_USE = {
    "living": _words("coffee table, armchair, figure, plant, stool, seated figure"),
    "bedroom": _words("stool, rack, figure, plant, bag"),
    "kitchen": _words("stool, figure, chair"),
    "study": _words("office chair, seated figure, boxes, plant"),
    "bath": _words("stool, tub, figure"),
    "hall": _words("figure, bag, plant"),
    "storage": _words("boxes, tub, boxes, chair, figure"),
}
