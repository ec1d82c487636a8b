# SPDX-License-Identifier: MIT
"""OBJ: its text held against the vertices that are there; written with materials and textures beside it."""

from __future__ import annotations

import io
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from scenes.checks import InputError
from scenes.io.checks.documents import as_utf8
from scenes.io.checks.limits import check_limit
from scenes.io.meshes.polygons import cut_polygons
from scenes.mesh.mesh_parts import MeshPart
from scenes.run.atomic import write_bytes, write_text

_INDENTED = re.compile(rb"(?m)^[ \t]+(?=[a-z#])")
_KEYWORD = re.compile(rb"(?m)^(v|vn|vt|f|o|g|usemtl|mtllib)[ \t]*\t[ \t]*")
_CONTINUED = re.compile(rb"(?<![\x80-\xff])\\\r?\n")  # not the second byte of a letter (CP932)
_COLOURED = re.compile(
    rb"(?m)^(v (?:\S+[ \t]+){3})(\S+[ \t]+\S+[ \t]+\S+)[ \t]*$"
)  # a vertex, and its colour
_COMMENT = re.compile(rb"(?m)^((?:v|vn|vt|f)[ ][^#\n]*)#[^\n]*")
_POLYGON = re.compile(rb"(?m)^f(?:[ \t]+[^ \t\n]+){4}")
_OBJECT = re.compile(rb"(?m)^o ")
_BARE = re.compile(rb"(?m)(?<=\d)/+(?=[ \t]|$)")  # 1// is 1
_WIDTHS = {b"v": (3, 8), b"vt": (1, 3), b"vn": (3, 3)}  # numbers of a line: fewest, most
_NAMES = {0: "vertex", 1: "texture coordinate", 2: "normal"}
_KEYS = (b"v", b"vt", b"vn")
_UNSAFE = re.compile(r"[^\w.-]+")


def plain_obj(data: bytes) -> bytes:
    """Return the text of an OBJ file in UTF-8, a line an entry, not indented, one blank after its keyword."""
    data = as_utf8(data)
    if b"\r" in data:
        data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    for pattern, instead in ((_CONTINUED, b" "), (_INDENTED, b""), (_KEYWORD, rb"\1 "), (_COMMENT, rb"\1")):
        data = pattern.sub(instead, data)
    data = re.sub(rb"(?m)^f[ ][^\n]*", lambda face: _BARE.sub(b"", face[0]), data) if b"/ " in data else data
    return _with_unit_colours(data.replace(b"\\\n", b"\\ \n"))  # ends a name: a decoder would join the lines


def _with_unit_colours(data: bytes) -> bytes:
    """Return the text with colours after the coordinates of vertices, where they are bytes, as 0..1."""
    try:
        most = max((float(word) for _, held in _COLOURED.findall(data) for word in held.split()), default=0.0)
    except ValueError:
        return data  # no numbers: told with the line
    if not 1 < most <= 255:
        return data

    def scaled(line: re.Match[bytes]) -> bytes:
        return line[1] + b" ".join(b"%.9f" % (float(word) / 255) for word in line[2].split())

    return _COLOURED.sub(scaled, data)


def cut_obj(text: bytes) -> bytes:
    """Return a checked OBJ text whose polygons that are not convex are triangles.

    Raises InputError: thousands of corners in one that is not convex.
    """
    if not _POLYGON.search(text):
        return text
    lines, vertices, polygons, faces = text.split(b"\n"), list[list[float]](), list[list[int]](), list[int]()
    for number, line in enumerate(lines):
        if line.startswith(b"v "):
            vertices.append([float(word) for word in line.split()[1:4]])
        elif line.startswith(b"f ") and len(words := line.split()[1:]) > 3:
            corners = [int(word.partition(b"/")[0]) for word in words]
            polygons.append([corner - 1 if corner > 0 else len(vertices) + corner for corner in corners])
            faces.append(number)
    for number, triangles in zip(faces, cut_polygons(polygons, np.array(vertices)), strict=True):
        words = lines[number].split()[1:]
        if triangles[:, 0].any():  # a fan is left to its reader
            lines[number] = b"\n".join(b"f " + b" ".join(words[k] for k in row) for row in triangles.tolist())
    return b"\n".join(lines)


def number_objects(text: bytes) -> tuple[bytes, tuple[str, ...]]:
    """Return a plain OBJ text whose objects all have different names ("wall", "wall #2"), and what to tell.

    Where there are no objects, groups are; a group that comes again without vertices of its own goes on.
    """
    key = b"o " if _OBJECT.search(text) else b"g "
    head, *blocks = re.split(rb"(?m)^(?=%s)" % key, text)
    titles = [block.partition(b"\n")[0][2:] for block in blocks]
    taken, name_of, before, n_same = set(titles), dict[bytes, bytes](), head, 0
    shown = set[bytes]()
    for k, (block, title) in enumerate(zip(blocks, titles, strict=True)):
        is_own = b"\nv " in block or (b"\nv " in before and b"\nf " not in before)
        if title in name_of and (key == b"o " or is_own):
            numbers = (b"%s #%d" % (title.rstrip(), number) for number in range(2, len(blocks) + 3))
            name_of[title] = next(name for name in numbers if name not in taken)
            taken.add(name_of[title])
            n_same += 1
        before, name = block, name_of.setdefault(title, title)
        shown |= {name} if b"\nf " in block else set()
        blocks[k] = b"o " + name + block[2 + len(title) :]
    return b"".join([head, *blocks]), same_names_told(n_same, len(shown))


def same_names_told(n_same: int, n: int) -> tuple[str, ...]:
    """Say how many of n objects have the name of another."""
    if not n_same:
        return ()
    return (f"{n_same} of {n} objects have the name of another; a number behind it tells them apart",)


def check_obj(text: bytes) -> int:
    """Return how many triangles a plain OBJ text holds, its polygons cut into fans.

    Raises InputError: a vertex that is not numbers, a face of fewer than three corners or with a corner that
    is not there, or faces written in ways that are easily taken for each other; lines are numbered.
    """
    counts = dict.fromkeys(_KEYS, 0)
    kept: dict[bytes, list[bytes]] = {key: [] for key in _KEYS}
    faces: dict[tuple[int, int, bool], tuple[list[int], list[bytes]]] = {}
    before: list[int] = []  # vertices before the first face that counts from the end
    for number, line in enumerate(text.split(b"\n"), start=1):
        key, _, value = line.partition(b" ")
        if key in counts:
            counts[key] += 1
            kept[key].append(value)
        elif key == b"f":
            words = value.split()
            plain = value.replace(b"/", b" ")
            kind = (len(words), len(plain.split()), b"//" in value)
            lines = faces.setdefault(kind, ([], []))
            lines[0].append(number)
            lines[1].append(plain)
            if b"-" in value and not before:
                before = [counts[key] for key in _KEYS]
        elif key.startswith(b"f") and not key.isalpha():
            raise InputError(f"line {number} begins with {key[:20].decode('latin-1')!r}, which is no face")
    if before and before != [counts[key] for key in _KEYS]:
        raise InputError("has faces that count from the end, and vertices after them; save it without")
    check_limit("points", counts[b"v"], "its vertices")
    for key in _KEYS:
        _check_vertices(key, kept[key])
    return _check_faces(faces, [counts[key] for key in _KEYS])


def _check_vertices(key: bytes, lines: Sequence[bytes]) -> None:
    """Raise where lines of one kind are no rows of numbers."""
    if not lines:
        return
    fewest, most = _WIDTHS[key]
    widths = {len(line.split()) for line in lines}
    if min(widths) < fewest or max(widths) > most:
        raise InputError(f"has {key.decode()} lines of {min(widths)} to {max(widths)} numbers")
    for width in widths:
        rows = [line for line in lines if len(line.split()) == width] if len(widths) > 1 else lines
        try:
            np.loadtxt([row.decode("latin-1") for row in rows], comments=None)
        except ValueError as error:
            raise InputError(f"its {key.decode()} lines cannot be read: {error}") from error


def _check_faces(faces: dict[tuple[int, int, bool], tuple[list[int], list[bytes]]], counts: list[int]) -> int:
    total = 0
    by_width: dict[int, tuple[int, int, bool]] = {}
    for kind, (numbers, lines) in faces.items():
        n_corners, width, skips = kind
        if n_corners < 3:
            raise InputError(f"line {numbers[0]} is a face of {n_corners} corners; three are needed")
        each = width // n_corners
        if width % n_corners or each > 3 or (skips and each != 2):
            raise InputError(f"line {numbers[0]} is a face whose corners are written in different ways")
        if by_width.setdefault(width, kind) != kind:
            raise InputError(
                f"line {numbers[0]} has a face in another notation than an earlier face; save triangles"
            )
        total += len(numbers) * (n_corners - 2)
        check_limit("faces", total, "its faces")
        try:
            table = np.loadtxt([line.decode("latin-1") for line in lines], np.int64, ndmin=2, comments=None)
        except (ValueError, OverflowError) as error:
            raise InputError(f"its faces cannot be read: {error}") from error
        for part in range(each):
            what = 2 if skips and part == 1 else part
            _check_range(table[:, part::each], counts[what], _NAMES[what], numbers)
    return total


def _check_range(table: NDArray[np.int64], count: int, name: str, lines: list[int]) -> None:
    bad = ((table == 0) | (np.abs(table) > count)).any(axis=1)
    if bad.any():
        first = int(np.argmax(bad))
        wrong = table[first][(table[first] == 0) | (np.abs(table[first]) > count)][0]
        raise InputError(
            f"line {lines[first]}: its face names {name} {wrong}, but they count from 1 to {count} "
            f"({int(bad.sum())} such faces)"
        )


def write_obj(parts: Sequence[MeshPart], path: Path, comments: Sequence[str] = ()) -> list[Path]:
    """Write parts in world coordinates as OBJ in double precision; return all files that were written.

    A part with a texture has a material that names `STEM_1.png` and so on, STEM that of the .obj file; one of
    a single colour has a material of that colour. Where a part has several, all vertices have theirs after
    the coordinates, since readers know no mixture. The tint of a texture is left out. Comments are lines at
    the head.
    """
    images, number_of = _numbered_images(parts)
    files = [path.with_name(f"{path.stem}_{number}.png") for number in range(1, len(images) + 1)]
    materials: dict[str, str] = {}
    lines = [f"# {comment}" for comment in comments]
    body: list[str] = []
    n_vertices = n_uv = 0
    coloured = any(part.colour is not None and _material(part, number_of) is None for part in parts)
    for part in sorted(parts, key=lambda part: _material(part, number_of) is not None):
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
