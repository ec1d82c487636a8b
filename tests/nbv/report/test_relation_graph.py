# SPDX-License-Identifier: MIT
"""The drawing of relations: the same bytes again, and other bytes for what was rejected."""

from __future__ import annotations

import io

import numpy as np
from PIL import Image

from completion.relations.pipeline import infer
from completion.relations.relation import Relation
from nbv.report.part_report import relation_graph
from scenes.surfaces.catalogue import Cylinder, Plane, Sphere
from tests.helpers.part_examples import exact

SURFACES = [
    Plane((0, 0, 0), (0, 0, 1), (1, 0, 0)),
    *(Plane((float(k), 0, 0), (1, 0, 0), (0, 1, 0)) for k in range(4)),
    Cylinder((0, 5, 0), (0, 0, 1), 0.3),
    Cylinder((3, 5, 0), (0, 0, 1), 0.3),
    Sphere((1, 1, 1), 0.3),
]


def red(png: bytes) -> int:
    """How many pixels have the colour of what was rejected."""
    pixels = np.asarray(Image.open(io.BytesIO(png)).convert("RGBA")).astype(int)
    return int((np.abs(pixels[..., :3] - [0xC8, 0x32, 0x2B]).max(axis=2) < 25)[pixels[..., 3] > 60].sum())


def test_what_was_rejected_is_seen():
    names = list(range(1, len(SURFACES) + 1))
    graph = infer([exact(one, 1e-4) for one in SURFACES])
    plot = relation_graph(graph, names, names)
    assert plot.light == relation_graph(graph, names, names).light
    wrong = Relation(kind="distance", surfaces=(1, 2), value=1.2)
    stated = infer([exact(one, 1e-4) for one in SURFACES], [wrong])
    assert red(relation_graph(stated, names, names).light) > red(plot.light) + 20


def test_surfaces_without_relations_are_drawn():
    plot = relation_graph(infer([exact(SURFACES[-1])]), [1], [1])
    assert Image.open(io.BytesIO(plot.light)).size == (plot.width, plot.height)
