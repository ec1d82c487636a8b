# SPDX-License-Identifier: MIT
"""Panels on one page: from completed surfaces to facets that meet in their fold edges."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from completion.panels.arrangement import arrange
from completion.panels.fold import find_folds
from completion.panels.fold_edge import close_corners, corner_point, fold_edge
from completion.panels.model import PanelModel
from completion.panels.outline import NearOutline, OutlineCells
from completion.panels.sheet import Sheet
from completion.panels.slim_face import slim_folds
from completion.panels.welding import edges_of, weld
from scenes.checks import FloatArray


def build_panels(
    sheets: Sequence[Sheet], outline: Callable[[int], OutlineCells], rest: FloatArray
) -> PanelModel:
    """Build the light model of completed surfaces (fold-seeded triangulation, McCormick & Fisher 2002).

    Folds are not looked for in a mesh: they are the intersections of surfaces that are known already, and the
    mesh is made to have them.

    Parameters
    ----------
    sheets : sequence of Sheet
        The surfaces as areas of their charts, in the order of their numbers.
    outline : callable
        What is known of the outline of the surface of a number, from 0.
    rest : (n, 3) float
        Measured points that belong to no surface, metres.
    """
    # 1. Fold: find the stretches of curves that two surfaces reach, and on which sides of them they go on.
    found = find_folds(sheets)

    # 2. Close: a fold that ends near a third surface ends at it, so that corners are points.
    folds, corners = close_corners(found, sheets)

    # 3. Arrange: fill each surface up to its folds, cut off what lies beyond, and divide its chart by its
    #    outline, the borders between measured and inferred, its folds, and the facets of cylinders.
    charts = [
        arrange(sheet, [fold for fold in folds if sheet.number in (fold.first, fold.second)])
        for sheet in sheets
    ]

    # 4. Weld: give both surfaces of a fold the same nodes, triangulate without further points, and join.
    facets = weld(charts)

    # 5. Find the folds at which faces begin that are too slim to be surfaces, as the sides of a board.
    edges = [fold_edge(fold, sheets) for fold in folds]
    edges += slim_folds(sheets, rest, edges)

    # 6. Tell: how well folds and corners are known, and what lies beyond the edges that are left open.
    return replace(
        facets,
        folds=tuple(edges),
        corners=tuple(corner_point(corner, sheets) for corner in corners),
        open_m=_open_edges(facets, sheets, outline),
    )


def _open_edges(
    facets: PanelModel, sheets: Sequence[Sheet], outline: Callable[[int], OutlineCells]
) -> dict[str, float]:
    """Length of the edges of a single facet by what the outline's nearest cell says of them, metres."""
    edges, count, owner = edges_of(facets.faces)
    is_open = count == 1
    edges, owner = edges[is_open], owner[is_open]
    length = np.linalg.norm(facets.vertices[edges[:, 1]] - facets.vertices[edges[:, 0]], axis=1)
    middle = facets.vertices[edges].mean(axis=1)
    total: dict[str, float] = {}
    for number in np.unique(facets.face_surface[owner]).tolist():
        own = facets.face_surface[owner] == number
        grid = sheets[number - 1].patch.grid
        said = NearOutline.of(grid, outline(number - 1)).kinds(grid.surface.to_uv(middle[own]))
        for kind in np.unique(said).tolist():
            total[kind] = total.get(kind, 0.0) + float(length[own][said == kind].sum())
    return dict(sorted(total.items()))
