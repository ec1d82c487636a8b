# SPDX-License-Identifier: MIT
"""OBJ writer: text with an object for each part, materials in an MTL file and textures as PNG beside it."""

from __future__ import annotations

import io
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from scenes.mesh.mesh_parts import MeshPart
from scenes.run.atomic import write_bytes, write_text

_UNSAFE = re.compile(r"[^\w.-]+")


def write_obj(parts: Sequence[MeshPart], path: Path, comments: Sequence[str] = ()) -> list[Path]:
    """Write parts as OBJ in double precision; return all files that were written.

    A part with a texture has a material that names `STEM_1.png` and so on; one of a single colour has a
    material of that colour. Where a part has several, all vertices have theirs after the coordinates, since
    readers know no mixture. The tint of a texture is left out.

    Parameters
    ----------
    parts : sequence of MeshPart
        What to write, world coordinates.
    path : Path
        The .obj file; the others get its stem.
    comments : sequence of str
        Lines at its head.
    """
    images, number_of = _numbered_images(parts)
    files = [path.with_name(f"{path.stem}_{number}.png") for number in range(1, len(images) + 1)]
    materials: dict[str, str] = {}
    lines = [f"# {comment}" for comment in comments]
    body: list[str] = []
    n_vertices = n_uv = 0
    coloured = any(part.colour is not None and _material(part, number_of) is None for part in parts)
    for part in sorted(parts, key=lambda one: _material(one, number_of) is not None):
        material = _material(part, number_of)
        body += [f"o {_UNSAFE.sub('_', part.name)}", *_vertex_lines(part, coloured=coloured)]
        if material is not None:
            image = None if part.image is None else files[number_of[id(part.image)]].name
            materials[material] = _material_lines(material, part, image)
            body.append(f"usemtl {material}")
        if part.uv is not None:
            body += [f"vt {u!r} {v!r}" for u, v in part.uv.astype(np.float64).tolist()]
        body += _face_lines(part, n_vertices + 1, n_uv + 1)
        n_vertices += len(part.vertices)
        n_uv += 0 if part.uv is None else len(part.uv)
    library = path.with_suffix(".mtl")
    if materials:
        lines.append(f"mtllib {library.name}")
    for file, image in zip(files, images, strict=True):
        write_bytes(file, _png(image))
    if materials:
        write_text(library, "\n".join(materials.values()))
    write_text(path, "\n".join([*lines, *body]) + "\n")
    return [path, *([library] if materials else []), *files]


def _numbered_images(parts: Iterable[MeshPart]) -> tuple[list[Any], dict[int, int]]:
    """The distinct images, and the number of each by its identity."""
    images: list[Any] = []
    number_of: dict[int, int] = {}
    for part in parts:
        if part.image is not None and id(part.image) not in number_of:
            number_of[id(part.image)] = len(images)
            images.append(part.image)
    return images, number_of


def _tint(part: MeshPart) -> tuple[int, ...] | None:
    """The one colour of a part, None where it has none or several."""
    if part.colour is None or (part.colour != part.colour[:1]).any():
        return None
    return tuple(int(channel) for channel in part.colour[0])


def _material(part: MeshPart, number_of: dict[int, int]) -> str | None:
    """Name of a part's material."""
    tint = _tint(part)
    if part.image is not None:
        return f"texture_{number_of[id(part.image)] + 1}"
    return None if tint is None else "colour_{:02x}{:02x}{:02x}".format(*tint)


def _material_lines(name: str, part: MeshPart, image: str | None) -> str:
    colour = (255, 255, 255) if part.image is not None else _tint(part) or (255, 255, 255)
    red, green, blue = (repr(channel / 255) for channel in colour)
    text = f"newmtl {name}\nKa 0 0 0\nKd {red} {green} {blue}\nKs 0 0 0\nillum 1\n"
    return text if image is None else f"{text}map_Kd {image}\n"


def _vertex_lines(part: MeshPart, *, coloured: bool) -> list[str]:
    if part.colour is None or not coloured:
        return [f"v {x!r} {y!r} {z!r}" for x, y, z in part.vertices.tolist()]
    table = np.hstack([part.vertices, part.colour / 255.0])
    return [f"v {' '.join(map(repr, row))}" for row in table.tolist()]


def _face_lines(part: MeshPart, first: int, first_uv: int) -> list[str]:
    corners = (part.faces + first).tolist()
    if part.uv is None:
        return [f"f {a} {b} {c}" for a, b, c in corners]
    shift = first_uv - first
    return [f"f {a}/{a + shift} {b}/{b + shift} {c}/{c + shift}" for a, b, c in corners]


def _png(image: Any) -> bytes:
    data = io.BytesIO()
    Image.fromarray(image).save(data, "PNG")
    return data.getvalue()
