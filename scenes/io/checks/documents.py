# SPDX-License-Identifier: MIT
"""Documents: JSON and TOML of strangers within limits, and the files that mesh files name.

Limits are of size, depth and numbers. The files that a mesh file names must all lie within its folder, and
are checked before they are opened.
"""

from __future__ import annotations

import json
import math
import re
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path, PureWindowsPath
from typing import Any, NoReturn, TypeVar
from urllib.parse import unquote

from scenes.checks import InputError
from scenes.io.checks.guard import check_file, guard_reading
from scenes.io.checks.image import check_image
from scenes.io.checks.limits import check_limit

_MOST_DIGITS = 18  # of an integer: what fits into 63 bits
_HALF = re.compile(r"\\u[dD][89a-fA-F]")  # half of a pair that stands for one letter
_SUSPECT = re.compile(r"\d{19}|\d[eE]\+?\d{3}")  # may be a number that is too large: each is looked at
_WORDS = {dict: "an object {...}", list: "a list [...]"}
Kind = TypeVar("Kind", dict[str, Any], list[Any])


def read_text(path: Path, limit: str = "json_bytes") -> str:
    """Return the text of a file, UTF-8 with or without a byte order mark.

    `limit` is the field of `scenes.io.checks.limits.ReadLimits` that its bytes are held against. Raises
    InputError: as `check_file`, or bytes that are no UTF-8.
    """
    file = check_file(path, limit)
    try:
        return file.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: is no UTF-8 text: its byte {error.start} begins no letter") from error
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error


def decode_text(data: bytes) -> str:
    """Return bytes of any encoding as text: UTF-8, else Windows-1252 (Latin-1); unknown bytes are replaced.

    Numbers and keywords are right in all encodings that extend ASCII; names may be misspelt.
    """
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("cp1252", errors="replace")


def as_utf8(data: bytes) -> bytes:
    """Return bytes of a text in any encoding as UTF-8; see `decode_text`."""
    return data if data.isascii() else decode_text(data).encode("utf-8")


def read_json(path: Path, kind: type[Kind]) -> Kind:
    """Return the object (`dict`) or list (`list`) of a JSON file.

    Raises InputError: as `read_text` and `parse_json`; the message names the file.
    """
    with guard_reading(path, "JSON"):
        return parse_json(read_text(path), kind)


def parse_json(text: str | bytes, kind: type[Kind]) -> Kind:
    """Return the object or list that a JSON text holds.

    Raises InputError: too large, no JSON, of another kind, nested too deeply, or with a number that is not
    finite, that has more than 18 digits, or with half a letter in a text.
    """
    check_limit("json_bytes", len(text), "bytes of JSON")
    try:
        known = text if isinstance(text, str) else text.decode("utf-8-sig")
        hooks = _SLOW if _SUSPECT.search(known) else {}
        value = json.loads(known, parse_constant=_refuse_constant, **hooks)
    except RecursionError as error:
        raise InputError("is no usable JSON: it is nested too deeply") from error
    except InputError:
        raise
    except ValueError as error:
        raise InputError(f"is no valid JSON: {error}") from error
    if not isinstance(value, kind):
        raise InputError(f"is JSON, but not {_WORDS[kind]}: it is {_name_kind(value)}")
    if _HALF.search(known):
        _check_letters(value)
    return value


def _refuse_constant(word: str) -> NoReturn:
    raise InputError(f"is no valid JSON: it holds {word}; write null for what is not known")


def _finite(digits: str) -> float:
    number = float(digits)
    if not math.isfinite(number):
        raise InputError(f"holds the number {digits[:40]}, which is too large")
    return number


def _within_63_bits(digits: str) -> int:
    if len(digits.lstrip("-")) > _MOST_DIGITS:
        raise InputError(f"holds an integer of {len(digits.lstrip('-'))} digits; at most 18 are read")
    return int(digits)


def _name_kind(value: object) -> str:
    if isinstance(value, dict | list):
        return _WORDS[type(value)]
    return "null" if value is None else f"the {type(value).__name__} {str(value)[:40]!r}"


def _check_letters(value: Any) -> None:
    """Raise where a text holds half of a pair, but one that stands for a byte of a file name (PEP 383)."""
    try:
        json.dumps(value, ensure_ascii=False).encode("utf-8", "surrogateescape")
    except UnicodeEncodeError as error:
        raise InputError(f"holds \\u{ord(error.object[error.start]):04x}, which is half a letter") from error


_SLOW: dict[str, Any] = {"parse_float": _finite, "parse_int": _within_63_bits}


def read_toml(path: Path) -> dict[str, Any]:
    """Return the table of a TOML file.

    Raises InputError: as `read_text`, no TOML, or nested too deeply; the message names the file.
    """
    text = read_text(path, "toml_bytes")
    with guard_reading(path, "TOML"):
        return parse_toml(text)


def parse_toml(text: str) -> dict[str, Any]:
    """Return the table that a TOML text holds; raises InputError as `read_toml`."""
    try:
        return tomllib.loads(text)
    except RecursionError as error:
        raise InputError("is no usable TOML: it is nested too deeply") from error
    except ValueError as error:  # no TOML, integers of thousands of digits, dates that are none
        raise InputError(f"is not TOML: {error}") from error


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
        """Return the bytes of a file; material libraries in UTF-8.

        Raises InputError: as `within_folder` and `check_file`.
        """
        path = within_folder(self._folder, name.strip())
        data = check_file(path).read_bytes()
        return as_utf8(data) if path.suffix.lower() == ".mtl" else data

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
        images = [_Named(text, within_folder(file.parent, text)) for text in map(_without_options, maps)]
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
                keyword, _, value = decode_text(line).partition(" ")
                if keyword == "usemtl":
                    used.add(value.strip())
                else:
                    libraries[value.strip()] = None
    return list(libraries), used - {""}


def _mtl_words(library: Path) -> tuple[set[str], list[str]]:
    """Materials of a library, and what it says of their maps."""
    materials, maps = set(), []
    text = decode_text(check_file(library, "json_bytes").read_bytes())
    for line in text.splitlines():
        keyword, _, value = line.strip().partition(" ")
        if keyword == "newmtl":
            materials.add(value.strip())
        elif keyword.lower().startswith("map_"):
            maps.append(value.strip())
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
        head = decode_text(stream.read(_MAX_HEADER).partition(b"end_header")[0])
    words = "comment TextureFile "
    names = [line[len(words) :].strip() for line in head.splitlines() if line.startswith(words)]
    return [_Named(name, within_folder(file.parent, name)) for name in names]


def _missing_textures(images: list[_Named], file: Path) -> Iterator[str]:
    missing = [image.text for image in images if not image.path.is_file()]
    if missing:
        n, noun = len(missing), "texture is" if len(missing) == 1 else "textures are"
        first = repr(missing[0][:_SHOWN])
        yield f"{n} {noun} missing beside {file.name}, the first is {first}: what it covers is grey"
