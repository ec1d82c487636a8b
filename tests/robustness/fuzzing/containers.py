# SPDX-License-Identifier: MIT
"""Mutations of what containers hold, with lengths and checksums made right again, so that parsers go on."""

from __future__ import annotations

import io
import json
import struct
import zipfile
import zlib
from collections.abc import Callable
from random import Random

from tests.robustness.fuzzing.bytewise import mutate_bytes, mutate_in_place
from tests.robustness.fuzzing.jsonwise import mutate_json_text, mutate_json_within
from tests.robustness.fuzzing.textwise import mutate_text, set_number, set_number_in_place

Mutation = Callable[[bytes, Random], bytes]


def _entry(name: str) -> zipfile.ZipInfo:
    return zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))


def mutate_npz(data: bytes, rng: Random) -> bytes:
    """Change a member of an archive of arrays: its array, its header, its name; or drop or repeat it."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = [(name, archive.read(name)) for name in archive.namelist()]
    except Exception:
        return mutate_bytes(data, rng)
    if not members:
        return data
    k = rng.randrange(len(members))
    name, array = members[k]
    kind = rng.random()
    if kind < 0.75:
        members[k] = name, _mutate_npy(array, rng)
    elif kind < 0.85:
        members[k] = rng.choice(members)[0], array
    elif kind < 0.9:
        del members[k]
    else:
        others = (
            "points.npy",
            "normals.npy",
            "ranges.npy",
            "../x.npy",
            "/x.npy",
            "x",
            "header.npy",
            "half_angle_deg.npy",
        )
        members.insert(k, (rng.choice(others), array))
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", rng.choice((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED))) as archive:
        for name, array in dict(members).items():
            archive.writestr(_entry(name), array)
    return out.getvalue()


def _mutate_npy(array: bytes, rng: Random) -> bytes:
    """Change the text of an array's header, with its length made right, or the values."""
    if array[:6] != b"\x93NUMPY" or len(array) < 12:
        return mutate_bytes(array, rng)
    size = int.from_bytes(array[8:10], "little")
    text, values = array[10 : 10 + size], array[10 + size :]
    kind = rng.random()
    if kind < 0.4:
        types = (
            b"<f8",
            b"<f4",
            b">f8",
            b"<i8",
            b"|u1",
            b"|O",
            b"<c16",
            b"|S5",
            b"<U9",
            b"|b1",
            b"<M8[s]",
            b"|V8",
            b"<f2",
        )
        old = next((one for one in types if one in text), b"<f8")
        text = rng.choice(
            (set_number(text, rng), text.replace(old, rng.choice(types)), mutate_text(text, rng))
        )
        text = text.rstrip() + b" " * (-(len(text.rstrip()) + 11) % 64) + b"\n"
    elif kind < 0.7 and b"<U" in text:
        plain = values.decode("utf-32-le", errors="replace").rstrip("\0").encode("utf-8", errors="replace")
        plain = mutate_json_within(plain, rng) if rng.random() < 0.8 else mutate_text(plain, rng)
        wide = plain.decode("utf-8", errors="replace")
        text = json_free_header(len(wide))
        values = wide.encode("utf-32-le", errors="surrogatepass")
    else:
        values = mutate_in_place(values, rng) if rng.random() < 0.8 else mutate_bytes(values, rng)
    return array[:8] + len(text).to_bytes(4, "little")[:2] + text + values


def json_free_header(n: int) -> bytes:
    """The header of an array that is one text of n characters."""
    text = f"{{'descr': '<U{n}', 'fortran_order': False, 'shape': (), }}".encode()
    return text + b" " * (-(len(text) + 11) % 64) + b"\n"


def mutate_glb(data: bytes, rng: Random) -> bytes:
    """Change the JSON or the binary chunk of a GLB, with lengths made right."""
    if data[:4] != b"glTF" or len(data) < 20:
        return mutate_bytes(data, rng)
    size = int.from_bytes(data[12:16], "little")
    text, rest = data[20 : 20 + size], data[28 + size :]
    if rng.random() < 0.8:
        text = mutate_json_text(text, rng) if rng.random() < 0.85 else mutate_text(text, rng, ".json")
    else:
        rest = mutate_in_place(rest, rng) if rng.random() < 0.7 else mutate_bytes(rest, rng)
    return glb_of_chunks(text, rest)


def glb_of_chunks(text: bytes, binary: bytes) -> bytes:
    """Return a GLB of a JSON and a binary chunk."""
    text, binary = text + b" " * (-len(text) % 4), binary + b"\0" * (-len(binary) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    chunks += struct.pack("<I4s", len(binary), b"BIN\0") + binary if binary else b""
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def mutate_gltf(data: bytes, rng: Random) -> bytes:
    """Change the JSON of a glTF."""
    return mutate_json_text(data, rng)


def mutate_png(data: bytes, rng: Random) -> bytes:
    """Change a chunk of a PNG, packed pixels unpacked before, with lengths and checksums made right."""
    chunks, at = [], 8
    while at + 12 <= len(data):
        size = int.from_bytes(data[at : at + 4], "big")
        chunks.append((data[at + 4 : at + 8], data[at + 8 : at + 8 + size]))
        at += 12 + size
    if not chunks:
        return mutate_bytes(data, rng)
    k = rng.randrange(len(chunks))
    kind, content = chunks[k]
    action = rng.random()
    if action < 0.75:
        chunks[k] = kind, _mutate_chunk(kind, content, rng)
    elif action < 0.85:
        chunks.insert(
            rng.randint(0, len(chunks)), (rng.choice((b"PLTE", b"tRNS", b"zTXt", b"iCCP", kind)), content)
        )
    elif action < 0.92:
        del chunks[k]
    else:
        rng.shuffle(chunks)
    parts = [
        struct.pack(">I", len(body)) + tag + body + struct.pack(">I", zlib.crc32(tag + body))
        for tag, body in chunks
    ]
    return data[:8] + b"".join(parts)


def _mutate_chunk(kind: bytes, content: bytes, rng: Random) -> bytes:
    if kind == b"IDAT" and rng.random() < 0.5:
        try:
            return zlib.compress(mutate_bytes(zlib.decompress(content), rng))
        except zlib.error:
            pass
    return mutate_in_place(content, rng) if rng.random() < 0.8 else mutate_bytes(content, rng)


def mutate_scan_comments(data: bytes, rng: Random) -> bytes:
    """Change the header that our PLY and PCD scans keep in comment lines, keeping it JSON."""
    lines = data.split(b"\n")
    marks = (b"comment unseen ", b"# unseen ")
    mine = [k for k, line in enumerate(lines[:400]) if line.startswith(marks) and line.endswith(b"|")]
    if not mine:
        return mutate_text(data, rng)
    mark = next(mark for mark in marks if lines[mine[0]].startswith(mark))
    text = b"".join(lines[k][len(mark) : -1] for k in mine)
    lines[mine[0] : mine[-1] + 1] = [mark + mutate_json_within(text, rng) + b"|"]
    return b"\n".join(lines)


def mutate_las(data: bytes, rng: Random) -> bytes:
    """Change numbers of the header and the records before the points, or JSON in them; their lengths stay."""
    if len(data) < 375:
        return mutate_bytes(data, rng)
    kind = rng.random()
    if kind < 0.25:
        return mutate_json_within(data, rng, same_length=True)
    offset = int.from_bytes(data[96:100], "little")
    end = min(max(offset, 375), len(data))
    start = 0 if kind < 0.7 else min(375, end - 1)
    return data[:start] + mutate_in_place(data[start:end], rng) + data[end:]


def mutate_first_lines(data: bytes, rng: Random) -> bytes:
    """Change numbers where the counts of text formats stand, or JSON in their first line."""
    head, mark, rest = data[:2000], b"", data[2000:]
    if head.startswith(b"# unseen {") and rng.random() < 0.6:
        return mutate_json_within(data, rng)
    return (set_number_in_place if rng.random() < 0.3 else set_number)(head, rng) + mark + rest


def mutate_json_file(data: bytes, rng: Random) -> bytes:
    """Change a JSON file."""
    try:
        json.loads(data)
    except (ValueError, RecursionError):
        return mutate_text(data, rng, ".json")
    return mutate_json_text(data, rng)
