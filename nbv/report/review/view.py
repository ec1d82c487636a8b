# SPDX-License-Identifier: MIT
"""3-D view of a review: what was measured, once; what is inferred and unknown, after each statement."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from completion.boundary.meshing import mesh_cells
from completion.extension.patch import Patch
from completion.result.completion import Completion
from nbv.report.viewer.layers import Classes, Layer, Viewer, confidence_channel, deviation_channel
from nbv.report.viewer.markers import opening_lines
from nbv.report.viewer.scan_views import completion_view, provenance_categories, surface_names
from nbv.report.viewer.things_layer import things_layer
from nbv.report.viewer.unknown_layer import INFERRED, STATES, unknown_layer

_STATIC = ("measured", "occluders")  # layers of what no statement changes


def first_view(completion: Completion) -> Viewer:
    """Return the view of the completion that is reviewed: of its light model, coloured by state."""
    room = completion.completed.room
    view = completion_view(completion, is_room=bool(room.walls) and len(completion.observations) > 1)
    return replace(view, mode="state", layers=tuple(one for one in view.layers if one.key in _STATIC))


def view_after(first: Viewer, completion: Completion) -> Viewer:
    """Return the view with the inferred and unknown area of another completion of the same scans."""
    names, world = surface_names(completion), completion.drawing_from_reference
    layers = [*first.layers, _inferred_layer(completion), unknown_layer(completion, names)]
    layers.append(things_layer(completion, names))
    outlines = [world.apply(hole.points) for surface in completion.surfaces for hole in surface.openings]
    return replace(
        first, layers=tuple(one for one in layers if len(one.faces)), lines=opening_lines(outlines)
    )


def _inferred_layer(completion: Completion) -> Layer:
    """Inferred cells as they are, each rectangle of one provenance by itself."""
    names, world = surface_names(completion), completion.drawing_from_reference
    vertices, faces, number, why, sure, sd = [np.zeros((0, 3))], [np.zeros((0, 3), np.int64)], [], [], [], []
    start = 0
    for k, patch in enumerate(completion.patches, start=1):
        for kind in np.unique(patch.provenance[patch.hypothesised]).tolist():
            part = mesh_cells(
                patch.grid, patch.hypothesised & (patch.provenance == kind), patch.limits.cuts, merged=True
            )
            middle = part.vertices[part.faces].mean(axis=1)
            vertices.append(part.vertices)
            faces.append(part.faces.astype(np.int64) + start)
            start += len(part.vertices)
            number.append(np.full(len(middle), k))
            why.append(np.full(len(middle), kind))
            sure.append(_confidence(patch, middle))
            sd.append(patch.stated.standard_deviation(middle))
    none = np.zeros(0)
    deviation = 1000 * np.concatenate([none, *sd])
    return Layer(
        "inferred",
        "inferred",
        world.apply(np.concatenate(vertices)),
        np.concatenate(faces),
        INFERRED,
        channels=(
            Classes("state", "State", STATES, np.full(len(deviation), STATES.index(INFERRED), np.uint16)),
            Classes("provenance", "Why it is there", provenance_categories(), _numbers(why)),
            deviation_channel(deviation, float(deviation.max(initial=0))),
            confidence_channel(np.concatenate([none, *sure])),
            Classes("surface", "Surface", names, _numbers(number)),
        ),
        is_marked=True,
    )


def _numbers(parts: list[np.ndarray]) -> np.ndarray:
    return np.concatenate([np.zeros(0, np.int64), *parts]).astype(np.uint16)


def _confidence(patch: Patch, places: np.ndarray) -> np.ndarray:
    """Confidence (n,) of the cells at places (n, 3), working frame."""
    sure = np.ones(len(places))
    index, cell = patch.grid.cells_of(places)
    sure[index] = patch.confidence.ravel()[cell]
    return sure
