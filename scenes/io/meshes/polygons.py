# SPDX-License-Identifier: MIT
"""Polygons of mesh files cut into triangles: fans where they are convex, ears where they are not."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenes.checks import BoolArray, FloatArray, InputError
from scenes.io.meshes.ply import PlyElement, parse_header, row_type

_MOST_CORNERS = 5000  # of a polygon that is not convex: cutting takes the square of them
_BENT = 1e-9  # of the square of a polygon's sides: corners less turned are straight


def triangles_of(corners: NDArray[Any], vertices: FloatArray) -> NDArray[np.int64]:
    """Return the triangles (m, k - 2, 3) of polygons (m, k) of one number of corners, by corner from 0.

    Convex ones become fans from their first corner. Of others ears are cut (Meisters 1975), since a fan
    covers what lies outside of them; those that cross themselves remain fans.

    Raises InputError: thousands of corners in one that is not convex.
    """
    k = corners.shape[1]
    fan = np.array([[0, i, i + 1] for i in range(1, k - 1)], np.int64).reshape(-1, 3)
    cut = np.repeat(fan[None], len(corners), axis=0)
    for row in np.flatnonzero(are_concave(corners, vertices)).tolist():
        if k > _MOST_CORNERS:
            raise InputError(f"has a face of {k} corners that is not convex; save it as triangles")
        ears = _ears(vertices[corners[row]])
        cut[row] = fan if ears is None else ears
    return cut


def cut_polygons(polygons: Sequence[Sequence[int]], vertices: FloatArray) -> list[NDArray[np.int64]]:
    """Return the triangles (k - 2, 3) of each polygon of k vertices, by corner from 0; see `triangles_of`."""
    cut: list[NDArray[np.int64]] = [np.zeros((0, 3), np.int64)] * len(polygons)
    by_length: dict[int, list[int]] = {}
    for number, corners in enumerate(polygons):
        by_length.setdefault(len(corners), []).append(number)
    for numbers in by_length.values():
        found = triangles_of(np.array([polygons[number] for number in numbers]), vertices)
        for number, triangles in zip(numbers, found, strict=True):
            cut[number] = triangles
    return cut


def cut_ply(data: bytes) -> bytes:
    """Return the bytes of a checked PLY mesh whose polygons that are not convex are triangles.

    So are all polygons whose faces have colours or other properties. Faces that hold more lists than their
    corners, and those before the vertices, stay as they are.

    Raises InputError: thousands of corners in one that is not convex.
    """
    order, elements, start = parse_header(data)
    if [element.name for element in elements[:2]] != ["vertex", "face"] or elements[1].lists != 1:
        return data
    cut = _cut_rows(data, start, elements, order) if order else _cut_lines(data[start:], elements)
    if cut is None:
        return data
    n_faces, rows = cut
    head = re.sub(rb"(?m)^(element[ \t]+face[ \t]+)\d+", rb"\g<1>%d" % n_faces, data[:start])
    return head + rows


def _are_to_cut(cut: Iterable[NDArray[np.int64]], face: PlyElement) -> bool:
    """Whether triangles (k - 2, 3) of polygons are none that a reader of fans would find."""
    return any(
        triangles[:, 0].any() or (len(triangles) > 1 and len(face.properties) > 1) for triangles in cut
    )


def _cut_rows(data: bytes, at: int, elements: list[PlyElement], order: str) -> tuple[int, bytes] | None:
    """The number of triangles, and all binary rows, where polygons had to be cut; None where not."""
    points = np.frombuffer(data, row_type(data, at, elements[0], order)[0], elements[0].count, at)
    at += points.nbytes
    kind, lengths = row_type(data, at, elements[1], order)
    rows, ((name, length),) = np.frombuffer(data, kind, elements[1].count, at), lengths.items()
    vertices = np.stack([points[axis].astype(np.float64) for axis in "xyz"], axis=-1)
    triangles = triangles_of(rows[name].astype(np.int64), vertices)
    if not _are_to_cut(triangles, elements[1]):
        return None
    fields = [(key, kind[key].base, (3,)) if key == name else (key, kind[key]) for key in kind.names or ()]
    cut = np.empty((len(rows), length - 2), np.dtype(fields))
    for key in kind.names or ():
        cut[key] = rows[key][:, None] if key != name else 0
    cut[f"{name} length"], cut[name] = 3, rows[name][np.arange(len(rows))[:, None, None], triangles]
    return cut.size, points.tobytes() + cut.tobytes() + data[at + rows.nbytes :]


def _cut_lines(body: bytes, elements: list[PlyElement]) -> tuple[int, bytes] | None:
    """The number of triangles, and all rows of text, where polygons had to be cut; None where not."""
    lines, (vertex, face) = body.decode("latin-1").splitlines(), elements[:2]
    axes = [[name for name, _, _ in vertex.properties].index(axis) for axis in "xyz"]
    vertices = np.loadtxt(lines[: vertex.count], usecols=axes, ndmin=2)
    place = next(k for k, (_, length, _) in enumerate(face.properties) if length)
    words = [line.split() for line in lines[vertex.count : vertex.count + face.count]]
    ends = [place + 1 + int(row[place]) for row in words]
    polygons = [[int(word) for word in row[place + 1 : end]] for row, end in zip(words, ends, strict=True)]
    cut = cut_polygons(polygons, vertices)
    if not _are_to_cut(cut, face):
        return None
    rows = [
        " ".join([*row[:place], "3", *(str(corners[k]) for k in corner), *row[end:]])
        for row, end, corners, triangles in zip(words, ends, polygons, cut, strict=True)
        for corner in triangles.tolist()
    ]
    text = "\n".join([*lines[: vertex.count], *rows, *lines[vertex.count + face.count :]])
    return len(rows), text.encode("latin-1") + b"\n"


def are_concave(corners: NDArray[Any], vertices: FloatArray) -> BoolArray:
    """Tell which polygons (m, k) have a corner that turns against the others; none whose vertices lack."""
    concave = np.zeros(len(corners), np.bool_)
    if not corners.size or corners.shape[1] < 4:
        return concave
    there = np.flatnonzero(((corners >= 0) & (corners < len(vertices))).all(axis=1))
    points = vertices[corners[there]]
    points = points - points[:, :1]
    ahead = np.roll(points, -1, axis=1)
    normal = np.cross(points, ahead).sum(axis=1)
    turns = np.cross(points - np.roll(points, 1, axis=1), ahead - points)
    size = np.square(ahead - points).sum(axis=(1, 2))
    with np.errstate(invalid="ignore"):
        against = (
            np.einsum("mkx,mx->mk", turns, normal) < -_BENT * (size * np.linalg.norm(normal, axis=1))[:, None]
        )
    concave[there] = against.any(axis=1)
    return concave


def _ears(points: FloatArray) -> NDArray[np.int64] | None:
    """Triangles (k - 2, 3) of a polygon (k, 3) by corner, None where none can be cut off."""
    normal = np.cross(points - points[0], np.roll(points, -1, axis=0) - points[0]).sum(axis=0)
    drop = int(np.argmax(np.abs(normal)))
    flat = np.delete(points, drop, axis=1) * [1.0, (-1.0 if drop == 1 else 1.0) * np.sign(normal[drop])]
    left, found, at, n_tried = list(range(len(points))), list[tuple[int, int, int]](), 0, 0
    while len(left) > 3:
        a, b, c = (left[(at + k) % len(left)] for k in (-1, 0, 1))
        others = flat[[k for k in left if k not in (a, b, c)]]
        if _side(flat[a], flat[b], flat[c][None])[0] > 0 and not _inside(flat[[a, b, c]], others).any():
            found.append((a, b, c))
            left.pop(at % len(left))
            n_tried = 0
        else:
            at, n_tried = at + 1, n_tried + 1
            if n_tried > len(left):
                return None
    return np.array([*found, tuple(left)], np.int64)


def _side(a: FloatArray, b: FloatArray, points: FloatArray) -> FloatArray:
    """Twice the areas (n,) of the triangles of a, b and points (n, 2), positive to the left."""
    along, away = b - a, points - a
    return np.asarray(along[0] * away[:, 1] - along[1] * away[:, 0])


def _inside(triangle: FloatArray, points: FloatArray) -> BoolArray:
    """Tell which points (n, 2) lie in a triangle or on its rim, not on its corners."""
    a, b, c = triangle
    within = (_side(a, b, points) >= 0) & (_side(b, c, points) >= 0) & (_side(c, a, points) >= 0)
    return np.asarray(within & ~(points[:, None] == triangle).all(axis=2).any(axis=1), dtype=np.bool_)
