# SPDX-License-Identifier: MIT
"""Fields of text: lines of numbers by others, whatever parts and closes their fields, as plain ones."""

from __future__ import annotations

import re
from pathlib import Path

from scenes.checks import InputError
from scenes.io.checks.documents import decode_text

COMMENT = re.compile(r"[ \t]*(?:#|//|%|!)[^\n]*")
_EMPTY_FIELD = re.compile(r"(?m)(?:^|(?<=\t)) *(?=\t)")  # of tab-separated text
_LETTER = re.compile(r"[^\W\d_]")
_QUOTED = re.compile(r'"([^"\n]*)"')
_THOUSANDS = re.compile(r"\d{1,3}(?:,\d{3})+(?:\.\d+)?")  # of a quoted field
_APOSTROPHE = re.compile(r"(?<=\d)['\u2019](?=\d{3}(?!\d))")  # between thousands, in Switzerland
_FORTRAN = re.compile(r"(?<=[\d.])[dD](?=[-+]\d)")  # 1.5D+02


def read_fields(path: Path) -> list[str]:
    """Return the lines of a text, their fields parted by blanks, with decimal points, and NaN where empty.

    Blanks and separators within quotes, and blanks within a field that has a separator, become _ in words.
    Raises InputError: no text.
    """
    return _clean(_decode(path)).split("\n")


def _decode(path: Path) -> str:
    """Return the text with plain line ends."""
    data = path.read_bytes()
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        text = data.decode("utf-16", errors="replace")
    else:
        text = decode_text(data)
    if "\0" in text[:100_000]:
        raise InputError("is binary, not text; is its suffix right?")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def _clean(text: str) -> str:
    """Return the text without quotes, decimal commas and separators other than blanks; empty fields NaN.

    Blanks and separators within quotes, and blanks within a field that has a separator, become _ in words.
    """
    text = _QUOTED.sub(lambda held: _unquoted(held[1]), text).replace('"', "")
    text = _FORTRAN.sub("e", _APOSTROPHE.sub("", text))
    has_decimal_commas = _has_decimal_commas(text.replace("\t", " "))
    text = _with_whole_words(_with_empty_fields(text), "\t").replace("\t", " ")
    if has_decimal_commas:
        text = text.replace(",", ".")
    for separator in ",;":
        if separator not in text:
            continue
        text = _with_whole_words(text, separator)
        text = re.sub(rf"(?m)^ *(?={separator})", " nan ", text)
        text = re.sub(rf"(?m){separator}(?= *(?:{separator}|$))", f"{separator} nan ", text)
        text = text.replace(separator, " ")
    return text


def _unquoted(field: str) -> str:
    """A field without its quotes, words in one piece and thousands without commas: "1,234.5" is 1234.5."""
    return field.replace(",", "") if _THOUSANDS.fullmatch(field) else _as_word(field, r"[\s,;]+")


def _as_word(field: str, gaps: str = r"\s+") -> str:
    """A field whose gaps are _, unless it is all numbers."""
    return re.sub(gaps, "_", field.strip()) if _LETTER.search(field) else field


def _with_whole_words(text: str, separator: str) -> str:
    """Return text whose fields between separators hold no blanks where they hold letters."""
    if separator not in text:
        return text
    return "\n".join(
        separator.join(map(_as_word, line.split(separator)))
        if separator in line and _LETTER.search(line) and not COMMENT.match(line)
        else line
        for line in text.split("\n")
    )


def _with_empty_fields(text: str) -> str:
    """Return tab-separated text with NaN for its empty fields.

    Where lines differ in their tabs but not in their fields, tabs align columns and no field is empty.
    """
    if not _EMPTY_FIELD.search(text):
        return text
    lines = [line.rstrip() for line in text.split("\n")]
    rows = [line for line in lines if "\t" in line and COMMENT.sub("", line).strip()]
    is_aligned = len({row.count("\t") for row in rows}) > 1 and len({len(row.split()) for row in rows}) == 1
    if is_aligned or not rows:
        return text
    if all(row.lstrip(" ").startswith("\t") for row in rows):  # indented
        lines = [line.lstrip() for line in lines]
    return "\n".join(_EMPTY_FIELD.sub(" nan ", line) for line in lines)


def _has_decimal_commas(text: str) -> bool:
    """Tell whether the first points are written like 1,5;2,5;3 or 1,5 2,5 3,5."""
    number = r"[-+]?\d+(?:,\d+)?(?:[eE][-+]?\d+)?"
    for line in COMMENT.sub("", text[:20_000]).split("\n"):
        fields = [field.strip() for field in (line.split(";") if ";" in line else line.split())]
        fields = [field for field in fields if field and not _LETTER.match(field)]
        if len(fields) >= 3 and any("," in field for field in fields[:3]):
            return all(re.fullmatch(number, field) for field in fields[:3])
    return False
