# SPDX-License-Identifier: MIT
"""Nesting: which loops of a region bound one face; a plane's region may be several."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from shapely import Point, Polygon

from completion.exchange.step.curves.fold_curve import FoldCurve
from completion.exchange.step.loops import Side, loop_points
from completion.exchange.step.pieces import Piece
from scenes.checks import FloatArray
from scenes.surfaces.catalogue import Plane, Surface

_N_SAMPLES = 24  # of a piece


def nested(
    surface: Surface,
    loops: Sequence[list[Side]],
    pieces: Sequence[Piece],
    curves: Sequence[FoldCurve],
    points: FloatArray,
) -> list[list[list[Side]]]:
    """Return the loops (outer first) of each face of a region; on surfaces that are no planes it is one.

    On a plane a loop bounds from outside or from inside by how many others it lies in, whatever the region's
    points (n, 3) say of its side; a face without any of these is none.
    """
    if not isinstance(surface, Plane) or not loops:
        return [list(loops)] if loops else []
    rings = [surface.to_uv(loop_points(loop, pieces, curves, _N_SAMPLES)) for loop in loops]
    areas = [_area(ring) for ring in rings]
    shapes = [Polygon(ring).buffer(0) for ring in rings]
    inside = [
        [k for k in range(len(loops)) if k != n and shapes[k].contains(Point(rings[n][0]))]
        for n in range(len(loops))
    ]
    uv = surface.to_uv(points)
    faces = list[list[list[Side]]]()
    for n, around in enumerate(inside):
        if len(around) % 2:
            continue
        holes = [k for k, others in enumerate(inside) if n in others and len(others) == len(around) + 1]
        face = shapes[n]
        for k in holes:
            face = face.difference(shapes[k])
        if not any(face.contains(Point(one)) for one in uv[:: max(1, len(uv) // 2000)]):
            continue
        faces.append([_turned(loops[n], areas[n] < 0), *(_turned(loops[k], areas[k] > 0) for k in holes)])
    return faces


def _turned(loop: list[Side], is_wrong: bool) -> list[Side]:
    return [Side(one.piece, not one.is_forward) for one in reversed(loop)] if is_wrong else loop


def _area(ring: FloatArray) -> float:
    x, y = ring.T
    return float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum()) / 2
