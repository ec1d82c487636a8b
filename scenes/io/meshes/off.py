# SPDX-License-Identifier: MIT
"""OFF meshes: text files of vertices and polygons, with colours of either."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenes.checks import ColourArray, FloatArray, InputError, check_faces
from scenes.io.checks.limits import check_limit
from scenes.io.meshes.polygons import cut_polygons
from scenes.run.atomic import write_text

_HEADER = re.compile(r"(ST)?(C)?(N)?(4)?(n)?OFF\b")


@dataclass(frozen=True, slots=True, eq=False)
class OffMesh:
    """What an OFF file holds.

    Attributes
    ----------
    vertices : (n, 3) float
        In the file's unit.
    faces : (m, 3) int32
        Polygons are cut into triangles.
    vertex_colour : (n, 3) uint8, optional
        Of COFF files.
    face_colour : (m, 3) uint8, optional
        Where every face says its colour.
    """

    vertices: FloatArray
    faces: NDArray[np.int32]
    vertex_colour: ColourArray | None = None
    face_colour: ColourArray | None = None


def read_off(path: Path) -> OffMesh:
    """Read an OFF, COFF, NOFF or STOFF file, a vertex and a face a line.

    Colours are integers 0..255 or numbers 0..1; normals and texture coordinates are left out.

    Raises InputError: binary or four-dimensional, truncated, or a line that is no vertex or face: it is
    numbered.
    """
    lines = _lines(path)
    kind = _HEADER.match(lines[0][1]) if lines else None
    if kind is None or "BINARY" in lines[0][1].upper():
        raise InputError("not a text OFF file: its first line is not OFF, COFF, NOFF or STOFF")
    if kind[4] or kind[5]:
        raise InputError("holds vertices of more than three coordinates; save it as plain OFF")
    fields = lines[0][1][kind.end() :].split()
    counts = [int(word) for word in (fields or lines[1][1].split())]
    body = lines[1 if fields else 2 :]
    n_vertices, n_faces = counts[:2]
    check_limit("points", n_vertices, "its vertices")
    check_limit("faces", n_faces, "its faces")
    if min(counts[:2]) < 0 or len(body) != n_vertices + n_faces:
        raise InputError(
            f"truncated or edited: {n_vertices} vertices and {n_faces} faces announced, {len(body)} lines "
            "present"
        )
    first = 6 if kind[3] else 3  # column after x y z and perhaps a normal
    vertices, colour = _vertices(body[:n_vertices], first if kind[2] else None)
    faces, face_colour = _faces(body[n_vertices : n_vertices + n_faces], vertices)
    return OffMesh(vertices, check_faces(faces, n_vertices), colour, face_colour)


def _lines(path: Path) -> list[tuple[int, str]]:
    """Lines with something in them besides a comment, and their numbers."""
    text = path.read_bytes().decode("utf-8", errors="replace")
    cut = ((number, line.partition("#")[0].strip()) for number, line in enumerate(text.splitlines(), 1))
    return [(number, line) for number, line in cut if line]


def _vertices(
    lines: list[tuple[int, str]], first_colour: int | None
) -> tuple[FloatArray, ColourArray | None]:
    """Coordinates, and the colours that begin at a column."""
    needed = 3 if first_colour is None else first_colour + 3
    rows = []
    for number, line in lines:
        words = line.split()
        if len(words) < needed:
            raise InputError(f"line {number} has {len(words)} numbers, a vertex here has {needed} or more")
        rows.append(words[:needed])
    table = np.array(rows, dtype=np.float64).reshape(-1, needed)
    if first_colour is None:
        return table, None
    as_integers = all("." not in word for row in rows for word in row[first_colour:])
    return table[:, :3].copy(), _colours(table[:, first_colour:], as_integers)


def _faces(
    lines: list[tuple[int, str]], vertices: FloatArray
) -> tuple[NDArray[np.int64], ColourArray | None]:
    """Triangles, and their colours where all polygons have some."""
    polygons, shades = list[list[int]](), list[list[str]]()
    as_integers = True
    for number, line in lines:
        words = line.split()
        n = int(words[0])
        if n < 1 or len(words) < n + 1:
            raise InputError(
                f"line {number} announces a face of {n} corners and has {len(words) - 1} numbers"
            )
        polygons.append([int(word) for word in words[1 : n + 1]])
        shades.append(words[n + 1 : n + 4])
        as_integers &= all("." not in word for word in shades[-1])
    cut = cut_polygons(polygons, vertices)
    triangles = [np.array(held)[corners] for held, corners in zip(polygons, cut, strict=True)]
    faces = np.concatenate([np.zeros((0, 3), np.int64), *triangles])
    colours = [shade for shade, corners in zip(shades, cut, strict=True) for _ in corners]
    if not colours or any(len(colour) != 3 for colour in colours):
        return faces, None
    return faces, _colours(np.array(colours, dtype=np.float64), as_integers)


def _colours(values: FloatArray, as_integers: bool) -> ColourArray:
    """8-bit colours of numbers 0..255, or of numbers 0..1 with a point in them."""
    scaled = values if as_integers else values * 255
    return np.asarray(np.clip(np.rint(scaled), 0, 255), dtype=np.uint8)


def write_off(
    path: Path, vertices: FloatArray, faces: NDArray[Any], colour: ColourArray | None = None
) -> None:
    """Write triangles as OFF in double precision, as COFF where vertices have colours (n, 3)."""
    rows = [" ".join(map(repr, row)) for row in vertices.tolist()]
    if colour is not None:
        rows = [f"{row} {r} {g} {b} 255" for row, (r, g, b) in zip(rows, colour.tolist(), strict=True)]
    head = ["OFF" if colour is None else "COFF", f"{len(vertices)} {len(faces)} 0"]
    body = [f"3 {a} {b} {c}" for a, b, c in faces.tolist()]
    write_text(path, "\n".join([*head, *rows, *body]) + "\n")
