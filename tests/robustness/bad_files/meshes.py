# SPDX-License-Identifier: MIT
"""Bad mesh files: raw writers that write whatever they are given, and what is given to them."""

from __future__ import annotations

import base64
import json
import os
import struct
import zlib
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from scenes.io.scene_files import load_scene
from tests.robustness.bad_files.case import Case, Outcome, cut

SIDE = np.array([[0, 0, 0], [4, 0, 0], [4, 3, 0], [0, 3, 0], [0, 0, 2], [4, 0, 2]], float)
FACES = np.array([[0, 2, 1], [0, 3, 2], [0, 1, 5], [0, 5, 4]])
Raw = Callable[[Path, Any, Any], Path]


def read(path: Path | str) -> tuple[str, ...]:
    return load_scene(path).warnings


def gltf(folder: Path, vertices: Any, faces: Any, **changes: Any) -> dict[str, Any]:
    corners, indices = np.asarray(vertices, "<f4").tobytes(), np.asarray(faces, "<u4").tobytes()
    (folder / "a.bin").write_bytes(corners + indices)
    return {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": "wall"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"uri": "a.bin", "byteLength": len(corners + indices)}],
        "bufferViews": [
            {"buffer": 0, "byteLength": len(corners)},
            {"buffer": 0, "byteOffset": len(corners), "byteLength": len(indices)},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": len(vertices), "type": "VEC3"},
            {"bufferView": 1, "componentType": 5125, "count": 3 * len(faces), "type": "SCALAR"},
        ],
    } | changes


def write_gltf(folder: Path, vertices: Any, faces: Any, **changes: Any) -> Path:
    (folder / "a.gltf").write_text(json.dumps(gltf(folder, vertices, faces, **changes)))
    return folder / "a.gltf"


def write_glb(folder: Path, vertices: Any, faces: Any, **changes: Any) -> Path:
    content = gltf(folder, vertices, faces, **changes)
    if content["buffers"][0].get("uri") == "a.bin":
        del content["buffers"][0]["uri"]
    data = (folder / "a.bin").read_bytes()
    data += changes.pop("more", b"")
    text = json.dumps(content).encode()
    text += b" " * (-len(text) % 4)
    data += b"\0" * (-len(data) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(data), 0x4E4942) + data
    (folder / "a.glb").write_bytes(b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks)
    return folder / "a.glb"


def write_obj(folder: Path, vertices: Any, faces: Any) -> Path:
    rows = [f"v {x!r} {y!r} {z!r}" for x, y, z in np.asarray(vertices, float).tolist()]
    rows += ["f " + " ".join(str(k + 1) for k in face) for face in np.asarray(faces).tolist()]
    (folder / "a.obj").write_text("\n".join(rows) + "\n")
    return folder / "a.obj"


def write_off(folder: Path, vertices: Any, faces: Any) -> Path:
    rows = [f"{x!r} {y!r} {z!r}" for x, y, z in np.asarray(vertices, float).tolist()]
    rows += ["3 " + " ".join(map(str, face)) for face in np.asarray(faces).tolist()]
    (folder / "a.off").write_text("\n".join(["OFF", f"{len(vertices)} {len(faces)} 0", *rows]) + "\n")
    return folder / "a.off"


PLY = (
    "ply\nformat {0} 1.0\n{1}element vertex {2}\nproperty float x\nproperty float y\nproperty float z\n"
    "element face {3}\nproperty list uchar int vertex_indices\nend_header\n"
)


def write_ply(folder: Path, vertices: Any, faces: Any, comment: str = "") -> Path:
    head = PLY.format("binary_little_endian", comment, len(vertices), len(faces)).encode()
    table = np.zeros(len(faces), [("n", "u1"), ("k", "<i4", (3,))])
    table["n"], table["k"] = 3, np.asarray(faces).reshape(-1, 3)
    (folder / "a.ply").write_bytes(head + np.asarray(vertices, "<f4").tobytes() + table.tobytes())
    return folder / "a.ply"


def write_text_ply(folder: Path, vertices: Any, faces: Any, counts: tuple[int, int] | None = None) -> Path:
    rows = [f"{x!r} {y!r} {z!r}" for x, y, z in np.asarray(vertices, float).tolist()]
    rows += ["3 " + " ".join(map(str, face)) for face in np.asarray(faces).tolist()]
    head = PLY.format("ascii", "", *(counts or (len(vertices), len(faces))))
    (folder / "a.ply").write_text(head + "\n".join(rows) + "\n")
    return folder / "a.ply"


def write_stl(folder: Path, vertices: Any, faces: Any) -> Path:
    table = np.zeros(len(faces), [("n", "<f4", (3,)), ("k", "<f4", (3, 3)), ("a", "<u2")])
    if len(faces):
        table["k"] = np.asarray(vertices)[np.asarray(faces)]
    (folder / "a.stl").write_bytes(bytes(80) + struct.pack("<I", len(faces)) + table.tobytes())
    return folder / "a.stl"


RAW: dict[str, Raw] = {
    "GLB": write_glb, "glTF": write_gltf, "OBJ": write_obj,
    "PLY": write_ply, "STL": write_stl, "OFF": write_off,
}  # fmt: skip


def spoilt(reader: str, change: Callable[[bytes], bytes]) -> Callable[[Path], Path]:
    """A whole file whose bytes are changed."""

    def write(folder: Path) -> Path:
        path = RAW[reader](folder, SIDE, FACES)
        path.write_bytes(change(path.read_bytes()))
        return path

    return write


def geometries() -> Iterator[tuple[int, str, Any, Any, tuple[Outcome, ...], set[str]]]:
    """Class, words, vertices, faces, what must come of it, formats in which it cannot be."""
    bad, outside = SIDE.copy(), FACES.copy()
    bad[1, 2] = np.nan
    yield 1, "a vertex that is NaN", bad, FACES, ("refused",), set()
    bad = SIDE.copy()
    bad[5] = np.inf
    yield 1, "a vertex that is infinite", bad, FACES, ("refused",), set()
    yield 2, "no faces", SIDE, FACES[:0], ("refused",), set()
    yield 2, "nothing at all", SIDE[:0], FACES[:0], ("refused",), set()
    yield 3, "a flat face", SIDE, [*FACES.tolist(), [0, 0, 1]], ("warned",), set()
    yield 3, "a face twice", SIDE, [*FACES.tolist(), [0, 3, 2]], ("warned",), set()
    yield 3, "a turned face", SIDE, [*FACES.tolist()[:3], [0, 4, 5]], ("warned",), set()
    yield 3, "a branching edge", SIDE, [*FACES.tolist(), [0, 1, 3], [0, 1, 4]], ("warned",), set()
    outside[2, 1] = 99
    yield 3, "a corner that is not there", SIDE, outside, ("refused",), {"STL"}
    outside = FACES.copy()
    outside[2, 1] = -9
    yield 3, "a negative corner", SIDE, outside, ("refused",), {"STL", "GLB", "glTF"}
    yield 4, "millimetres", SIDE * 1000, FACES, ("warned",), set()
    yield 4, "micrometres as metres", SIDE / 1e6, FACES, ("warned",), set()
    yield 4, "beyond all floats", SIDE * 1e300, FACES, ("refused",), {"GLB", "glTF", "PLY", "STL"}
    far = np.float32(SIDE + [4.5e5, 5.4e6, 100]).astype(float)
    yield 4, "UTM in 32 bits", far, FACES, ("warned", "refused"), set()
    yield 9, "all corners in one place", SIDE * 0, FACES, ("refused",), set()
    yield 9, "all corners on a line", SIDE * [1, 0, 0], FACES, ("refused",), set()


def png_bomb(width: int = 60_000, height: int = 60_000) -> bytes:
    """A PNG of a few bytes that announces a wall of pixels."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(bytes(1000)))


def secret(folder: Path) -> Path:
    """A folder within which a mesh lies, beside a picture that it must not see."""
    (folder / "inside").mkdir()
    Image.new("RGB", (4, 4), (9, 9, 9)).save(folder / "secret.png")
    (folder / "secret.mtl").write_text("newmtl m\n")
    os.symlink(folder / "secret.png", folder / "inside" / "link.png")
    return folder / "inside"


TEXTURED = "mtllib {0}\nv 0 0 0\nv 4 0 0\nv 0 3 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3\n"


def named(reader: str, name: str) -> Callable[[Path], Path]:
    """A mesh that names a file outside its folder."""

    def write(folder: Path) -> Path:
        inside = secret(folder)
        if reader == "OBJ" and name.endswith(".png"):
            (inside / "m.mtl").write_text(f"newmtl m\nmap_Kd {name}\n")
            (inside / "a.obj").write_text(TEXTURED.format("m.mtl"))
            return inside / "a.obj"
        if reader == "OBJ":
            (inside / "a.obj").write_text(TEXTURED.format(name))
            return inside / "a.obj"
        if reader == "PLY":
            return write_ply(inside, SIDE, FACES, f"comment TextureFile {name}\n")
        content = {"images": [{"uri": name}]}
        return RAW[reader](inside, SIDE, FACES, **content)  # type: ignore[call-arg]

    return write


def bombs() -> Iterator[tuple[str, str, Callable[[Path], Path]]]:
    def laughing(folder: Path, writer: Raw) -> Path:
        nodes = [{"children": [k + 1, k + 1]} for k in range(40)] + [{"mesh": 0}]
        return writer(folder, SIDE, FACES, nodes=nodes)  # type: ignore[call-arg]

    def overlapping(folder: Path, writer: Raw) -> Path:
        rows = np.tile(FACES, (20_000, 1))
        one = {"bufferView": 0, "componentType": 5126, "count": 6, "type": "VEC3"}
        other = {"bufferView": 1, "componentType": 5125, "count": rows.size, "type": "SCALAR"}
        return writer(folder, SIDE, rows, accessors=[one, *[other] * 2000])  # type: ignore[call-arg]

    def crowded(folder: Path, writer: Raw) -> Path:
        rows = np.tile(FACES, (20_000, 1))
        nodes: list[Any] = [{"mesh": 0}] * 2000
        return writer(folder, SIDE, rows, nodes=nodes, scenes=[{"nodes": list(range(len(nodes)))}])  # type: ignore[call-arg]

    for reader in ("GLB", "glTF"):
        raw: Any = RAW[reader]
        huge = [
            {"bufferView": 0, "componentType": 5126, "count": 10**12, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5125, "count": 12, "type": "SCALAR"},
        ]
        empty = [{"componentType": 5126, "count": 10**12, "type": "VEC3"}, huge[1]]
        picture = base64.b64encode(png_bomb()).decode()
        yield reader, "an array of 10^12 places", lambda f, raw=raw, a=huge: raw(f, SIDE, FACES, accessors=a)
        yield reader, "an array without bytes", lambda f, raw=raw, a=empty: raw(f, SIDE, FACES, accessors=a)
        yield (
            reader,
            "2,000 arrays over the same megabyte",
            lambda f, raw=raw: overlapping(f, raw),
        )
        yield reader, "nodes that double 40 times", lambda f, raw=raw: laughing(f, raw)
        yield reader, "80,000 faces placed 2,000 times", lambda f, raw=raw: crowded(f, raw)
        yield (
            reader,
            "a picture of 60,000 x 60,000 within",
            lambda f, raw=raw, p=picture: raw(f, SIDE, FACES, images=[{"uri": f"data:image/png;base64,{p}"}]),
        )
        yield (
            reader,
            "nodes in a circle",
            lambda f, raw=raw: raw(f, SIDE, FACES, nodes=[{"mesh": 0, "children": [1]}, {"children": [0]}]),
        )

    def painted(folder: Path) -> Path:
        (folder / "t.png").write_bytes(png_bomb())
        (folder / "m.mtl").write_text("newmtl m\nmap_Kd t.png\n")
        (folder / "a.obj").write_text(TEXTURED.format("m.mtl"))
        return folder / "a.obj"

    yield "OBJ", "a texture of 60,000 x 60,000", painted
    yield "PLY", "10^12 vertices announced", lambda f: write_text_ply(f, SIDE, FACES, (10**12, 4))
    yield "PLY", "a list of 2^31 corners", spoilt("PLY", lambda d: d.replace(b"list uchar", b"list uint"))
    yield (
        "STL",
        "4 billion triangles announced",
        spoilt("STL", lambda d: d[:80] + b"\xff\xff\xff\xef" + d[84:]),
    )
    yield (
        "OFF",
        "10^12 vertices announced",
        spoilt("OFF", lambda d: d.replace(b"6 4 0", b"1000000000000 4 0")),
    )


def cases() -> Iterator[Case]:
    """All bad meshes."""
    for kind, name, vertices, faces, expected, never in geometries():
        for reader, raw in RAW.items():
            if reader not in never:
                yield Case(
                    kind, reader, name, lambda f, raw=raw, v=vertices, t=faces: raw(f, v, t), read, expected
                )
        if kind != 4:
            yield Case(
                kind, "PLY", f"{name}, as text",
                lambda f, v=vertices, t=faces: write_text_ply(f, v, t), read, expected,
            )  # fmt: skip
    for reader in RAW:
        for share in (0.1, 0.5, 0.97):
            yield Case(5, reader, f"cut at {share:.0%}", spoilt(reader, lambda d, s=share: cut(d, s)), read)
        yield Case(5, reader, "0 bytes", spoilt(reader, lambda _: b""), read)
        yield Case(5, reader, "a folder", partial(folder_called, name=f"a.{reader.lower()}"), read)
        yield Case(5, reader, "random bytes", spoilt(reader, lambda _: bytes(range(256)) * 4), read)
    swaps: dict[str, Callable[[bytes], bytes]] = {
        "PLY": lambda d: d.replace(b"little", b"big"),
        "STL": lambda d: d[:80] + d[83:79:-1] + d[84:],
        "GLB": lambda d: d[:8] + d[11:7:-1] + d[12:],
    }
    for reader, change in swaps.items():
        yield Case(5, reader, "the other byte order", spoilt(reader, change), read)
    for counts in ((7, 4), (5, 4), (6, 5), (6, 3)):
        yield Case(
            5, "PLY", f"text that announces {counts}",
            lambda f, c=counts: write_text_ply(f, SIDE, FACES, c), read,
        )  # fmt: skip
        yield Case(
            5, "OFF", f"announces {counts}",
            spoilt("OFF", lambda d, c=counts: d.replace(b"6 4 0", b"%d %d 0" % c)), read,
        )  # fmt: skip
    yield Case(
        5, "STL", "one triangle fewer announced", spoilt("STL", lambda d: d[:80] + b"\3\0\0\0" + d[84:]), read
    )
    yield Case(
        5,
        "PLY",
        "one triangle fewer announced",
        spoilt("PLY", lambda d: d.replace(b"face 4", b"face 3")),
        read,
    )
    yield Case(5, "OBJ", "a face with corner 0", spoilt("OBJ", lambda d: d + b"f 0 1 2\n"), read)
    yield Case(5, "OBJ", "a vertex of two numbers", spoilt("OBJ", lambda d: d + b"v 0 1\n"), read)
    yield Case(5, "OBJ", "a vertex of words", spoilt("OBJ", lambda d: b"v a b c\n" + d), read)
    yield Case(5, "OBJ", "a face of words", spoilt("OBJ", lambda d: d + b"f a b c\n"), read)
    yield Case(
        5, "OBJ", "a material that is not there",
        lambda f: (f / "m.mtl").write_text("newmtl x\n") and write_text(f, "a.obj", TEXTURED.format("m.mtl")),
        read, ("warned",),
    )  # fmt: skip
    for reader, name, write in bombs():
        yield Case(6, reader, name, write, read)
    for reader in ("OBJ", "PLY", "GLB", "glTF"):
        for name in ("../secret.png", "/etc/hostname", "link.png", "C:\\secret.png", "file:///etc/hostname"):
            yield Case(7, reader, f"names {name}", named(reader, name), read)
    yield Case(7, "OBJ", "names ../secret.mtl", named("OBJ", "../secret.mtl"), read)
    yield Case(
        7, "glTF", "names a buffer ../a.bin",
        lambda f: write_gltf(secret(f), SIDE, FACES, buffers=[{"uri": "../secret.png", "byteLength": 120}]),
        read,
    )  # fmt: skip


def folder_called(folder: Path, name: str) -> Path:
    (folder / name).mkdir()
    return folder / name


def write_text(folder: Path, name: str, text: str) -> Path:
    (folder / name).write_text(text)
    return folder / name
