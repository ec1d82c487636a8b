# SPDX-License-Identifier: MIT
"""References: the files that a mesh file names, all of which must lie within its folder, and are checked."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path, PureWindowsPath
from typing import Any
from urllib.parse import unquote

from scenes.checks import InputError
from scenes.io.guard import check_file
from scenes.io.image import check_image

_MAX_HEADER = 1 << 22  # bytes
_SHOWN = 100  # characters of a name in a warning

EMPTY: Mapping[str, Any] = {}


@dataclass(frozen=True, slots=True)
class NamedFiles:
    """What a mesh names beside it.

    Attributes
    ----------
    warnings : tuple of str
        Files and materials that are named but not there, so that their colour is lost.
    texels : int
        Pixels of the textures that are there.
    """

    warnings: tuple[str, ...]
    texels: int


@dataclass(frozen=True, slots=True)
class _Named:
    """A file that another one names: the text that stands there, and where it would lie, there or not."""

    text: str
    path: Path


def check_references(file: Path, content: Mapping[str, Any] = EMPTY) -> NamedFiles:
    """Check that every file which a mesh names lies within the mesh's folder, and say which are missing.

    Material libraries and maps of OBJ, buffers and images of glTF, whose JSON is `content`, the texture of
    PLY. Raises InputError: a name that leads out of the folder: nothing there is opened; a texture that is no
    image, or larger than the limits allow.
    """
    suffix = file.suffix.lower()
    images: list[_Named] = []
    warnings: list[str] = []
    if suffix == ".obj":
        images, warnings = _check_obj(file)
    elif suffix in (".gltf", ".glb"):
        entries = content.get("images", [])
        if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
            raise InputError("its images are no list of objects")
        images = [named for entry in entries for named in _uri(entry, file)]
    elif suffix == ".ply":
        images = _ply_textures(file)
    there = {image.path: image for image in images if image.path.is_file()}
    return NamedFiles((*warnings, *_missing_textures(images, file)), sum(map(check_image, there)))


def within_folder(folder: Path, text: str) -> Path:
    """Return the path of a file that another one in `folder` names.

    Raises InputError: the name is absolute, has a scheme, or leads out of the folder.
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


class Beside:
    """What a decoder may open beside a mesh: files within its folder, by the names that it gives them."""

    def __init__(self, file: Path) -> None:
        self.file_name = file.name
        self._folder = file.parent

    def get(self, name: str) -> bytes:
        """Return the bytes of a file.

        Raises InputError: as `within_folder` and `check_file`.
        """
        return check_file(within_folder(self._folder, name.strip())).read_bytes()

    __getitem__ = get


def _check_obj(file: Path) -> tuple[list[_Named], list[str]]:
    """Look at the library, its maps and the materials: images, and what to warn of."""
    warnings: list[str] = []
    libraries, used = _obj_words(file)
    defined: set[str] = set()
    images: list[_Named] = []
    if len(libraries) > 1:
        warnings.append(f"names {len(libraries)} material files; only the first, {libraries[0]!r}, is read")
    for text in libraries[:1]:
        library = within_folder(file.parent, text)
        if not library.is_file():
            return [], [f"its material file {text[:_SHOWN]!r} is missing: colours and textures are lost"]
        materials, maps = _mtl_words(library)
        defined |= materials
        warnings += [
            f"the texture {name[:_SHOWN]!r} is left out: options before a file name are not known"
            for name in maps
            if name.startswith("-")
        ]
        images = [_Named(one, within_folder(file.parent, one)) for one in map(_without_options, maps)]
    unknown = sorted(used - defined)
    if libraries and unknown:
        n, first = len(unknown), repr(unknown[0][:_SHOWN])
        warnings.append(f"materials used but not defined: {n} (first {first}); what they cover is grey")
    return images, warnings


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
    text = check_file(library, "json_bytes").read_bytes().decode("utf-8", errors="replace")
    for line in text.splitlines():
        keyword, _, rest = line.strip().partition(" ")
        if keyword == "newmtl":
            materials.add(rest.strip())
        elif keyword.lower().startswith("map_"):
            maps.append(rest.strip())
    return materials, [name for name in maps if name]


def _without_options(text: str) -> str:
    """Return the file name of a map, which stands after options such as `-s 1 1 1`."""
    return text.split()[-1] if text.startswith("-") else text


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
        first = repr(missing[0][:_SHOWN])
        yield f"{n} {noun} missing beside {file.name}, the first is {first}: what it covers is grey"
