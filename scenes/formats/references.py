# SPDX-License-Identifier: MIT
"""References: the files that a mesh file names, all of which must lie within its folder."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PureWindowsPath
from typing import Any
from urllib.parse import unquote

from scenes.checks import InputError

_MAX_HEADER = 1 << 22  # bytes
_MAX_JSON = 1 << 28  # bytes
_PACKED = {"KHR_draco_mesh_compression", "EXT_meshopt_compression"}  # without it there is no geometry


@dataclass(frozen=True, slots=True)
class _Named:
    """A file that another one names.

    Attributes
    ----------
    text : str
        As it stands there.
    path : Path
        Where it would lie; it need not exist.
    """

    text: str
    path: Path


def check_references(file: Path) -> tuple[str, ...]:
    """Check that every file which a mesh names lies within the mesh's folder, and say which are missing.

    Material libraries and maps of OBJ, buffers and images of glTF, the texture of PLY.

    Parameters
    ----------
    file : Path
        The mesh file.

    Returns
    -------
    tuple of str
        Warnings: files and materials that are named but not there, so that their colour is lost.

    Raises
    ------
    InputError
        A name that leads out of the folder: nothing there is opened.
    """
    suffix = file.suffix.lower()
    if suffix == ".obj":
        return tuple(_check_obj(file))
    if suffix in (".gltf", ".glb"):
        return tuple(_check_gltf(file))
    if suffix == ".ply":
        return tuple(_missing_textures(_ply_textures(file), file))
    return ()


def within_folder(folder: Path, text: str) -> Path:
    """Return the path of a file that another one in `folder` names.

    Raises
    ------
    InputError
        The name is absolute, has a scheme, or leads out of the folder.
    """
    name = unquote(text).replace("\\", "/")
    windows = PureWindowsPath(name)
    is_elsewhere = bool(windows.drive or windows.root) or "://" in name or name.startswith("~")
    if is_elsewhere or not (folder / name).resolve().is_relative_to(folder.resolve()):
        raise InputError(
            f"names {text!r}, which lies outside its folder and is not opened; put the file beside it and "
            "name it without a path"
        )
    return folder / name


def _check_obj(file: Path) -> Iterator[str]:
    """Look at the libraries, their maps and the materials."""
    libraries, used = _obj_words(file)
    defined: set[str] = set()
    for text in libraries:
        library = within_folder(file.parent, text)
        if not library.is_file():
            yield f"its material file {text!r} is missing: colours and textures are lost"
            return
        materials, maps = _mtl_words(library)
        defined |= materials
        for name in maps:
            if name.startswith("-"):
                yield f"the texture {name!r} is left out: options before a file name are not known"
        images = [_Named(one, within_folder(file.parent, one)) for one in map(_without_options, maps)]
        yield from _missing_textures(images, file)
    unknown = sorted(used - defined)
    if libraries and unknown:
        n, first = len(unknown), repr(unknown[0])
        yield f"materials used but not defined: {n} (first {first}); what they cover is grey"


def _obj_words(file: Path) -> tuple[list[str], set[str]]:
    """Material libraries and the materials that are used."""
    libraries: dict[str, None] = {}
    used: set[str] = set()
    with file.open("rb") as stream:
        for line in stream:
            if line.startswith((b"mtllib ", b"usemtl ")):
                keyword, _, rest = line.decode("utf-8", errors="replace").partition(" ")
                if keyword == "usemtl":
                    used.add(rest.strip())
                else:
                    libraries[rest.strip()] = None
    return list(libraries), used - {""}


def _mtl_words(library: Path) -> tuple[set[str], list[str]]:
    """Materials of a library, and what it says of their maps."""
    materials, maps = set(), []
    for line in library.read_text("utf-8", errors="replace").splitlines():
        keyword, _, rest = line.strip().partition(" ")
        if keyword == "newmtl":
            materials.add(rest.strip())
        elif keyword.lower().startswith("map_"):
            maps.append(rest.strip())
    return materials, [name for name in maps if name]


def _without_options(text: str) -> str:
    """Return the file name of a map, which stands after options such as `-s 1 1 1`."""
    return text.split()[-1] if text.startswith("-") else text


def _check_gltf(file: Path) -> Iterator[str]:
    """Look at buffers and images; buffers must be there, and not packed in a way that is not known."""
    content = _gltf_json(file)
    packed = sorted(_PACKED & set(content.get("extensionsRequired") or ()))
    if packed:
        raise InputError(f"needs the extension {packed[0]}, which is not known; save it without compression")
    for entry in content.get("buffers") or []:
        for named in _uri(entry, file):
            if not named.path.is_file():
                raise InputError(f"its buffer {named.text!r} is missing; put it beside the file")
    images = [named for entry in content.get("images") or [] for named in _uri(entry, file)]
    yield from _missing_textures(images, file)


def _gltf_json(file: Path) -> dict[str, Any]:
    """Return the JSON part of a glTF or GLB file."""
    with file.open("rb") as stream:
        start = stream.read(20)
        if start[:4] == b"glTF":
            length = min(int.from_bytes(start[12:16], "little"), _MAX_JSON)
            data = stream.read(length)
        else:
            data = start + stream.read(_MAX_JSON)
    content = json.loads(data)
    if not isinstance(content, dict):
        raise InputError("is no glTF: its JSON is not an object")
    return content


def _uri(entry: dict[str, Any], file: Path) -> list[_Named]:
    """The file of a buffer or image; none where its bytes are inside."""
    text = entry.get("uri")
    if not isinstance(text, str) or text.startswith("data:"):
        return []
    return [_Named(text, within_folder(file.parent, text))]


def _ply_textures(file: Path) -> list[_Named]:
    """Images that the comments of a PLY file name."""
    with file.open("rb") as stream:
        head = stream.read(_MAX_HEADER).partition(b"end_header")[0].decode("utf-8", errors="replace")
    words = "comment TextureFile "
    names = [line[len(words) :].strip() for line in head.splitlines() if line.startswith(words)]
    return [_Named(name, within_folder(file.parent, name)) for name in names]


def _missing_textures(images: list[_Named], file: Path) -> Iterator[str]:
    missing = [image.text for image in images if not image.path.is_file()]
    if missing:
        n, noun = len(missing), "texture is" if len(missing) == 1 else "textures are"
        yield f"{n} {noun} missing beside {file.name}, the first is {missing[0]!r}: what it covers is grey"
